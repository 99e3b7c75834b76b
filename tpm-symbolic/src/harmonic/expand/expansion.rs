//! Terms of a regressor form, collected as products of symbols and shapes.
//!
//! Terms of one row and column that have the same product of symbols form a group; every product of shapes in the group is a
//! contribution to one series of the table.

use crate::algebra::monomial::{Factorisation, Monomial};
use crate::algebra::packed::{Key, Layout};
use crate::algebra::spectrum::{Base, Spectrum, Whole};
use crate::harmonic::error::ExpandError;
use crate::harmonic::expand::atoms::{Atom, Atoms, PI};
use crate::harmonic::expand::coefficient::{common_denominator, numerator_over};
use crate::harmonic::expand::product::{Product, merge};
use crate::harmonic::options::ExpandOptions;
use crate::harmonic::table::CoefficientSeries;
use crate::mechanics::model::{ExactModel, TermId};
use crate::number::buffers::Rooms;
use crate::number::denominator::{Denominator, Factors};
use crate::number::scalar::Scalar;
use crate::regressor::form::{RegressorForm, Term};
use smallvec::SmallVec;

/// Powers of pi and of the model's symbols, and the products that have them.
type PowersPart<'a, K> = (i32, Monomial<usize>, &'a [Product<K>]);

/// The entries of one row, column and product of symbols.
pub(super) struct Group {
    /// Index into [`Expansion::common`] of the common denominator of the column's coefficients, when it is not 1.
    pub(super) common: Option<u32>,
    /// Index into [`Expansion::sums`], when the group has several products of shapes.
    pub(super) sum: Option<u32>,
    pub(super) term: TermId,
}

/// A sum of several products of shapes.
pub(super) struct Sum {
    /// The common denominator of the products.
    pub(super) denominator: Denominator,
    /// Number of products that are still to be added.
    pub(super) pending: usize,
    /// The sum of the products so far.
    pub(super) spectrum: Spectrum,
}

/// Place of the groups of one column in the table.
#[derive(Clone, Copy)]
struct Place {
    equation: usize,
    column: Option<usize>,
    common: Option<u32>,
    term: TermId,
}

/// A product of shapes that is added to a group.
pub(super) struct Contribution<K> {
    pub(super) shapes: K,
    pub(super) group: usize,
    pub(super) factor: Scalar,
}

/// The expansion of one regressor form. First its terms are collected as contributions to groups; then the
/// contributions are multiplied out into series.
pub(super) struct Expansion<'a, 'p, K> {
    pub(super) model: &'a ExactModel,
    pub(super) form: &'a RegressorForm,
    pub(super) atoms: &'a Atoms<'p>,
    pub(super) shape_layout: Layout,
    symbol_layout: Layout,
    pub(super) factors: Factors,
    pub(super) bases: SmallVec<[Base; 4]>,
    /// The parts of all atoms, as products.
    parts: Vec<Product<K>>,
    /// Powers of atoms with several parts, by atom and exponent.
    powers: Vec<Vec<Vec<Product<K>>>>,
    /// Common denominators of columns.
    pub(super) common: Vec<Denominator>,
    /// The products of the current column, with a buffer in which they are multiplied.
    products: Vec<Product<K>>,
    scratch: Vec<Product<K>>,
    pub(super) groups: Vec<Group>,
    pub(super) sums: Vec<Sum>,
    pub(super) contributions: Vec<Contribution<K>>,
    /// Bits of the largest factor of a contribution, and of the largest common denominator of a column.
    pub(super) factor_bits: u64,
    pub(super) common_bits: u64,
    pub(super) rooms: Rooms,
    pub(super) series: Vec<CoefficientSeries>,
    pub(super) words: Vec<u64>,
    pub(super) entries: usize,
}

