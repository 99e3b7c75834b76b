//! Expansion of a model under a trajectory pattern into its harmonic coefficient table (Feng, Eqns 3.13-3.17).
//!
//! Under the pattern every coordinate is a sum of amplitudes times Fourier polynomials, its *shapes*:
//!
//! ```text
//! q = sum_s m_s F_s(w t) ,      q^(n) = w^n sum_s m_s F_s^(n) .
//! ```
//!
//! Each regressor, a polynomial in the q^(n), is first written as a polynomial in the m_s, in w and in the F_s^(n); there
//! everything that cancels symbolically cancels, such as the offset in (q - q0)^k with q = q0 + a F. Then every product of
//! shapes that is left is multiplied out once, whichever columns and amplitudes it belongs to, and all its harmonics go
//! into the table in one pass, none dropped.
//!
//! Invariants: a product of shapes is reached from a shorter one by one factor, in the order of the packed exponents, so
//! that only the products on the way to the present one are kept; numerators stand over one denominator, known in
//! factored form from the factors'; the width of the numerators follows from a bound that is exact for the product before
//! the last factor.

use crate::denominator::{Denominator, Factors, Reduction};
use crate::expr::{Coordinate, ExprId, Node, Symbol};
use crate::fourier::Fourier;
use crate::model::{Kind, Model, TermId};
use crate::nonsmooth::{self, SignError};
use crate::numerator::{Numerator, Scalar, for_width};
use crate::packed::{Key, Layout, LongKey};
use crate::pattern::Pattern;
use crate::polynomial::Monomial;
use crate::rational;
use crate::regressor::{RegressorForm, Term};
use crate::spectrum::{Base, Spectrum};
use crate::table::{HarmonicTable, Series};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::One;
use smallvec::{SmallVec, smallvec};
use std::borrow::Cow;
use std::ops::ControlFlow;
use thiserror::Error;

/// Why a model does not expand.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ExpandError {
    /// A coordinate of the equations is not in the pattern.
    #[error("the coordinate `{coordinate}` has no motion in the pattern; give it one, or eliminate it")]
    NoMotion {
        /// Where it occurs.
        term: TermId,
        /// The coordinate.
        coordinate: String,
    },
    /// A term is not a finite Fourier series.
    #[error(
        "`{atom}` does not expand into finitely many harmonics under the pattern; declare a Taylor series for it, or use the model with logs, which need no expansion"
    )]
    NotFinite {
        /// Where it occurs.
        term: TermId,
        /// The function or quotient.
        atom: String,
    },
    /// The table, or what must be held to compute it, would be larger than the limit.
    #[error(
        "the table would have up to {entries} entries and take about {} MB, more than the limit of {} MB; lower the order, or allow large tables",
        (*bytes).div_ceil(1_000_000),
        limit / 1_000_000
    )]
    TooLarge {
        /// The term that contributes most.
        term: TermId,
        /// An upper bound of the number of entries, or of the symbolic products on the way to them.
        entries: u128,
        /// An upper bound of the memory in bytes.
        bytes: u128,
        /// The limit in bytes.
        limit: u128,
    },
    /// A sign or an absolute value has no exact series under the pattern.
    #[error("{source}")]
    Sign {
        /// Where it occurs.
        term: TermId,
        /// Why.
        source: SignError,
    },
    /// The progress callback said to stop.
    #[error("the expansion was stopped")]
    Stopped {
        /// The term that was being expanded.
        term: TermId,
    },
}

impl ExpandError {
    /// The source term at fault.
    #[must_use]
    pub fn term(&self) -> TermId {
        match self {
            Self::NoMotion { term, .. }
            | Self::NotFinite { term, .. }
            | Self::TooLarge { term, .. }
            | Self::Sign { term, .. }
            | Self::Stopped { term } => *term,
        }
    }
}

/// How far an expansion has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Steps done.
    pub done: usize,
    /// Steps in all; they take differently long.
    pub total: usize,
}

