//! Plans that belong to a trajectory pattern: the reference motion, the harmonic table, and its exact pseudo-inverse.
//!
//! Where every column of the estimator matrix has one scale, B Lambda = B diag(s) with a matrix B of numbers, so that the least
//! squares solution for the harmonics h of the forces is
//!
//! ```text
//! theta = diag(1/s) (B^T B)^-1 B^T h
//! ```
//!
//! with exact constants.

use crate::algebra::linear;
use crate::expr::graph::{ExprId, Function, Graph, Symbol};
use crate::harmonic::expand::ExpandError;
use crate::harmonic::table::HarmonicTable;
use crate::mechanics::model::ExactModel;
use crate::mechanics::pattern::Pattern;
use crate::number::rational::{self, Rational};
use crate::plan::constants;
use crate::plan::draft::Draft;
use crate::plan::evaluation::Evaluation;
use crate::plan::leaf::Leaf;
use crate::plan::reference::reference;
use crate::plan::straight_line::Plan;
use crate::plan::table::{TablePlan, table_symbol};
use num_traits::Zero;
use thiserror::Error;

/// Why a part of the plans of a pattern does not exist.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PatternGap {
    /// The pattern does not prescribe a coordinate of the equations.
    #[error("the pattern gives the coordinate `{0}` no motion")]
    NoMotion(String),
    /// The harmonic table does not exist.
    #[error(transparent)]
    Expand(#[from] ExpandError),
    /// An input stands in a function, and something else is in its place.
    #[error("the input `{0}` stands in a function, so that its harmonics are not those of a row")]
    Solved(String),
    /// The declared Taylor polynomials lead to other lumped parameters than the equations.
    #[error("with the declared Taylor polynomials the parameters are {table}, not {exact}")]
    Columns {
        /// The columns of the equations.
        exact: String,
        /// The columns of the table.
        table: String,
    },
}

/// The plans of one pattern.
#[derive(Clone, Debug)]
pub struct PatternPlan {
    /// The pattern's name, when it has one.
    pub name: Option<String>,
    /// The amplitudes.
    pub amplitudes: Vec<Symbol>,
    /// The fundamental frequency.
    pub frequency: Symbol,
    /// Every coordinate of the evaluation with its derivatives 0, 1, ... up to its own order, one coordinate after the
    /// other; leaves are amplitudes, frequency, constants, cos w t and sin w t.
    pub reference: Result<Plan, PatternGap>,
    /// The harmonic table.
    pub table: Result<TablePlan, PatternGap>,
    /// The exact pseudo-inverse of the estimator matrix, where it exists and is small.
    pub pseudo_inverse: Option<PseudoInverse>,
}

impl PatternPlan {
    /// The plans of a pattern of the model; `table` is its harmonic table, or the reason why there is none.
    pub(crate) fn new(
        model: &ExactModel,
        evaluation: &Evaluation,
        pattern: &Pattern,
        table: Result<HarmonicTable, PatternGap>,
    ) -> Self {
        let reference = reference(model, &evaluation.coordinates, pattern);
        let table = table.map(|table| TablePlan::new(model, table));
        Self {
            name: pattern.name.clone(),
            amplitudes: pattern.amplitudes.clone(),
            frequency: pattern.frequency,
            reference: reference
                .map_err(|coordinate| PatternGap::NoMotion(model.coordinates[coordinate.0 as usize].name.clone())),
            pseudo_inverse: table.as_ref().ok().and_then(|table| PseudoInverse::new(model, table)),
            table,
        }
    }
}

/// Most entries of an estimator matrix whose pseudo-inverse is computed: its plan has up to one operation per row and
/// column, and longer straight-line code is of no use.
const MOST_ENTRIES: usize = 400;

/// Common factor of the entries in a column of the estimator matrix: a product of powers of quantities, of signs and of
/// pi.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scale {
    /// Powers of amplitudes, frequency and constants.
    pub powers: Vec<(Symbol, i32)>,
    /// Amplitudes and constants whose sign is a factor.
    pub signs: Vec<Symbol>,
    /// The power of pi.
    pub pi: i32,
}