impl<'a, 'p, K: Key> Expansion<'a, 'p, K> {
    #[inline(always)]
    pub(super) fn new(
        model: &'a ExactModel,
        form: &'a RegressorForm,
        atoms: &'a Atoms<'p>,
        shape_layout: Layout,
        symbol_layout: Layout,
    ) -> Self {
        let several = atoms.list.iter().any(|atom| atom.end - atom.start != 1);
        let mut powers = Vec::new();
        powers.resize_with(if several { atoms.list.len() } else { 0 }, Vec::new);
        let terms = form.rows.iter().map(|row| row.terms.len()).sum();
        Self {
            model,
            form,
            atoms,
            shape_layout,
            symbol_layout,
            factors: Factors::default(),
            bases: SmallVec::new(),
            parts: Vec::with_capacity(atoms.parts.len()),
            powers,
            common: Vec::new(),
            products: Vec::with_capacity(terms),
            scratch: Vec::new(),
            groups: Vec::with_capacity(terms),
            sums: Vec::new(),
            contributions: Vec::with_capacity(terms),
            factor_bits: 0,
            common_bits: 0,
            rooms: Rooms::default(),
            series: Vec::with_capacity(terms),
            words: Vec::new(),
            entries: 0,
        }
    }

    /// Converts shapes to factors, and parts to products.
    pub(super) fn prepare(&mut self) {
        let atoms = self.atoms;
        let mut wholes: SmallVec<[Whole<'_>; 2]> = SmallVec::new();
        for shape in &atoms.shapes {
            let known = wholes.iter().position(|whole| std::ptr::eq(whole.fourier(), shape.fourier));
            let index = known.unwrap_or_else(|| {
                wholes.push(Whole::new(shape.fourier, &mut self.factors));
                wholes.len() - 1
            });
            self.bases.push(wholes[index].base(shape.order, atoms.largest_exponent, &mut self.factors));
        }
        for part in &atoms.parts {
            let mut symbols = K::one(self.symbol_layout);
            for &(symbol, exponent) in &atoms.powers[part.powers.0..part.powers.1] {
                symbols.add(&K::variable(self.symbol_layout, symbol), i64::from(exponent));
            }
            let shapes = K::one(self.shape_layout);
            let shapes = part.shape.map_or(shapes, |shape| K::variable(self.shape_layout, shape));
            self.parts.push(Product { symbols, shapes, factor: part.factor.clone() });
        }
    }

    /// Writes the terms of one row and column as products of symbols and shapes, grouped by the symbols.
    pub(super) fn collect(
        &mut self,
        equation: usize,
        terms: &[Term],
        options: &mut ExpandOptions<'_>,
    ) -> Result<(), ExpandError> {
        let (Some(source), column) = (terms.first().map(|term| term.source), terms.first().and_then(|t| t.column))
        else {
            return Ok(());
        };
        let common = common_denominator(terms);
        let mut products = std::mem::take(&mut self.products);
        products.clear();
        for term in terms {
            let factor = numerator_over(&term.coefficient, common.as_ref());
            self.append_products(term, factor, &mut products);
            if terms.len() > 1 {
                options.report(0, 1, term.source)?;
            }
        }
        merge(&mut products);
        let common = common.map(|common| {
            let denominator = match common {
                Scalar::Small(common) => self.factors.factor_word(common.unsigned_abs()),
                Scalar::Big(common) => self.factors.factor(common.magnitude()),
            };
            self.common_bits = self.common_bits.max(self.factors.bits(&denominator));
            self.common.push(denominator);
            u32::try_from(self.common.len() - 1).expect("invariant: fewer than 2^32 columns")
        });
        let place = Place { equation, column, common, term: source };
        if let [only] = products.as_slice() {
            let (pi, powers) = self.powers_of(&only.symbols);
            self.add_group(place, pi, powers, std::slice::from_ref(only));
        } else {
            let mut parts: SmallVec<[PowersPart<'_, K>; 4]> = SmallVec::new();
            for same in products.chunk_by(|a, b| a.symbols == b.symbols) {
                let (pi, powers) = self.powers_of(&same[0].symbols);
                parts.push((pi, powers, same));
            }
            // The order of the table differs from that of the packed exponents.
            parts.sort_unstable_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
            for (pi, powers, same) in parts {
                self.add_group(place, pi, powers, same);
            }
        }
        self.products = products;
        Ok(())
    }

    /// Adds the products of one column that have the same symbols.
    fn add_group(&mut self, place: Place, pi: i32, powers: Monomial<usize>, same: &[Product<K>]) {
        let mut sum = None;
        if same.len() > 1 {
            let mut denominator = self.denominator(&same[0].shapes);
            for product in &same[1..] {
                denominator.join(&self.denominator(&product.shapes));
            }
            self.sums.push(Sum { denominator, pending: same.len(), spectrum: Spectrum::zero() });
            sum = Some(u32::try_from(self.sums.len() - 1).expect("invariant: fewer than 2^32 columns"));
        }
        let group = self.groups.len();
        self.groups.push(Group { common: place.common, sum, term: place.term });
        for product in same {
            self.factor_bits = self.factor_bits.max(product.factor.bits());
            let (shapes, factor) = (product.shapes.clone(), product.factor.clone());
            self.contributions.push(Contribution { shapes, group, factor });
        }
        self.series.push(CoefficientSeries {
            equation: place.equation,
            column: place.column,
            pi,
            powers,
            sign: None,
            first: 0,
            stride: 1,
            len: 0,
            cos: false,
            sin: false,
            numerator_words: 1,
            denominator_words: 1,
            start: 0,
        });
    }

    fn append_products(&mut self, term: &Term, factor: Scalar, products: &mut Vec<Product<K>>) {
        let start = products.len();
        products.push(Product { symbols: K::one(self.symbol_layout), shapes: K::one(self.shape_layout), factor });
        for (&atom, exponent) in term.atoms.factors() {
            let index = self.atoms.index[atom.index()] as usize;
            let Atom { start: first, end, .. } = self.atoms.list[index];
            if let [part] = &self.parts[first..end] {
                let times = i64::from(exponent);
                for product in &mut products[start..] {
                    product.symbols.add(&part.symbols, times);
                    product.shapes.add(&part.shapes, times);
                    if !part.factor.is_one() {
                        product.factor = product.factor.times(&part.factor.power(exponent.unsigned_abs()));
                    }
                }
            } else {
                self.extend_powers(index, exponent.unsigned_abs());
                let power = &self.powers[index][exponent.unsigned_abs() as usize];
                self.scratch.clear();
                for left in &products[start..] {
                    self.scratch.extend(power.iter().map(|right| left.times(right)));
                }
                products.truncate(start);
                products.append(&mut self.scratch);
            }
        }
    }

    /// Computes the powers up to `exponent` of an atom with no part or several parts.
    fn extend_powers(&mut self, index: usize, exponent: u32) {
        let powers = &mut self.powers[index];
        if powers.is_empty() {
            powers.push(vec![Product {
                symbols: K::one(self.symbol_layout),
                shapes: K::one(self.shape_layout),
                factor: Scalar::ONE,
            }]);
        }
        while powers.len() <= exponent as usize {
            let last = powers.last().expect("invariant: the power 0 is there");
            let Atom { start, end, .. } = self.atoms.list[index];
            let mut next = Vec::with_capacity(last.len() * (end - start));
            for left in last {
                next.extend(self.parts[start..end].iter().map(|right| left.times(right)));
            }
            merge(&mut next);
            powers.push(next);
        }
    }

    fn denominator(&self, shapes: &K) -> Denominator {
        let mut result = Denominator::default();
        shapes.exponents(self.shape_layout, |shape, exponent| {
            if exponent > 0 {
                result.multiply(self.bases[shape].denominator(), exponent as u32);
            }
        });
        result
    }

    /// The power of pi, and those of the model's symbols.
    fn powers_of(&self, symbols: &K) -> (i32, Monomial<usize>) {
        let mut pi = 0;
        let mut factors = Factorisation::new();
        symbols.exponents(self.symbol_layout, |symbol, exponent| {
            let exponent = i32::try_from(exponent).expect("invariant: refused when the exponents became too large");
            match self.atoms.symbols[symbol] {
                PI => pi = exponent,
                _ if exponent == 0 => {}
                symbol => factors.push((symbol, exponent)),
            }
        });
        (pi, Monomial::from_sorted(factors))
    }
}