/// Options of [`expand_with`].
#[derive(Default)]
pub struct ExpandOptions<'a> {
    /// Expand even when the table would pass [`ExpandOptions::DEFAULT_LIMIT`]. What no machine can address is refused
    /// all the same.
    pub allow_large: bool,
    /// Called many times a second during long expansions; [`ControlFlow::Break`] ends the expansion.
    pub progress: Option<&'a mut dyn FnMut(Progress) -> ControlFlow<()>>,
    /// The highest harmonic kept of terms that have infinitely many (signs and absolute values);
    /// [`nonsmooth::DEFAULT_HARMONICS`] when not given. Terms that have finitely many keep them all.
    pub harmonics: Option<usize>,
}

impl ExpandOptions<'_> {
    /// Tables estimated larger than this many bytes are refused unless `allow_large` is set: 256 MB, about two million
    /// entries of ordinary size.
    pub const DEFAULT_LIMIT: u128 = 256_000_000;

    /// What is refused always: beyond the memory of machines.
    pub(crate) const ADDRESSABLE: u128 = 1 << 46;
}

/// Expands a model in regressor form under a pattern, within the default limits.
///
/// # Errors
/// When a coordinate has no motion, a term does not expand finitely, or the table would be too large; nothing is dropped.
pub fn expand(model: &Model, form: &RegressorForm, pattern: &Pattern) -> Result<HarmonicTable, ExpandError> {
    expand_with(model, form, pattern, &mut ExpandOptions::default())
}

/// Expands a model in regressor form under a pattern.
///
/// # Errors
/// When a coordinate has no motion, a term does not expand finitely, the table would be too large and large ones are not
/// allowed, or the progress callback says to stop; nothing is dropped.
pub fn expand_with(
    model: &Model,
    form: &RegressorForm,
    pattern: &Pattern,
    options: &mut ExpandOptions<'_>,
) -> Result<HarmonicTable, ExpandError> {
    if let Some((finite, infinite)) = nonsmooth::split(model, form) {
        let (entries, tails) = nonsmooth::expand(model, &infinite, pattern, options)?;
        return Ok(expand_with(model, &finite, pattern, options)?.with_infinite(entries, tails));
    }
    let atoms = Atoms::resolve(model, form, pattern)?;
    atoms.refuse_too_many_products(options)?;
    let shapes = Layout::new(atoms.shapes.len(), atoms.largest_exponent);
    let symbols = Layout::new(atoms.symbols.len(), atoms.largest_exponent);
    match shapes.key_bits().max(symbols.key_bits()) {
        0..=64 => Expansion::<u64>::new(model, form, &atoms, shapes, symbols).run(options),
        65..=128 => Expansion::<u128>::new(model, form, &atoms, shapes, symbols).run(options),
        _ => Expansion::<LongKey>::new(model, form, &atoms, shapes, symbols).run(options),
    }
}

/// One part of what an atom becomes under the pattern: factor * symbols * shape.
#[derive(Clone, Debug)]
struct Part {
    factor: Scalar,
    /// By index into [`Atoms::symbols`].
    symbols: SmallVec<[(usize, i32); 4]>,
    /// By index into [`Atoms::shapes`].
    shape: Option<usize>,
}

/// A phase derivative of a Fourier polynomial of the pattern.
#[derive(Clone, Copy, Debug)]
struct Shape<'a> {
    fourier: &'a Fourier,
    order: u32,
    /// The highest exponent it occurs with.
    largest: u64,
}

/// What stands for a power of pi among the symbols.
const PI: usize = usize::MAX;

/// All atoms of a regressor form, as sums of parts.
struct Atoms<'a> {
    parts: Vec<Vec<Part>>,
    /// Index into `parts` of every node of the graph that occurs.
    index: Vec<u32>,
    /// Model symbols that occur in parts, and [`PI`].
    symbols: Vec<usize>,
    shapes: Vec<Shape<'a>>,
    /// No exponent of a symbol or shape in any product is larger.
    largest_exponent: u64,
    /// An upper bound of the number of symbolic products, and the term with most.
    products: f64,
    worst: Option<(f64, TermId)>,
}

const UNRESOLVED: u32 = u32::MAX;

