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

use crate::algebra::fourier::Fourier;
use crate::algebra::packed::{Key, Layout, LongKey};
use crate::algebra::polynomial::{Factorisation, Monomial};
use crate::algebra::spectrum::{Base, Spectrum, Whole};
use crate::expr::graph::{Coordinate, ExprId, Node, Symbol};
use crate::harmonic::nonsmooth::{self, SignError};
use crate::harmonic::table::{HarmonicTable, Series};
use crate::mechanics::model::{Kind, Model, TermId};
use crate::mechanics::pattern::Pattern;
use crate::number::denominator::{Denominator, Factors, Reduction};
use crate::number::numerator::{Numerator, Rooms, Scalar, for_width};
use crate::number::rational::{self, Rational};
use crate::regressor::form::{RegressorForm, Term};
use num_integer::Integer;
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
    let mut atoms = Atoms::new();
    atoms.resolve(model, form, pattern)?;
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
    /// Its powers of symbols among all, from one index up to the next.
    powers: (usize, usize),
    /// The sum of their magnitudes.
    degree: u64,
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
    parts: SmallVec<[Part; 4]>,
    /// Powers of symbols in parts, by index into [`Atoms::symbols`].
    powers: SmallVec<[(usize, i32); 8]>,
    list: SmallVec<[Atom; 8]>,
    /// Index into `list` of every node of the graph that occurs.
    index: SmallVec<[u32; 64]>,
    /// Model symbols that occur in parts, and [`PI`].
    symbols: SmallVec<[usize; 8]>,
    shapes: SmallVec<[Shape<'a>; 4]>,
    /// No exponent of a symbol or shape in any product is larger.
    largest_exponent: u64,
    /// An upper bound of the number of symbolic products, and the term with most.
    products: f64,
    worst: Option<(f64, TermId)>,
}

const UNRESOLVED: u32 = u32::MAX;

/// An atom under the pattern.
#[derive(Clone, Copy, Debug)]
struct Atom {
    /// Its parts among all, from one index up to the next.
    start: usize,
    end: usize,
    /// The highest sum of exponents of symbols in a part, at least 1.
    highest: u64,
    /// Whether it may stand in a denominator: a single product of symbols.
    invertible: bool,
}

impl<'a> Atoms<'a> {
    fn new() -> Self {
        Self {
            parts: SmallVec::new(),
            powers: SmallVec::new(),
            list: SmallVec::new(),
            index: SmallVec::new(),
            symbols: SmallVec::new(),
            shapes: SmallVec::new(),
            largest_exponent: 0,
            products: 0.0,
            worst: None,
        }
    }

    /// Resolves all atoms that occur.
    fn resolve(&mut self, model: &Model, form: &RegressorForm, pattern: &'a Pattern) -> Result<(), ExpandError> {
        self.index.resize(model.graph.len(), UNRESOLVED);
        for term in form.rows.iter().flat_map(|row| &row.terms) {
            let (mut largest, mut products) = (0u64, 1.0);
            for (&id, exponent) in term.atoms.factors() {
                if self.index[id.index()] == UNRESOLVED {
                    self.add(model, pattern, id, term.source)?;
                }
                let atom = self.list[self.index[id.index()] as usize];
                let magnitude = u64::from(exponent.unsigned_abs());
                if exponent < 0 && !atom.invertible {
                    return Err(ExpandError::NotFinite { term: term.source, atom: model.display(id) });
                }
                largest = largest.saturating_add(atom.highest.saturating_mul(magnitude));
                // The number of monomials of degree `magnitude` in the parts.
                for i in 1..atom.end - atom.start {
                    products *= (magnitude as f64 + i as f64) / i as f64;
                }
                if atom.start == atom.end {
                    products = 0.0;
                }
                for part in &self.parts[atom.start..atom.end] {
                    if let Some(shape) = part.shape {
                        self.shapes[shape].largest = self.shapes[shape].largest.saturating_add(magnitude);
                    }
                }
            }
            if largest > i32::MAX as u64 {
                // Such a power is beyond every limit, whatever its base.
                let bytes = u128::from(largest) * u128::from(largest);
                let limit = ExpandOptions::ADDRESSABLE;
                return Err(ExpandError::TooLarge { term: term.source, entries: largest.into(), bytes, limit });
            }
            self.largest_exponent = self.largest_exponent.max(largest);
            self.products += products;
            if self.worst.is_none_or(|(worst, _)| worst < products) {
                self.worst = Some((products, term.source));
            }
        }
        self.sort_shapes();
        self.sort_symbols();
        Ok(())
    }

