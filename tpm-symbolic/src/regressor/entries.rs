//! The elements of a regressor form: columns, and rows of terms.
//!
//! The entry of a row and column is the sum of its terms. A factor of a term is an atom (a leaf, a function, a divisor) or a sum that
//! was left as it was written, because the equations would be too long multiplied out (`DESIGN.md`, "Why is a regressor entry an expression
//! and not a polynomial?"). Whoever evaluates or prints an entry takes it as it is; a table of harmonics needs [`RegressorForm::expanded`].
//!
//! Invariants of [`RegressorForm`]: terms of a row are sorted by column, then monomial, with no zero coefficient and no
//! two terms of equal column and monomial; no column is empty; a row with a single input, whose coefficient is rational,
//! is scaled so that this coefficient is 1.

use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{Coordinate, ExprId, Graph, Node, Symbol};
use crate::expr::size::Sizes;
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::mechanics::unit::Unit;
use crate::number::rational::{self, Rational};
use ecow::EcoString;
use num_traits::Zero;
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// A parameter that is estimated: one of the model's own, or a lumped one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// The name, usable as an identifier.
    pub name: EcoString,
    /// The unit, when every unit that goes into it is declared.
    pub unit: Option<Unit>,
    /// The expression in the physical parameters, a Laurent polynomial over parameter symbols and parameter-only
    /// functions (atoms of the model's graph).
    pub definition: Polynomial<ExprId>,
    /// The symbol when the column is just one of the model's parameters.
    pub parameter: Option<Symbol>,
}

/// coefficient * (product of constants, motion atoms and sums), multiplying one column, or none for a known term.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Term {
    /// Index of the column; `None` for a term without unknown parameters.
    pub column: Option<usize>,
    /// The exact factor.
    pub coefficient: Rational,
    /// Constants, motion atoms and sums of such, by their ids in the model's graph.
    pub atoms: Monomial<ExprId>,
    /// A source term from which this term came.
    pub source: TermId,
}

/// One equation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Row {
    /// The input's name, or `eq1`, `eq2`, ...
    pub name: EcoString,
    /// The terms on the left-hand side.
    pub terms: Vec<Term>,
    /// The right-hand side: known factor (a polynomial over run-time constants) of every input that occurs.
    pub inputs: Vec<(Symbol, Polynomial<ExprId>)>,
}

/// The whole model in regressor form.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RegressorForm {
    /// The estimated parameters.
    pub columns: Vec<Column>,
    /// The equations.
    pub rows: Vec<Row>,
}

impl Term {
    /// Whether no factor is a sum that could be multiplied out.
    #[must_use]
    pub fn is_expanded(&self, graph: &Graph) -> bool {
        self.atoms.factors().all(|(&atom, exponent)| exponent < 0 || !matches!(graph.node(atom), Node::Sum(_)))
    }

    /// An upper bound of the number of terms that this one has when it is multiplied out.
    pub(crate) fn size(&self, graph: &Graph, sizes: &mut Sizes) -> f64 {
        let factor =
            |(&atom, exponent): (&ExprId, i32)| if exponent > 0 { sizes.of(graph, atom).powi(exponent) } else { 1.0 };
        self.atoms.factors().map(factor).product()
    }

    /// The product, multiplied out. `known` holds the polynomials of subexpressions, and the new ones are added to it.
    fn polynomial(&self, graph: &Graph, known: &mut FxHashMap<ExprId, Polynomial<ExprId>>) -> Polynomial<ExprId> {
        let mut product = Polynomial::constant(self.coefficient.clone());
        for (&atom, exponent) in self.atoms.factors() {
            let base = graph.polynomial_beside(atom, known);
            let power = match base.as_term() {
                _ if exponent > 0 => base.pow(exponent.unsigned_abs()),
                Some((monomial, value)) => Polynomial::term(monomial.pow(exponent), rational::power(value, exponent)),
                None => Polynomial::term(Monomial::power_of(atom, exponent), rational::integer(1)),
            };
            product = product.mul(&power);
        }
        product
    }
}

impl RegressorForm {
    /// Whether no term has a factor that could be multiplied out.
    #[must_use]
    pub fn is_expanded(&self, graph: &Graph) -> bool {
        self.rows.iter().flat_map(|row| &row.terms).all(|term| term.is_expanded(graph))
    }