impl<'a> Atoms<'a> {
    fn resolve(model: &Model, form: &RegressorForm, pattern: &'a Pattern) -> Result<Self, ExpandError> {
        let mut atoms = Self {
            parts: Vec::new(),
            index: vec![UNRESOLVED; model.graph.len()],
            symbols: Vec::new(),
            shapes: Vec::new(),
            largest_exponent: 0,
            products: 0.0,
            worst: None,
        };
        for term in form.rows.iter().flat_map(|row| &row.terms) {
            let (mut largest, mut products) = (0u64, 1.0);
            for (&atom, exponent) in term.atoms.factors() {
                if atoms.index[atom.index()] == UNRESOLVED {
                    let parts = atoms.parts_of(model, pattern, atom, term.source)?;
                    atoms.index[atom.index()] = u32::try_from(atoms.parts.len()).expect("invariant: ids fit in u32");
                    atoms.parts.push(parts);
                }
                let parts = &atoms.parts[atoms.index[atom.index()] as usize];
                let magnitude = u64::from(exponent.unsigned_abs());
                if exponent < 0 && (parts.len() != 1 || parts[0].shape.is_some() || !parts[0].factor.is_one()) {
                    return Err(ExpandError::NotFinite { term: term.source, atom: model.display(atom) });
                }
                let exponents =
                    parts.iter().map(|part| part.symbols.iter().map(|(_, e)| u64::from(e.unsigned_abs())).sum::<u64>());
                let highest = exponents.max().unwrap_or(0).max(1);
                largest = largest.saturating_add(highest.saturating_mul(magnitude));
                // The number of monomials of degree `magnitude` in the parts.
                for i in 1..parts.len() {
                    products *= (magnitude as f64 + i as f64) / i as f64;
                }
                if parts.is_empty() {
                    products = 0.0;
                }
                for part in parts {
                    if let Some(shape) = part.shape {
                        atoms.shapes[shape].largest = atoms.shapes[shape].largest.saturating_add(magnitude);
                    }
                }
            }
            if largest > i32::MAX as u64 {
                // Such a power is beyond every limit, whatever its base.
                let bytes = u128::from(largest) * u128::from(largest);
                let limit = ExpandOptions::ADDRESSABLE;
                return Err(ExpandError::TooLarge { term: term.source, entries: largest.into(), bytes, limit });
            }
            atoms.largest_exponent = atoms.largest_exponent.max(largest);
            atoms.products += products;
            if atoms.worst.is_none_or(|(worst, _)| worst < products) {
                atoms.worst = Some((products, term.source));
            }
        }
        atoms.sort_shapes();
        atoms.sort_symbols();
        Ok(atoms)
    }

    /// In the model's order, so that powers come out sorted.
    fn sort_symbols(&mut self) {
        if self.symbols.is_sorted() {
            return;
        }
        let before = std::mem::take(&mut self.symbols);
        self.symbols.clone_from(&before);
        self.symbols.sort_unstable();
        for (symbol, _) in self.parts.iter_mut().flatten().flat_map(|part| &mut part.symbols) {
            *symbol = self.symbols.partition_point(|&other| other < before[*symbol]);
        }
    }

    /// The last shape is multiplied first: those that occur most come early on the way to all products.
    fn sort_shapes(&mut self) {
        if self.shapes.is_sorted_by_key(|shape| shape.largest) {
            return;
        }
        let mut order: Vec<usize> = (0..self.shapes.len()).collect();
        order.sort_by_key(|&i| self.shapes[i].largest);
        let mut place = vec![0; order.len()];
        for (new, &old) in order.iter().enumerate() {
            place[old] = new;
        }
        self.shapes = order.iter().map(|&i| self.shapes[i]).collect();
        for shape in self.parts.iter_mut().flatten().filter_map(|part| part.shape.as_mut()) {
            *shape = place[*shape];
        }
    }

    fn symbol(&mut self, symbol: usize) -> usize {
        self.symbols.iter().position(|&present| present == symbol).unwrap_or_else(|| {
            self.symbols.push(symbol);
            self.symbols.len() - 1
        })
    }