    /// In the model's order, so that powers come out sorted.
    fn sort_symbols(&mut self) {
        if self.symbols.is_sorted() {
            return;
        }
        let before = std::mem::take(&mut self.symbols);
        self.symbols.clone_from(&before);
        self.symbols.sort_unstable();
        for (symbol, _) in &mut self.powers {
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
        for shape in self.parts.iter_mut().filter_map(|part| part.shape.as_mut()) {
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

    /// Writes an atom as a sum of parts.
    fn add(&mut self, model: &Model, pattern: &'a Pattern, id: ExprId, term: TermId) -> Result<(), ExpandError> {
        let start = self.parts.len();
        match *model.graph.node(id) {
            Node::Pi => self.constant(PI),
            Node::Symbol(symbol) if is_constant(model, symbol) => self.constant(symbol.0 as usize),
            Node::Derivative(coordinate, order) => self.motion(model, pattern, coordinate, order, term)?,
            _ => return Err(ExpandError::NotFinite { term, atom: model.display(id) }),
        }
        let parts = &self.parts[start..];
        let highest = parts.iter().map(|part| part.degree).max().unwrap_or(0).max(1);
        let invertible = parts.len() == 1 && parts[0].shape.is_none() && parts[0].factor.is_one();
        self.index[id.index()] = u32::try_from(self.list.len()).expect("invariant: ids fit in u32");
        self.list.push(Atom { start, end: self.parts.len(), highest, invertible });
        Ok(())
    }

    fn constant(&mut self, symbol: usize) {
        let (power, start) = ((self.symbol(symbol), 1), self.powers.len());
        self.powers.push(power);
        self.parts.push(Part { factor: Scalar::ONE, powers: (start, start + 1), degree: 1, shape: None });
    }

    fn motion(
        &mut self,
        model: &Model,
        pattern: &'a Pattern,
        coordinate: Coordinate,
        order: u32,
        term: TermId,
    ) -> Result<(), ExpandError> {
        let motion = pattern.motions.get(coordinate.0 as usize).and_then(Option::as_ref).ok_or_else(|| {
            ExpandError::NoMotion { term, coordinate: model.coordinates[coordinate.0 as usize].name.clone() }
        })?;
        for (monomial, fourier) in motion.terms() {
            let constant = fourier.highest_harmonic() == 0;
            if fourier.is_zero() || (constant && order > 0) {
                continue;
            }
            let (start, mut degree) = (self.powers.len(), u64::from(order));
            for (symbol, exponent) in monomial.factors() {
                let symbol = self.symbol(symbol.0 as usize);
                self.powers.push((symbol, exponent));
                degree += u64::from(exponent.unsigned_abs());
            }
            if order > 0 {
                let exponent = i32::try_from(order).expect("invariant: derivative orders are small");
                let symbol = self.symbol(pattern.frequency.0 as usize);
                self.powers.push((symbol, exponent));
            }
            let powers = (start, self.powers.len());
            // A whole number is kept out of the shapes, so that offsets cancel before anything is multiplied out.
            let [value, _] = if constant { fourier.pair(0) } else { [None; 2] };
            let part = match value.filter(|value| rational::is_integer(value)) {
                Some(value) => Part { factor: numerator_of(value), powers, degree, shape: None },
                None => Part { factor: Scalar::ONE, powers, degree, shape: Some(self.shape(fourier, order)) },
            };
            self.parts.push(part);
        }
        Ok(())
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
    // Nearly every table is far below every limit, and 128 bits take long to become a float.
    if bytes <= 1e6 {
        return Ok(());
    }
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
    /// With several products of shapes: an index into [`Expansion::sums`].
    sum: Option<u32>,
    term: TermId,
}

/// A sum of several products of shapes.
struct Sum {
    /// The common denominator of the products.
    denominator: Denominator,
    /// How many are still to come.
    pending: usize,
    /// The sum so far.
    spectrum: Spectrum,
}

/// A product of shapes on the way to the present one.
struct Level {
    spectrum: Spectrum,
    denominator: Denominator,
}

/// What the groups of one column have in common.
#[derive(Clone, Copy)]
struct Place {
    equation: usize,
    column: Option<usize>,
    common: Option<u32>,
    term: TermId,
}

/// A product of shapes that goes into a group.
struct Contribution<K> {
    shapes: K,
    group: usize,
    factor: Scalar,
}

struct Expansion<'a, 'p, K> {
    model: &'a Model,
    form: &'a RegressorForm,
    atoms: &'a Atoms<'p>,
    shape_layout: Layout,
    symbol_layout: Layout,
    factors: Factors,
    bases: SmallVec<[Base; 4]>,
    /// The parts of all atoms, as products.
    parts: Vec<Product<K>>,
    /// Powers of atoms with several parts, by atom and exponent.
    powers: Vec<Vec<Vec<Product<K>>>>,
    /// Common denominators of columns.
    common: Vec<Denominator>,
    /// The products of the column at hand, and room to multiply them.
    products: Vec<Product<K>>,
    scratch: Vec<Product<K>>,
    groups: Vec<Group>,
    sums: Vec<Sum>,
    contributions: Vec<Contribution<K>>,
    /// Bits of the largest factor of a contribution, and of the largest common denominator of a column.
    factor_bits: u64,
    common_bits: u64,
    rooms: Rooms,
    series: Vec<Series>,
    words: Vec<u64>,
    entries: usize,
}

impl<'a, 'p, K: Key> Expansion<'a, 'p, K> {
    #[inline(always)]
    fn new(
        model: &'a Model,
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

    /// Shapes as factors and parts as products.
    fn prepare(&mut self) {
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

    fn run(&mut self, options: &mut ExpandOptions<'_>) -> Result<HarmonicTable, ExpandError> {
        self.prepare();
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
        let (series, words) = (std::mem::take(&mut self.series), std::mem::take(&mut self.words));
        Ok(HarmonicTable::from_series(self.model.name.as_str().into(), names, series, words, self.entries))
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
            let factor = numerator_over(&term.coefficient, common.as_ref());
            self.append_products(term, factor, &mut products);
            if terms.len() > 1 {
                self.report(options, 0, 1, term.source)?;
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
            // In the order of the table, which is not that of the packed exponents.
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
        self.series.push(Series {
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

    /// Estimates the table from the bounds of its numerators and denominators.
    fn refuse_too_large(&mut self, options: &ExpandOptions<'_>) -> Result<(), ExpandError> {
        let (reserved, small) = self.size_at_most();
        if small {
            self.words.reserve(reserved);
            return Ok(());
        }
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

    /// A quick bound of the table's words, from the largest base and the largest exponents, and whether it settles that
    /// the table is far below every limit.
    fn size_at_most(&self) -> (usize, bool) {
        let highest = self.bases.iter().map(Base::highest_harmonic).max().unwrap_or(0) as f64;
        let bits = self.bases.iter().map(|base| base.norm_bits() + base.denominator_bits()).max().unwrap_or(0);
        let degree = self.atoms.largest_exponent as f64;
        let words = (degree * bits as f64 + (self.factor_bits + self.common_bits) as f64) / 64.0 + 2.0;
        let entries = self.contributions.len() as f64 * 2.0 * (degree * highest + 1.0);
        // Half of the harmonics are of the other parity, and one of cosine and sine is mostly missing.
        ((entries * words / 4.0) as usize, entries * words < 3e4)
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
        // The exponents of the product so far; the first `depth + 1` levels are the products on the way to it, the empty
        // one first.
        let mut present: SmallVec<[i64; 8]> = smallvec![0; count];
        let mut exponents = present.clone();
        let (present, exponents) = (present.as_mut_slice(), exponents.as_mut_slice());
        let mut levels: Vec<Level> = Vec::with_capacity(4);
        // What comes first is the empty product, when there is one.
        let constant = contributions.first().is_some_and(|first| first.shapes == K::one(self.shape_layout));
        let spectrum = if constant { Spectrum::one() } else { Spectrum::factor_one() };
        levels.push(Level { spectrum, denominator: Denominator::default() });
        let mut depth = 0;
        for (done, contribution) in contributions.iter().enumerate() {
            let same = done > 0 && contributions[done - 1].shapes == contribution.shapes;
            if !same {
                exponents.fill(0);
                contribution.shapes.exponents(self.shape_layout, |shape, exponent| exponents[shape] = exponent);
            }
            if !same && let Some(differs) = (0..count).rev().find(|&shape| present[shape] != exponents[shape]) {
                let above: i64 = exponents[differs + 1..].iter().sum();
                depth = (above + present[differs].min(exponents[differs])) as usize;
                for shape in (0..=differs).rev() {
                    let already = if shape == differs { present[differs].min(exponents[differs]) } else { 0 };
                    for _ in already..exponents[shape] {
                        let base = &self.bases[shape];
                        let spectrum = levels[depth].spectrum.multiply(base, &mut self.rooms);
                        depth += 1;
                        if levels.len() == depth {
                            levels.push(Level { spectrum, denominator: Denominator::default() });
                        } else {
                            let before = std::mem::replace(&mut levels[depth].spectrum, spectrum);
                            self.rooms.recycle(before.into_values());
                        }
                        let (known, new) = levels.split_at_mut(depth);
                        new[0].denominator.set_product(&known[depth - 1].denominator, base.denominator());
                        self.report(options, done, total, self.groups[contribution.group].term)?;
                    }
                }
                present.copy_from_slice(exponents);
            }
            self.contribute(contribution, &levels[depth]);
        }
        Ok(())
    }

    fn contribute(&mut self, contribution: &Contribution<K>, product: &Level) {
        let index = contribution.group;
        let Some(sum) = self.groups[index].sum else {
            return self.finish(index, &product.spectrum, &product.denominator, &contribution.factor);
        };
        let sum = &mut self.sums[sum as usize];
        let scale = self.factors.quotient(&sum.denominator, &product.denominator).times(&contribution.factor);
        sum.spectrum.add_scaled(&product.spectrum, &scale, &mut self.rooms);
        sum.pending -= 1;
        if sum.pending == 0 {
            let spectrum = std::mem::replace(&mut sum.spectrum, Spectrum::zero());
            let denominator = std::mem::take(&mut sum.denominator);
            self.finish(index, &spectrum, &denominator, &Scalar::ONE);
            self.rooms.recycle(spectrum.into_values());
        }
    }

    /// Reduces a group's coefficients to lowest terms and stores them.
    fn finish(&mut self, index: usize, spectrum: &Spectrum, denominator: &Denominator, factor: &Scalar) {
        let with_common;
        let denominator = match self.groups[index].common {
            None => denominator,
            Some(common) => {
                let mut product = Denominator::default();
                product.set_product(denominator, &self.common[common as usize]);
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
    let size = series.numerator_words + series.denominator_words;
    let start = out.len();
    out.resize(start + values.len() * size, 0);
    let mut slots = &mut out[start..];
    let mut count = 0;
    let halvings = u32::from(reduction.is_even());
    // Beyond one word the numerators are unlimited.
    let doubled = if halvings == 1 { None } else { Some(factor.times(&Scalar::Small(2))) };
    let of_rest = doubled.as_ref().unwrap_or(factor);
    let mut values = values;
    while !values.is_empty() {
        let (part, others) = values.split_at(series.len);
        values = others;
        let (constant, rest) = part.split_at(usize::from(series.first == 0));
        for (list, halvings, factor) in [(constant, 0, factor), (rest, halvings, of_rest)] {
            let (here, further) = slots.split_at_mut(list.len() * size);
            slots = further;
            count += match factor {
                Scalar::Small(1) => write_all(list, here, size, |value, slot| reduction.write(value, halvings, slot)),
                Scalar::Small(factor) => {
                    let scaled = |value: &T| value.times(*factor);
                    write_all(list, here, size, |value, slot| reduction.write(&scaled(value), halvings, slot))
                }
                Scalar::Big(factor) => {
                    let scaled = |value: &T| value.to_big() * factor.as_ref();
                    write_all(list, here, size, |value, slot| reduction.write(&scaled(value), halvings, slot))
                }
            };
        }
    }
    count
}

/// Writes the values that are not zero into their slots of `size` words, and counts them.
#[inline]
fn write_all<T: Numerator>(values: &[T], slots: &mut [u64], size: usize, write: impl Fn(&T, &mut [u64])) -> usize {
    let (mut count, mut slots) = (0, slots);
    for value in values {
        let (slot, further) = slots.split_at_mut(size);
        slots = further;
        if !value.is_zero() {
            count += 1;
            write(value, slot);
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
fn common_denominator(terms: &[Term]) -> Option<Scalar> {
    let mut common: Option<Scalar> = None;
    for term in terms {
        if term.coefficient.is_integer() {
            continue;
        }
        let denominator = denominator_of(&term.coefficient);
        common = Some(match common {
            None => denominator,
            Some(common) if common == denominator => common,
            Some(common) => {
                let small = match (&common, &denominator) {
                    (Scalar::Small(a), Scalar::Small(b)) => (b / a.gcd(b)).checked_mul(*a),
                    _ => None,
                };
                small.map_or_else(|| Scalar::from_big(&common.to_big().lcm(&denominator.to_big())), Scalar::Small)
            }
        });
    }
    common
}

fn numerator_of(value: &Rational) -> Scalar {
    value.as_words().map_or_else(|| Scalar::from_big(&value.numer()), |(numerator, _)| Scalar::Small(numerator))
}

fn denominator_of(value: &Rational) -> Scalar {
    value.as_words().map_or_else(|| Scalar::from_big(&value.denom()), |(_, denominator)| Scalar::Small(denominator))
}

/// The numerator of a coefficient over a multiple of its denominator.
fn numerator_over(coefficient: &Rational, common: Option<&Scalar>) -> Scalar {
    let numerator = numerator_of(coefficient);
    let Some(common) = common else { return numerator };
    let denominator = denominator_of(coefficient);
    if let (Scalar::Small(common), Scalar::Small(denominator)) = (common, &denominator) {
        return numerator.times(&Scalar::Small(common / denominator));
    }
    Scalar::from_big(&(coefficient.numer() * (common.to_big() / coefficient.denom())))
}