    /// Whether every column occurs in some row.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        let stands = |column| self.rows.iter().flat_map(|row| &row.terms).any(|term| term.column == Some(column));
        (0..self.columns.len()).all(stands)
    }

    /// A term in which an input stands beside the motion, beside another input or in a function, with that input; `model` is the form's.
    #[must_use]
    pub fn driven(&self, model: &ExactModel) -> Option<(&Term, Symbol)> {
        let input = |leaf: ExprId| match *model.graph.node(leaf) {
            Node::Symbol(symbol) if model.quantity(symbol).kind == Kind::Input => Some(symbol),
            _ => None,
        };
        // Leaves are looked for once in all terms, which share most of their expressions, before they are in single ones.
        self.leaves(&model.graph).into_iter().find_map(input)?;
        self.rows.iter().flat_map(|row| &row.terms).find_map(|term| {
            let leaves = model.graph.leaves_of(term.atoms.factors().map(|(&atom, _)| atom));
            Some((term, leaves.into_iter().find_map(input)?))
        })
    }

    /// Coordinates that are readings of the motion rather than part of it, such as that of an accelerometer: no derivative of them occurs,
    /// they stand in one row alone, which says what they are, and others move.
    #[must_use]
    pub fn outputs(&self, model: &ExactModel) -> Vec<Coordinate> {
        // Highest derivative of every coordinate, and the number of rows in which it stands.
        let mut found: BTreeMap<Coordinate, (u32, usize)> = BTreeMap::new();
        for row in &self.rows {
            let terms = row.terms.iter().flat_map(|term| term.atoms.factors());
            let mut own: BTreeMap<Coordinate, u32> = BTreeMap::new();
            for leaf in model.graph.leaves_of(terms.map(|(&atom, _)| atom)) {
                if let Node::Derivative(coordinate, order) = *model.graph.node(leaf) {
                    let highest = own.entry(coordinate).or_insert(order);
                    *highest = order.max(*highest);
                }
            }
            for (coordinate, order) in own {
                let (highest, rows) = found.entry(coordinate).or_insert((order, 0));
                (*highest, *rows) = (order.max(*highest), *rows + 1);
            }
        }
        if self.rows.len() != found.len() || found.values().all(|(order, _)| *order == 0) {
            return Vec::new();
        }
        found.into_iter().filter(|(_, own)| *own == (0, 1)).map(|(coordinate, _)| coordinate).collect()
    }

    /// Whether only a simulation tells the parameters of such rows from a log: an input does not stand alone, there is none, or a sensor reads
    /// what a row says of the motion.
    #[must_use]
    pub fn is_only_simulated(&self, model: &ExactModel) -> bool {
        self.driven(model).is_some()
            || self.rows.iter().all(|row| row.inputs.is_empty())
            || !self.outputs(model).is_empty()
    }

    /// The form with every term multiplied out; `graph` is that of its model. The number of terms may be exponential in the number of
    /// the graph's nodes.
    #[must_use]
    pub fn expanded(&self, graph: &Graph) -> Cow<'_, Self> {
        if self.is_expanded(graph) {
            return Cow::Borrowed(self);
        }
        let mut known = FxHashMap::default();
        let rows = self.rows.iter().map(|row| {
            let mut terms = Vec::with_capacity(row.terms.len());
            for term in &row.terms {
                let polynomial = term.polynomial(graph, &mut known);
                terms.extend(polynomial.terms().map(|(atoms, coefficient)| Term {
                    column: term.column,
                    coefficient: coefficient.clone(),
                    atoms: atoms.clone(),
                    source: term.source,
                }));
            }
            // The sort is stable, so that a product keeps its first source term.
            terms.sort_by(|a, b| (a.column, &a.atoms).cmp(&(b.column, &b.atoms)));
            terms.dedup_by(|next, kept| {
                let same = (next.column, &next.atoms) == (kept.column, &kept.atoms);
                if same {
                    kept.coefficient += &next.coefficient;
                }
                same
            });
            terms.retain(|term| !term.coefficient.is_zero());
            Row { name: row.name.clone(), terms, inputs: row.inputs.clone() }
        });
        Cow::Owned(Self { columns: self.columns.clone(), rows: rows.collect() })
    }

    /// The leaves on which the entries depend, in increasing order.
    pub(crate) fn leaves(&self, graph: &Graph) -> Vec<ExprId> {
        let terms = self.rows.iter().flat_map(|row| &row.terms);
        graph.leaves_of(terms.flat_map(|term| term.atoms.factors()).map(|(&atom, _)| atom))
    }
}