    fn shape(&mut self, fourier: &'a Fourier, order: u32) -> usize {
        let same = |shape: &Shape<'_>| {
            shape.order == order && (std::ptr::eq(shape.fourier, fourier) || shape.fourier == fourier)
        };
        self.shapes.iter().position(same).unwrap_or_else(|| {
            self.shapes.push(Shape { fourier, order, largest: 0 });
            self.shapes.len() - 1
        })
    }

    fn parts_of(
        &mut self,
        model: &Model,
        pattern: &'a Pattern,
        atom: ExprId,
        term: TermId,
    ) -> Result<Vec<Part>, ExpandError> {
        let constant = |symbol| vec![Part { factor: Scalar::ONE, symbols: smallvec![(symbol, 1)], shape: None }];
        match *model.graph.node(atom) {
            Node::Pi => Ok(constant(self.symbol(PI))),
            Node::Symbol(symbol) if is_constant(model, symbol) => Ok(constant(self.symbol(symbol.0 as usize))),
            Node::Derivative(coordinate, order) => self.motion(model, pattern, coordinate, order, term),
            _ => Err(ExpandError::NotFinite { term, atom: model.display(atom) }),
        }
    }

    fn motion(
        &mut self,
        model: &Model,
        pattern: &'a Pattern,
        coordinate: Coordinate,
        order: u32,
        term: TermId,
    ) -> Result<Vec<Part>, ExpandError> {
        let motion = pattern.motions.get(coordinate.0 as usize).and_then(Option::as_ref).ok_or_else(|| {
            ExpandError::NoMotion { term, coordinate: model.coordinates[coordinate.0 as usize].name.clone() }
        })?;
        let mut parts = Vec::with_capacity(motion.terms().len());
        for (monomial, fourier) in motion.terms() {
            let constant = fourier.highest_harmonic() == 0;
            if fourier.is_zero() || (constant && order > 0) {
                continue;
            }
            // A whole number is kept out of the shapes, so that offsets cancel before anything is multiplied out.
            let value = constant.then(|| fourier.cos_coefficient(0)).filter(rational::is_integer);
            let mut symbols: SmallVec<[(usize, i32); 4]> =
                monomial.factors().map(|(symbol, e)| (self.symbol(symbol.0 as usize), e)).collect();
            if order > 0 {
                let exponent = i32::try_from(order).expect("invariant: derivative orders are small");
                symbols.push((self.symbol(pattern.frequency.0 as usize), exponent));
            }
            parts.push(match value {
                Some(value) => Part { factor: Scalar::from_big(value.numer()), symbols, shape: None },
                None => Part { factor: Scalar::ONE, symbols, shape: Some(self.shape(fourier, order)) },
            });
        }
        Ok(parts)
    }

    fn refuse_too_many_products(&self, options: &ExpandOptions<'_>) -> Result<(), ExpandError> {
        // Two keys and a factor.
        refuse_beyond(options, self.worst.map(|(_, term)| term), self.products, self.products * 64.0)
    }
}

fn is_constant(model: &Model, symbol: Symbol) -> bool {
    matches!(model.quantity(symbol).kind, Kind::Constant { .. } | Kind::Amplitude | Kind::Frequency)
}

fn refuse_beyond(
    options: &ExpandOptions<'_>,
    term: Option<TermId>,
    entries: f64,
    bytes: f64,
) -> Result<(), ExpandError> {
    let limit = if options.allow_large { ExpandOptions::ADDRESSABLE } else { ExpandOptions::DEFAULT_LIMIT };
    match term {
        Some(term) if bytes > limit as f64 => {
            Err(ExpandError::TooLarge { term, entries: entries as u128, bytes: bytes as u128, limit })
        }
        _ => Ok(()),
    }
}

/// factor * symbols * shapes.
#[derive(Clone)]
struct Product<K> {
    symbols: K,
    shapes: K,
    factor: Scalar,
}

/// Powers of pi and of the model's symbols, and the products that have them.
type PowersPart<'a, K> = (i32, Monomial<usize>, &'a [Product<K>]);

