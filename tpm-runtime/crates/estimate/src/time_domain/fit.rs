//! Least squares over the equations of one band.

use crate::free::Free;
use crate::information::{beside, beside_known, touched};
use crate::result::{Estimate, LeastSquares};
use crate::settings::Settings;
use crate::time_domain::equations::{Equations, RowEquations};
use tpm_controller::model::Dims;
use tpm_numerics::singular::{Singular, unit_columns};
use tpm_numerics::{DMatrix, DVector, tolerance};

/// Share of its information that noise of the sensors alone would give: a direction above it is hidden.
pub(crate) const MOST_NOISE_INFORMATION: f64 = 0.5;
/// Times that the rows are weighed by what they leave.
pub(crate) const WEIGHING_PASSES: usize = 3;

/// The weighted equations of one row, over the free parameters.
struct Part {
    rows: DMatrix<f64>,
    right: DVector<f64>,
    noise: DMatrix<f64>,
    noise_of_right: DVector<f64>,
}

/// An estimate in one band.
pub(super) struct Fitted {
    pub(super) estimate: Estimate,
    /// What is left of every row, as a share of its force.
    pub(super) row_residuals: Vec<f64>,
}

/// Estimates the parameters in one band; nothing where no equation counts, or none says anything.
pub(super) fn fit(equations: &Equations, dims: Dims, free: &Free, settings: &Settings) -> Option<Fitted> {
    let parts: Vec<Part> = equations.rows.iter().map(|row| part(row, dims.parameters, free, settings)).collect();
    let mut weights = first_weights(&parts, equations);
    let counted = |row: usize| equations.rows[row].counts.iter().filter(|counts| **counts).count();
    if (0..dims.rows).all(|row| counted(row) == 0) {
        return None;
    }
    let prior = settings.start(dims.parameters);
    let start = DVector::from_vec(free.of(&prior));
    let known: Vec<Vec<f64>> = settings.hidden.iter().map(|direction| free.of(direction)).collect();
    let mut solved = solve(&parts, &weights, &start, &known)?;
    let left = |solved: &Solved, row: usize| -> f64 {
        let part = &parts[row];
        (&part.right - &part.rows * &solved.values).norm_squared() / counted(row).max(1) as f64
    };
    for pass in 0..WEIGHING_PASSES {
        for (row, weight) in weights.iter_mut().enumerate() {
            // A row without an input is small where its parameters are, so that it is weighed once only.
            if equations.rows[row].driven || pass == 0 {
                let force = parts[row].right.norm_squared() / counted(row).max(1) as f64;
                *weight = 1.0 / (left(&solved, row) + f64::EPSILON * force).max(f64::MIN_POSITIVE);
            }
        }
        solved = solve(&parts, &weights, &start, &known)?;
    }
    let covariance = covariance(&parts, &weights, &solved, equations);
    let mut values = prior;
    free.put(solved.values.as_slice(), &mut values);
    // Of a row without an input it is the terms that are to cancel.
    let force = |row: usize| -> f64 {
        let part = &parts[row];
        if equations.rows[row].driven {
            part.right.norm_squared()
        } else {
            (0..part.rows.ncols()).map(|j| (part.rows.column(j) * solved.values[j]).norm_squared()).sum()
        }
    };
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole).sqrt() } else { 0.0 };
    let row_residuals: Vec<f64> =
        (0..dims.rows).map(|row| share(left(&solved, row) * counted(row) as f64, force(row))).collect();
    let felt = |j: usize| -> f64 {
        let Some(at) = free.indices.iter().position(|&free| free == j) else { return 0.0 };
        let of = |row: usize| {
            let own = parts[row].rows.column(at).norm_squared();
            share(own, if equations.rows[row].driven { force(row) } else { own })
        };
        (0..dims.rows).map(of).fold(0.0, f64::max)
    };
    let felt: Vec<f64> = (0..dims.parameters).map(felt).collect();
    let whole = free.spread_square(&covariance);
    let touched = touched(&solved.hidden, &solved.scale);
    let estimate = Estimate::of_rows(
        free,
        LeastSquares {
            values,
            covariance: whole,
            hidden: &solved.hidden,
            touched: &touched,
            rank: solved.rank,
            condition: solved.condition,
            row_residuals: &row_residuals,
            felt: &felt,
        },
    );
    Some(Fitted { estimate, row_residuals })
}