/// The exact pseudo-inverse of an estimator matrix whose columns have one scale each.
#[derive(Clone, Debug)]
pub struct PseudoInverse {
    /// (B^T B)^-1 B^T, one row per parameter and one column per row of the harmonic table.
    pub numbers: Vec<Vec<Rational>>,
    /// s, one scale per parameter.
    pub scales: Vec<Scale>,
    /// theta, one output per parameter; leaves are the harmonics, amplitudes, frequency and constants. No quantity in a
    /// scale may be zero.
    pub plan: Plan,
}

impl PseudoInverse {
    /// `None` where the entries of a column differ by more than a numeric factor, the columns depend on each other,
    /// there are terms without an unknown parameter, or the matrix has more than [`MOST_ENTRIES`] entries.
    fn new(model: &ExactModel, table: &TablePlan) -> Option<Self> {
        let columns = table.table.parameters.len();
        if table.places.iter().any(|(_, column)| column.is_none()) || table.places.len() > MOST_ENTRIES {
            return None;
        }
        let (matrix, scales) = scaled_matrix(table, columns)?;
        let product = |a: usize, b: usize| matrix.iter().map(|row| &row[a] * &row[b]).sum::<Rational>();
        let mut normal: Vec<Vec<Rational>> = (0..columns)
            .map(|a| (0..columns).map(|b| product(a, b)).chain(matrix.iter().map(|row| row[a].clone())).collect())
            .collect();
        // B^T B next to B^T, reduced to the identity next to the pseudo-inverse.
        if linear::reduce(&mut normal) != (0..columns).collect::<Vec<usize>>() {
            return None;
        }
        let numbers: Vec<Vec<Rational>> = normal.into_iter().map(|mut row| row.split_off(columns)).collect();
        let mut draft = Draft::new(Graph::new());
        let roots: Vec<ExprId> =
            scales.iter().zip(&numbers).map(|(scale, factors)| parameter(model, &mut draft, scale, factors)).collect();
        let plan = draft.plan(&roots);
        Some(Self { numbers, scales, plan })
    }
}

/// B, rows of the table times columns, and the scale of every column; `None` where a column has no scale, or several.
fn scaled_matrix(table: &TablePlan, columns: usize) -> Option<(Vec<Vec<Rational>>, Vec<Scale>)> {
    let mut matrix = vec![vec![rational::integer(0); columns]; table.rows.len()];
    let mut scales: Vec<Option<Scale>> = vec![None; columns];
    for entry in table.table.entries() {
        let column = entry.column?;
        let signs = entry.sign.factors().filter(|(_, power)| power % 2 != 0);
        let scale = Scale {
            powers: entry.powers.factors().map(|(&symbol, power)| (table_symbol(symbol), power)).collect(),
            signs: signs.map(|(&symbol, _)| table_symbol(symbol)).collect(),
            pi: entry.pi,
        };
        match &scales[column] {
            Some(present) if *present != scale => return None,
            _ => scales[column] = Some(scale),
        }
        matrix[table.row_of(&entry)][column] += &entry.coefficient;
    }
    Some((matrix, scales.into_iter().collect::<Option<_>>()?))
}

/// The sum of harmonics times `factors`, divided by the scale.
fn parameter(model: &ExactModel, draft: &mut Draft, scale: &Scale, factors: &[Rational]) -> ExprId {
    let mut terms = Vec::new();
    for (row, factor) in factors.iter().enumerate().filter(|(_, factor)| !factor.is_zero()) {
        let harmonic = draft.leaf(Leaf::Harmonic(row));
        terms.push(draft.graph.scale(harmonic, factor.clone()));
    }
    let mut product = vec![draft.graph.sum(&terms)];
    for &(symbol, power) in &scale.powers {
        let base = constants::quantity(model, draft, symbol);
        product.push(draft.graph.pow(base, -power));
    }
    for &symbol in &scale.signs {
        // A sign is its own inverse.
        let base = constants::quantity(model, draft, symbol);
        product.push(draft.graph.function(Function::Sign, base));
    }
    if scale.pi != 0 {
        let base = draft.graph.pi();
        product.push(draft.graph.pow(base, -scale.pi));
    }
    draft.graph.product(&product)
}