/// The entries of one row, column and product of symbols.
struct Group {
    /// The common denominator of the column's coefficients, when it is not 1: an index into [`Expansion::common`].
    common: Option<u32>,
    /// With several products of shapes: the common denominator of these.
    joined: Option<Box<Denominator>>,
    term: TermId,
    /// How many products of shapes are still to come.
    pending: usize,
    /// Their sum so far, when there is more than one.
    sum: Option<Spectrum>,
}

/// A product of shapes that goes into a group.
struct Contribution<K> {
    shapes: K,
    group: usize,
    factor: Scalar,
}

struct Expansion<'a, K> {
    model: &'a Model,
    form: &'a RegressorForm,
    atoms: &'a Atoms<'a>,
    shape_layout: Layout,
    symbol_layout: Layout,
    factors: Factors,
    bases: Vec<Base>,
    /// The parts of every atom, as products.
    parts: Vec<Vec<Product<K>>>,
    /// Powers of atoms with several parts, by atom and exponent.
    powers: Vec<Vec<Vec<Product<K>>>>,
    /// Common denominators of columns.
    common: Vec<Denominator>,
    /// The products of the column at hand, and room to multiply them.
    products: Vec<Product<K>>,
    scratch: Vec<Product<K>>,
    groups: Vec<Group>,
    contributions: Vec<Contribution<K>>,
    series: Vec<Series>,
    words: Vec<u64>,
    entries: usize,
}

impl<'a, K: Key> Expansion<'a, K> {
    fn new(
        model: &'a Model,
        form: &'a RegressorForm,
        atoms: &'a Atoms<'a>,
        shape_layout: Layout,
        symbol_layout: Layout,
    ) -> Self {
        let mut factors = Factors::default();
        let bases = atoms.shapes.iter().map(|shape| Base::new(shape.fourier, shape.order, &mut factors)).collect();
        let parts: Vec<Vec<Product<K>>> = atoms
            .parts
            .iter()
            .map(|parts| {
                let product = |part: &Part| {
                    let mut symbols = K::one(symbol_layout);
                    for &(symbol, exponent) in &part.symbols {
                        symbols.add(&K::variable(symbol_layout, symbol), i64::from(exponent));
                    }
                    let shapes = part.shape.map_or_else(|| K::one(shape_layout), |s| K::variable(shape_layout, s));
                    Product { symbols, shapes, factor: part.factor.clone() }
                };
                parts.iter().map(product).collect()
            })
            .collect();
        let powers = vec![Vec::new(); parts.len()];
        let terms = form.rows.iter().map(|row| row.terms.len()).sum();
        Self {
            model,
            form,
            atoms,
            shape_layout,
            symbol_layout,
            factors,
            bases,
            parts,
            powers,
            common: Vec::new(),
            products: Vec::new(),
            scratch: Vec::new(),
            groups: Vec::with_capacity(terms),
            contributions: Vec::with_capacity(terms),
            series: Vec::with_capacity(terms),
            words: Vec::new(),
            entries: 0,
        }
    }

    fn run(mut self, options: &mut ExpandOptions<'_>) -> Result<HarmonicTable, ExpandError> {
        let form = self.form;
        for (equation, row) in form.rows.iter().enumerate() {
            let mut terms = Cow::Borrowed(row.terms.as_slice());
            if !terms.is_sorted_by_key(|term| term.column) {
                terms.to_mut().sort_by_key(|term| term.column);
            }
            for column in terms.chunk_by(|a, b| a.column == b.column) {
                self.collect(equation, column, options)?;
            }
        }
        self.refuse_too_large(options)?;
        self.multiply_out(options)?;
        let names = [
            form.rows.iter().map(|row| row.name.clone()).collect(),
            form.columns.iter().map(|column| column.name.clone()).collect(),
            self.model.symbols.iter().map(|quantity| quantity.name.clone()).collect(),
        ];
        self.series.retain(|series| series.len > 0);
        Ok(HarmonicTable::from_series(self.model.name.clone(), names, self.series, self.words, self.entries))
    }