fn part(row: &RowEquations, parameters: usize, free: &Free, settings: &Settings) -> Part {
    let width = parameters + 1;
    let instants = row.counts.len();
    let n = free.indices.len();
    let entry = |of: &[f64], k: usize, column: usize| if row.counts[k] { of[k * width + column] } else { 0.0 };
    let right = |of: &[f64], k: usize| {
        let held: f64 = settings.frozen.iter().map(|frozen| frozen.value * entry(of, k, frozen.parameter)).sum();
        entry(of, k, parameters) - held
    };
    Part {
        rows: DMatrix::from_fn(instants, n, |k, j| entry(&row.entries, k, free.indices[j])),
        right: DVector::from_fn(instants, |k, _| right(&row.entries, k)),
        noise: DMatrix::from_fn(instants, n, |k, j| entry(&row.noise, k, free.indices[j])),
        noise_of_right: DVector::from_fn(instants, |k, _| right(&row.noise, k)),
    }
}

/// Weights by the size of the forces. In a row without an input it is what its parameters would make there if each of them alone made
/// the forces of the rows that have one.
fn first_weights(parts: &[Part], equations: &Equations) -> Vec<f64> {
    let driven = || parts.iter().zip(&equations.rows).filter(|(_, row)| row.driven).map(|(part, _)| part);
    let force: f64 = driven().map(|part| part.right.norm_squared()).sum();
    let n = parts.first().map_or(0, |part| part.rows.ncols());
    let size = |j: usize| -> f64 {
        let own: f64 = driven().map(|part| part.rows.column(j).norm_squared()).sum();
        if own > 0.0 { force / own } else { 0.0 }
    };
    let sizes: Vec<f64> = (0..n).map(size).collect();
    let weight = |(part, row): (&Part, &RowEquations)| {
        let own: f64 = if row.driven {
            part.right.norm_squared()
        } else {
            (0..n).map(|j| part.rows.column(j).norm_squared() * sizes[j]).sum()
        };
        if own > 0.0 { 1.0 / own } else { 1.0 }
    };
    parts.iter().zip(&equations.rows).map(weight).collect()
}

/// Parameters that solve weighted equations.
struct Solved {
    values: DVector<f64>,
    /// The pseudo-inverse of the normal matrix.
    inverse: DMatrix<f64>,
    /// Directions that are not shown, the largest component of each being one.
    hidden: Vec<Vec<f64>>,
    /// What columns are divided by so that all count alike.
    scale: Vec<f64>,
    rank: usize,
    condition: f64,
}

