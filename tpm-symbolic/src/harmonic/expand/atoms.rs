//! Atoms of a regressor form under a pattern.
//!
//! An atom, which is a constant or a derivative q^(n) of a coordinate, becomes a sum of parts (whole number) * (powers of
//! symbols) * (shape), where a shape is a phase derivative F^(n) of a Fourier polynomial of the pattern.
//!
//! Invariant of [`Atoms`] once resolved: symbols are in the model's order, and shapes in increasing order of the highest
//! exponent with which they occur.

use crate::algebra::fourier::Fourier;
use crate::expr::graph::{Coordinate, ExprId, Node, Symbol};
use crate::harmonic::error::ExpandError;
use crate::harmonic::expand::coefficient::numerator_of;
use crate::harmonic::options::ExpandOptions;
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::mechanics::pattern::Pattern;
use crate::number::rational;
use crate::number::scalar::Scalar;
use crate::regressor::form::RegressorForm;
use smallvec::SmallVec;

/// One part of an atom under the pattern: factor * symbols * shape.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub(super) factor: Scalar,
    /// Range of its powers of symbols in the list of all powers.
    pub(super) powers: (usize, usize),
    /// The sum of the magnitudes of these powers.
    degree: u64,
    /// Its shape, as an index into [`Atoms::shapes`].
    pub(super) shape: Option<usize>,
}

/// A phase derivative of a Fourier polynomial of the pattern.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape<'a> {
    pub(super) fourier: &'a Fourier,
    pub(super) order: u32,
    /// The highest exponent with which it occurs.
    largest: u64,
}

/// Index of pi among the symbols, which is larger than that of any symbol of a model.
pub(super) const PI: usize = usize::MAX;

/// All atoms of a regressor form, as sums of parts.
pub(super) struct Atoms<'a> {
    pub(super) parts: SmallVec<[Part; 4]>,
    /// Powers of symbols in parts, by index into [`Atoms::symbols`].
    pub(super) powers: SmallVec<[(usize, i32); 8]>,
    pub(super) list: SmallVec<[Atom; 8]>,
    /// Index into `list` of every node of the graph that occurs.
    pub(super) index: SmallVec<[u32; 64]>,
    /// Symbols of the model that occur in parts, and [`PI`].
    pub(super) symbols: SmallVec<[usize; 8]>,
    pub(super) shapes: SmallVec<[Shape<'a>; 4]>,
    /// Upper bound of the exponents of symbols and shapes in all products.
    pub(super) largest_exponent: u64,
    /// An upper bound of the number of symbolic products, and the term with the most products.
    products: f64,
    worst: Option<(f64, TermId)>,
}

const UNRESOLVED: u32 = u32::MAX;

/// An atom under the pattern.
#[derive(Clone, Copy, Debug)]
pub(super) struct Atom {
    /// Range of its parts in the list of all parts.
    pub(super) start: usize,
    pub(super) end: usize,
    /// The highest sum of exponents of symbols in a part, at least 1.
    highest: u64,
    /// Whether it may occur in a denominator: it is a single product of symbols.
    invertible: bool,
}

impl<'a> Atoms<'a> {
    pub(super) fn new() -> Self {
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
    pub(super) fn resolve(
        &mut self,
        model: &ExactModel,
        form: &RegressorForm,
        pattern: &'a Pattern,
    ) -> Result<(), ExpandError> {
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
                    return Err(ExpandError::NotFinite { term: term.source, atom: model.display_brief(id) });
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
                // The number of terms of such a power exceeds every limit, whatever its base.
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

    /// Sorts the symbols in the model's order, so that powers are sorted.
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

    /// Sorts the shapes. The last shape is multiplied first, so that shapes with high exponents belong to many common
    /// prefixes.
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
    fn add(&mut self, model: &ExactModel, pattern: &'a Pattern, id: ExprId, term: TermId) -> Result<(), ExpandError> {
        let start = self.parts.len();
        match *model.graph.node(id) {
            Node::Pi => self.constant(PI),
            Node::Symbol(symbol) if is_constant(model, symbol) => self.constant(symbol.0 as usize),
            Node::Derivative(coordinate, order) => self.motion(model, pattern, coordinate, order, term)?,
            _ => return Err(ExpandError::NotFinite { term, atom: model.display_brief(id) }),
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
        model: &ExactModel,
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
            // A whole number is separated from the shapes, so that offsets cancel before anything is multiplied out.
            let [value, _] = if constant { fourier.pair(0) } else { [None; 2] };
            let part = match value.filter(|value| rational::is_integer(value)) {
                Some(value) => Part { factor: numerator_of(value), powers, degree, shape: None },
                None => Part { factor: Scalar::ONE, powers, degree, shape: Some(self.shape(fourier, order)) },
            };
            self.parts.push(part);
        }
        Ok(())
    }

    pub(super) fn refuse_too_many_products(&self, options: &ExpandOptions<'_>) -> Result<(), ExpandError> {
        // Size of a product in bytes: two keys and a factor.
        options.refuse_beyond(self.worst.map(|(_, term)| term), self.products, self.products * 64.0)
    }
}

fn is_constant(model: &ExactModel, symbol: Symbol) -> bool {
    matches!(model.quantity(symbol).kind, Kind::Constant { .. } | Kind::Amplitude | Kind::Frequency)
}