    /// Writes the terms of one row and column as products of symbols and shapes, grouped by the symbols.
    fn collect(&mut self, equation: usize, terms: &[Term], options: &mut ExpandOptions<'_>) -> Result<(), ExpandError> {
        let (Some(source), column) = (terms.first().map(|term| term.source), terms.first().and_then(|t| t.column))
        else {
            return Ok(());
        };
        let common = common_denominator(terms);
        let mut products = std::mem::take(&mut self.products);
        products.clear();
        for term in terms {
            let factor = match &common {
                None => Scalar::from_big(term.coefficient.numer()),
                Some(common) => Scalar::from_big(&(term.coefficient.numer() * (common / term.coefficient.denom()))),
            };
            self.append_products(term, factor, &mut products);
            if terms.len() > 1 {
                self.report(options, 0, 1, term.source)?;
            }
        }
        merge(&mut products);
        let common = common.map(|common| {
            let denominator = self.factors.factor(common.magnitude());
            self.common.push(denominator);
            u32::try_from(self.common.len() - 1).expect("invariant: fewer than 2^32 columns")
        });
        let mut parts: SmallVec<[PowersPart<'_, K>; 1]> = SmallVec::new();
        for same in products.chunk_by(|a, b| a.symbols == b.symbols) {
            let (pi, powers) = self.powers_of(&same[0].symbols);
            parts.push((pi, powers, same));
        }
        // In the order of the table, which is not that of the packed exponents.
        parts.sort_unstable_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
        for (pi, powers, same) in parts {
            let mut joined = None;
            if same.len() > 1 {
                let mut denominator = self.denominator(&same[0].shapes);
                for product in &same[1..] {
                    denominator.join(&self.denominator(&product.shapes));
                }
                joined = Some(Box::new(denominator));
            }
            let group = self.groups.len();
            self.groups.push(Group { common, joined, term: source, pending: same.len(), sum: None });
            self.contributions.extend(same.iter().map(|product| Contribution {
                shapes: product.shapes.clone(),
                group,
                factor: product.factor.clone(),
            }));
            self.series.push(Series {
                equation,
                column,
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
        self.products = products;
        Ok(())
    }

    fn append_products(&mut self, term: &Term, factor: Scalar, products: &mut Vec<Product<K>>) {
        let start = products.len();
        products.push(Product { symbols: K::one(self.symbol_layout), shapes: K::one(self.shape_layout), factor });
        for (&atom, exponent) in term.atoms.factors() {
            let index = self.atoms.index[atom.index()] as usize;
            if let [part] = self.parts[index].as_slice() {
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

    /// Makes the powers of an atom with no or several parts known up to `exponent`.
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
            let mut next = Vec::with_capacity(last.len() + 1);
            for left in last {
                next.extend(self.parts[index].iter().map(|right| left.times(right)));
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
        let mut factors: SmallVec<[(usize, i32); 8]> = SmallVec::new();
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

    /// Estimates the table from the bounds of its numerators and denominators.
    fn refuse_too_large(&mut self, options: &ExpandOptions<'_>) -> Result<(), ExpandError> {
        let (mut entries, mut bytes) = (0.0, 0.0);
        let mut worst: Option<(f64, TermId)> = None;
        for contribution in &self.contributions {
            let (mut highest, mut bits, mut below) = (0.0, contribution.factor.bits() as f64, 0.0);
            let (mut mixed, mut both) = (false, false);
            contribution.shapes.exponents(self.shape_layout, |shape, exponent| {
                if exponent > 0 {
                    let (base, exponent) = (&self.bases[shape], exponent as f64);
                    highest += exponent * base.highest_harmonic() as f64;
                    bits += exponent * base.norm_bits() as f64;
                    below += exponent * base.denominator_bits() as f64;
                    mixed |= base.parity().is_none();
                    both |= base.functions() == (true, true);
                }
            });
            let group = &self.groups[contribution.group];
            if let Some(common) = group.common {
                below += self.factors.bits(&self.common[common as usize]) as f64;
            }
            // Harmonics of one parity, cosines or sines alone: as the factors have them.
            let harmonics = if mixed { highest + 1.0 } else { highest * 0.5 + 1.0 };
            let count = if both { harmonics * 2.0 } else { harmonics };
            let words = (bits + below) / 64.0 + 2.0;
            // Exponents of primes are counted in 32 bits; beyond that no limit is wide enough.
            let size = if below < f64::from(u32::MAX) { count * words * 8.0 } else { f64::INFINITY };
            entries += count;
            bytes += size;
            if worst.is_none_or(|(worst, _)| worst < size) {
                worst = Some((size, group.term));
            }
        }
        refuse_beyond(options, worst.map(|(_, term)| term), entries, bytes)?;
        // Memory that is not written is not taken, so the whole estimate may be asked for while it is moderate.
        self.words.reserve((bytes / 8.0).min(1e6) as usize);
        Ok(())
    }

    fn report(
        &self,
        options: &mut ExpandOptions<'_>,
        done: usize,
        total: usize,
        term: TermId,
    ) -> Result<(), ExpandError> {
        let stop = options.progress.as_mut().is_some_and(|progress| progress(Progress { done, total }).is_break());
        if stop { Err(ExpandError::Stopped { term }) } else { Ok(()) }
    }

    /// Multiplies out every product of shapes once.
    fn multiply_out(&mut self, options: &mut ExpandOptions<'_>) -> Result<(), ExpandError> {
        let mut contributions = std::mem::take(&mut self.contributions);
        contributions.sort_unstable_by(|a, b| (&a.shapes, a.group).cmp(&(&b.shapes, b.group)));
        let total = contributions.len();
        let count = self.shape_layout.variables;
        // The product so far and its exponents; `path` holds the products on the way to it, the empty one first.
        let mut present = vec![0i64; count];
        let mut path = vec![(Spectrum::one(), Denominator::default())];
        let mut exponents = vec![0i64; count];
        for (done, contribution) in contributions.iter().enumerate() {
            contribution.shapes.exponents(self.shape_layout, |shape, exponent| exponents[shape] = exponent);
            if let Some(differs) = (0..count).rev().find(|&shape| present[shape] != exponents[shape]) {
                let above: i64 = exponents[differs + 1..].iter().sum();
                let kept = above + present[differs].min(exponents[differs]);
                path.truncate(kept as usize + 1);
                for shape in (0..=differs).rev() {
                    let already = if shape == differs { present[differs].min(exponents[differs]) } else { 0 };
                    for _ in already..exponents[shape] {
                        let (spectrum, denominator) = path.last().expect("invariant: the empty product is there");
                        let mut denominator = denominator.clone();
                        denominator.multiply(self.bases[shape].denominator(), 1);
                        path.push((spectrum.multiply(&self.bases[shape]), denominator));
                        self.report(options, done, total, self.groups[contribution.group].term)?;
                    }
                }
                present.copy_from_slice(&exponents);
            }
            let (spectrum, denominator) = path.last().expect("invariant: the empty product is there");
            self.contribute(contribution, spectrum, denominator);
        }
        Ok(())
    }

    fn contribute(&mut self, contribution: &Contribution<K>, spectrum: &Spectrum, denominator: &Denominator) {
        let index = contribution.group;
        let group = &mut self.groups[index];
        let Some(joined) = &group.joined else {
            return self.finish(index, spectrum, denominator, &contribution.factor);
        };
        let scale = self.factors.quotient(joined, denominator);
        let sum = group.sum.get_or_insert_with(|| Spectrum::zero_like(spectrum));
        sum.add_scaled(spectrum, &scale.times(&contribution.factor));
        group.pending -= 1;
        if group.pending == 0
            && let (Some(sum), Some(joined)) = (group.sum.take(), group.joined.take())
        {
            self.finish(index, &sum, &joined, &Scalar::ONE);
        }
    }

    /// Reduces a group's coefficients to lowest terms and stores them.
    fn finish(&mut self, index: usize, spectrum: &Spectrum, denominator: &Denominator, factor: &Scalar) {
        let with_common;
        let denominator = match self.groups[index].common {
            None => denominator,
            Some(common) => {
                let mut product = denominator.clone();
                product.multiply(&self.common[common as usize], 1);
                with_common = product;
                &with_common
            }
        };
        let reduction = self.factors.reduction(denominator);
        let bits = spectrum.bits() + if factor.is_one() { 0 } else { factor.bits() };
        let bits = bits + u64::from(!reduction.is_even());
        let series = &mut self.series[index];
        series.first = spectrum.first();
        series.stride = spectrum.stride();
        series.len = spectrum.len();
        series.cos = spectrum.has_cos();
        series.sin = spectrum.has_sin();
        series.numerator_words = (bits / 64 + 1) as usize;
        series.denominator_words = reduction.words();
        series.start = self.words.len();
        let wide;
        let needed = if matches!(factor, Scalar::Big(_)) { u64::MAX } else { bits };
        let values = if spectrum.values().capacity() < needed {
            wide = spectrum.values().widened(needed);
            &wide
        } else {
            spectrum.values()
        };
        let count = for_width!(values, list => store(list, series, factor, &reduction, &mut self.words));
        if count == 0 {
            self.words.truncate(series.start);
            series.len = 0;
        }
        self.entries += count;
    }
}

/// Appends the coefficients factor * values / denominator and counts those that are not zero.
///
/// The coefficient of cos(k theta) and sin(k theta), k >= 1, is twice that of e^{j k theta}: half the denominator when it
/// is even, otherwise twice the numerator.
fn store<T: Numerator>(
    values: &[T],
    series: &Series,
    factor: &Scalar,
    reduction: &Reduction<'_>,
    out: &mut Vec<u64>,
) -> usize {
    let mut count = 0;
    let size = series.numerator_words + series.denominator_words;
    let start = out.len();
    out.resize(start + values.len() * size, 0);
    let mut slots = out[start..].chunks_exact_mut(size);
    for part in values.chunks(series.len) {
        for ((i, value), slot) in part.iter().enumerate().zip(&mut slots) {
            if value.is_zero() {
                continue;
            }
            count += 1;
            let constant = series.first + i == 0;
            let halvings = u32::from(reduction.is_even() && !constant);
            let double = !reduction.is_even() && !constant;
            match factor {
                Scalar::Small(1) if !double => reduction.write(value, halvings, slot),
                Scalar::Small(factor) => {
                    let scaled = value.times(*factor);
                    reduction.write(&if double { scaled.times(2) } else { scaled }, halvings, slot);
                }
                Scalar::Big(factor) => {
                    let scaled = value.to_big() * factor.as_ref();
                    reduction.write(&if double { scaled * 2 } else { scaled }, halvings, slot);
                }
            }
        }
    }
    count
}

impl<K: Key> Product<K> {
    fn times(&self, other: &Self) -> Self {
        let (mut symbols, mut shapes) = (self.symbols.clone(), self.shapes.clone());
        symbols.add(&other.symbols, 1);
        shapes.add(&other.shapes, 1);
        Self { symbols, shapes, factor: self.factor.times(&other.factor) }
    }
}

/// Sorts by symbols, then shapes, adds equal products and drops those that cancel.
fn merge<K: Key>(products: &mut Vec<Product<K>>) {
    if products.len() > 1 {
        products.sort_unstable_by(|a, b| (&a.symbols, &a.shapes).cmp(&(&b.symbols, &b.shapes)));
        products.dedup_by(|next, kept| {
            let same = next.symbols == kept.symbols && next.shapes == kept.shapes;
            if same {
                kept.factor = kept.factor.plus(&next.factor);
            }
            same
        });
    }
    products.retain(|product| !product.factor.is_zero());
}

/// The least common denominator of the terms' coefficients; `None` when it is 1.
fn common_denominator(terms: &[Term]) -> Option<BigInt> {
    let mut common: Option<BigInt> = None;
    for term in terms {
        let denominator = term.coefficient.denom();
        if !denominator.is_one() {
            common = Some(common.map_or_else(|| denominator.clone(), |common| common.lcm(denominator)));
        }
    }
    common
}