/// Solves `(A'WA - N'WN) theta = A'W b - N'W n`: the normal equations less what noise of the sensors adds to them. Nothing moves along
/// the directions that are known not to be shown.
fn solve(parts: &[Part], weights: &[f64], start: &DVector<f64>, known: &[Vec<f64>]) -> Option<Solved> {
    let n = start.len();
    let mut factor = DMatrix::zeros(0, n + 1);
    let mut noise = DMatrix::zeros(n, n);
    let mut cross = DVector::zeros(n);
    for (part, weight) in parts.iter().zip(weights) {
        let rows = part.rows.clone().insert_column(n, 0.0);
        let mut rows = rows * weight.sqrt();
        rows.column_mut(n).copy_from(&((&part.right - &part.rows * start) * weight.sqrt()));
        let above = factor.nrows();
        let own = rows.qr().r();
        factor = factor.resize_vertically(above + own.nrows(), 0.0);
        factor.rows_mut(above, own.nrows()).copy_from(&own);
        noise += part.noise.tr_mul(&part.noise) * *weight;
        cross += part.noise.tr_mul(&(&part.noise_of_right - &part.noise * start)) * *weight;
    }
    let factor = factor.qr().r();
    let (triangle, right) = (factor.columns(0, n).into_owned(), factor.column(n).into_owned());
    let (triangle, scale) = unit_columns(triangle);
    let shown_by_some = beside(known, &scale);
    let known = if shown_by_some.is_some() { known } else { &[] };
    let triangle = match &shown_by_some {
        Some(basis) => triangle * basis,
        None => triangle,
    };
    let whole = |directions: DMatrix<f64>| match &shown_by_some {
        Some(basis) => basis * directions,
        None => directions,
    };
    let singular = Singular::new(&triangle, tolerance::RANK);
    let rank = singular.rank();
    if rank == 0 {
        return None;
    }
    // Coordinates in which the normal matrix is the identity: theta = start + D V S^-1 y.
    let mut to_scaled = whole(singular.right.clone());
    for (mut column, value) in to_scaled.column_iter_mut().zip(singular.values.iter()) {
        column /= *value;
    }
    let mut to_parameters = to_scaled.clone();
    for (mut row, scale) in to_parameters.row_iter_mut().zip(&scale) {
        row /= *scale;
    }
    let of_noise = (to_parameters.tr_mul(&noise) * &to_parameters).symmetric_eigen();
    let shown: Vec<usize> = (0..rank).filter(|&i| of_noise.eigenvalues[i] < MOST_NOISE_INFORMATION).collect();
    let lost: Vec<usize> = (0..rank).filter(|&i| of_noise.eigenvalues[i] >= MOST_NOISE_INFORMATION).collect();
    let right = singular.left.tr_mul(&right) - to_parameters.tr_mul(&cross);
    let mut values = start.clone();
    let mut inverse = DMatrix::zeros(n, n);
    for &i in &shown {
        let direction = &to_parameters * of_noise.eigenvectors.column(i);
        let left = 1.0 - of_noise.eigenvalues[i];
        values.axpy(of_noise.eigenvectors.column(i).dot(&right) / left, &direction, 1.0);
        inverse.ger(1.0 / left, &direction, &direction, 1.0);
    }
    let null = whole(singular.null());
    let by_noise = lost.iter().map(|&i| (&to_scaled * of_noise.eigenvectors.column(i)).normalize());
    let unseen: Vec<Vec<f64>> = null.column_iter().map(|column| column.iter().copied().collect()).collect();
    let unseen = unseen.into_iter().chain(by_noise.map(|direction| direction.iter().copied().collect())).collect();
    let hidden = known.iter().cloned().chain(beside_known(known, unseen, &scale)).collect();
    if values.iter().any(|value| !value.is_finite()) {
        return None;
    }
    Some(Solved { values, inverse, hidden, rank: shown.len(), condition: singular.condition(), scale })
}

/// Covariance from what the equations leave, whatever its correlation in time (Newey and West 1987), over the free parameters.
fn covariance(parts: &[Part], weights: &[f64], solved: &Solved, equations: &Equations) -> DMatrix<f64> {
    let n = solved.values.len();
    let instants = equations.instants();
    let mut scores = DMatrix::zeros(instants, n);
    for (part, weight) in parts.iter().zip(weights) {
        let left = &part.right - &part.rows * &solved.values;
        for (k, left) in left.iter().enumerate() {
            for j in 0..n {
                scores[(k, j)] += weight * part.rows[(k, j)] * left;
            }
        }
    }
    let mut sum = scores.tr_mul(&scores);
    let reach = equations.correlated.min(instants.saturating_sub(1));
    for lag in 1..=reach {
        let weight = 1.0 - lag as f64 / (reach + 1) as f64;
        let product = scores.rows(0, instants - lag).tr_mul(&scores.rows(lag, instants - lag));
        sum += (&product + product.transpose()) * weight;
    }
    let counted: usize = equations.rows.iter().flat_map(|row| &row.counts).filter(|counts| **counts).count();
    let freedom = counted as f64 / counted.saturating_sub(n).max(1) as f64;
    &solved.inverse * sum * &solved.inverse * freedom
}
