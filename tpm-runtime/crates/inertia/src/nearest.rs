//! The possible parameters that are nearest to an estimate, and along directions that it leaves open to a reference.
//!
//! With what the data show, y = W theta with the covariance C, the minimum of
//!
//! ```text
//! 1/2 (W theta - y)' C^-1 (W theta - y) + rho sum_i [tr(P_i R_i^-1) - log det(P_i R_i^-1) - 4] + rho sum_j [x_j - log(1 + x_j)]
//! ```
//!
//! over the pseudo-inertias P_i, with those of the reference R_i, and scalars r_j (1 + x_j) that are not negative. The second
//! term is the Bregman divergence of -log det (Lee, Wensing, Park, IEEE T-RO 36, 2020), infinite where a body is not possible. Near the
//! reference it is half the squared relative distance, so that rho = 1 is a reference that is known within 100 %.
//!
//! In coordinates P = L (1 + X) L', R = L L', the divergence does not depend on units. The equations of the data are turned to their
//! singular directions, each scaled by its own curvature, so that directions which the data show a billion times better
//! than the reference stand beside those that only the reference shows without loss of digits. Newton's method, damped by bisection,
//! follows the minimum while rho falls from a weight at which the reference decides to the one that is asked for.
//!
//! Invariant: every iterate is possible.

use crate::pseudo_inertia::{ENTRIES, Pseudo, factor, parameters, pseudo_inertia, unit};
use tpm_numerics::singular::{Singular, complement};
use tpm_numerics::{Cholesky, DMatrix, DVector};

/// Most Newton steps at one weight of the reference.
const STEPS: usize = 60;
/// Factor by which the weight of the reference falls.
const FALL: f64 = 0.1;
/// Squared Newton decrement, as a share of the weight, at which a minimum is found: half of it is the decrease that is left.
const LEFT: f64 = 1e-20;
/// Weight of the size of a loose parameter beside that of the reference: small, so that one that a machine lacks becomes a thousandth of the
/// sum that it is in, and large enough that a size which nothing else decides stays in its order of magnitude.
const LOOSE: f64 = 1e-6;
/// Share of the predicted decrease that a step must give (Armijo).
const DECREASE: f64 = 1e-4;

/// What the data show: W theta = y with the Cholesky factor of the covariance of y.
#[derive(Clone, Debug)]
pub(crate) struct Evidence {
    pub(crate) rows: DMatrix<f64>,
    pub(crate) values: DVector<f64>,
    pub(crate) covariance: Cholesky<f64, tpm_numerics::Dyn>,
}

impl Evidence {
    /// The residual of parameters, each entry independent with a deviation of one.
    pub(crate) fn residual(&self, parameters: &DVector<f64>) -> DVector<f64> {
        self.whitened(&(&self.rows * parameters - &self.values))
    }

    fn whitened(&self, right: &DVector<f64>) -> DVector<f64> {
        let solved = self.covariance.l_dirty().solve_lower_triangular(right);
        solved.unwrap_or_else(|| DVector::from_element(right.len(), f64::NAN))
    }
}

/// What is to be found.
#[derive(Clone, Debug)]
pub(crate) struct Problem {
    pub(crate) evidence: Evidence,
    /// The ten parameters of every body, by their index.
    pub(crate) bodies: Vec<[usize; 10]>,
    /// Parameters that are not negative, by their index.
    pub(crate) positive: Vec<usize>,
    /// Parameters that are not negative and of which the reference knows no more than an order of magnitude, by their index.
    pub(crate) loose: Vec<usize>,
    /// Values of all parameters: possible ones. A parameter of no body that may have either sign moves freely from here, and must be
    /// shown by the data.
    pub(crate) reference: DVector<f64>,
    /// The weight rho of the reference.
    pub(crate) weight: f64,
}

/// The minimum.
#[derive(Clone, Debug)]
pub(crate) struct Nearest {
    pub(crate) parameters: DVector<f64>,
    /// The share of what is known about each parameter that comes from the data; the rest comes from the reference.
    pub(crate) from_data: Vec<f64>,
    /// The covariance of the parameters: the inverse of the curvature at the minimum.
    pub(crate) covariance: DMatrix<f64>,
}

/// Scalar or body in coordinates about the reference.
enum Part {
    Body { start: usize },
    Positive { at: usize, weight: f64 },
}

struct Scaled {
    parts: Vec<Part>,
    /// From coordinates to differences from the reference.
    scale: DMatrix<f64>,
    /// Singular values of the whitened equations, their right-hand side, and the right singular vectors with their complement.
    values: DVector<f64>,
    right: DVector<f64>,
    turn: DMatrix<f64>,
}

impl Problem {
    /// The minimum; `None` where the reference is not possible, or numbers overflow.
    pub(crate) fn solve(&self) -> Option<Nearest> {
        let scaled = self.scaled()?;
        let most = scaled.right.amax().max(1.0);
        let mut weight = self.weight.max(most.min(1e16));
        let mut u = DVector::zeros(self.reference.len());
        loop {
            u = scaled.newton(u, weight)?;
            if weight <= self.weight {
                break;
            }
            weight = (weight * FALL).max(self.weight);
        }
        Some(self.nearest(&scaled, &u))
    }

    fn scaled(&self) -> Option<Scaled> {
        let n = self.reference.len();
        let mut scale = DMatrix::zeros(n, n);
        let mut parts = Vec::new();
        let mut column = 0;
        let mut free: Vec<usize> = (0..n).collect();
        for body in &self.bodies {
            let root = factor(&pseudo_inertia(&body.map(|index| self.reference[index])))?;
            for entry in 0..ENTRIES.len() {
                let moved = parameters(&(root * unit(entry) * root.transpose()));
                body.iter().zip(moved).for_each(|(&index, value)| scale[(index, column + entry)] = value);
            }
            free.retain(|index| !body.contains(index));
            parts.push(Part::Body { start: column });
            column += ENTRIES.len();
        }
        let known = self.positive.iter().map(|&index| (index, 1.0));
        for (index, weight) in known.chain(self.loose.iter().map(|&index| (index, LOOSE))) {
            let size = self.reference[index];
            if size <= 0.0 {
                return None;
            }
            scale[(index, column)] = size;
            free.retain(|other| *other != index);
            parts.push(Part::Positive { at: column, weight });
            column += 1;
        }
        for index in free {
            // The scale of a parameter without a reference is no matter, as the singular directions have their own.
            let size = self.reference[index].abs();
            scale[(index, column)] = if size > 0.0 { size } else { 1.0 };
            column += 1;
        }
        let equations = self.evidence.covariance.l_dirty().solve_lower_triangular(&(&self.evidence.rows * &scale))?;
        let short = -self.evidence.residual(&self.reference);
        let Singular { values, left, right: shown } = Singular::new(&equations, f64::EPSILON);
        let open = complement(&shown);
        let mut turn = DMatrix::zeros(n, n);
        turn.columns_mut(0, shown.ncols()).copy_from(&shown);
        turn.columns_mut(shown.ncols(), open.ncols()).copy_from(&open);
        let right = left.tr_mul(&short);
        (turn.iter().chain(right.iter()).all(|x| x.is_finite())).then_some(Scaled { parts, scale, values, right, turn })
    }

    fn nearest(&self, scaled: &Scaled, u: &DVector<f64>) -> Nearest {
        let parameters = &self.reference + &scaled.scale * u;
        let n = parameters.len();
        let by = scaled.by(self.weight);
        let inverse = Cholesky::new(scaled.curvature(u, &by, self.weight)).map(|factor| factor.inverse());
        let own = &scaled.scale * &by;
        let of = |inverse: &DMatrix<f64>| &own * inverse * own.transpose();
        let covariance = inverse.map_or_else(|| DMatrix::from_element(n, n, f64::INFINITY), |inverse| of(&inverse));
        let alone = scaled.reference_variances(u, self.weight);
        let from_data = (0..n).map(|j| (1.0 - covariance[(j, j)] / alone[j]).clamp(0.0, 1.0)).collect();
        Nearest { parameters, from_data, covariance }
    }
}

impl Scaled {
    /// Coordinates in which the curvature of the data and of the reference is about one.
    fn by(&self, weight: f64) -> DMatrix<f64> {
        let mut by = self.turn.clone();
        for (j, mut column) in by.column_iter_mut().enumerate() {
            let shown = self.values.get(j).copied().unwrap_or(0.0);
            column /= (shown * shown + weight).sqrt();
        }
        by
    }

    fn inverse(start: usize, u: &DVector<f64>) -> Option<Pseudo> {
        let x: Pseudo = (0..ENTRIES.len()).map(|entry| unit(entry) * u[start + entry]).sum();
        Cholesky::new(Pseudo::identity() + x).map(|factor| factor.inverse())
    }

    /// The divergence from the reference; infinite where something is not possible.
    fn divergence(&self, u: &DVector<f64>) -> f64 {
        let part = |part: &Part| match part {
            Part::Body { start } => {
                let x: Pseudo = (0..ENTRIES.len()).map(|entry| unit(entry) * u[start + entry]).sum();
                let root = factor(&(Pseudo::identity() + x));
                root.map_or(f64::INFINITY, |root| x.trace() - 2.0 * root.diagonal().map(f64::ln).sum())
            }
            Part::Positive { at, weight } if u[*at] > -1.0 => weight * (u[*at] - u[*at].ln_1p()),
            Part::Positive { .. } => f64::INFINITY,
        };
        self.parts.iter().map(part).sum()
    }

    /// Gradient and curvature of the divergence in coordinates about the reference.
    fn derivatives(&self, u: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let n = u.len();
        let (mut gradient, mut curvature) = (DVector::zeros(n), DMatrix::zeros(n, n));
        for part in &self.parts {
            match part {
                Part::Body { start } => {
                    let Some(inverse) = Self::inverse(*start, u) else { continue };
                    for a in 0..ENTRIES.len() {
                        let moved = inverse * unit(a);
                        gradient[start + a] = unit(a).trace() - moved.trace();
                        for b in 0..=a {
                            let entry = (moved * inverse * unit(b)).trace();
                            curvature[(start + a, start + b)] = entry;
                            curvature[(start + b, start + a)] = entry;
                        }
                    }
                }
                Part::Positive { at, weight } => {
                    let inverse = 1.0 / (1.0 + u[*at]);
                    gradient[*at] = weight * (1.0 - inverse);
                    curvature[(*at, *at)] = weight * inverse * inverse;
                }
            }
        }
        (gradient, curvature)
    }

    /// The curvature of data and reference together in the coordinates `by`.
    fn curvature(&self, u: &DVector<f64>, by: &DMatrix<f64>, weight: f64) -> DMatrix<f64> {
        let (_, own) = self.derivatives(u);
        let mut curvature = by.tr_mul(&(own * by)) * weight;
        for (j, value) in self.values.iter().enumerate() {
            curvature[(j, j)] += value * value / (value * value + weight);
        }
        curvature
    }

    /// The variances of parameters by the reference alone; infinite where it says nothing.
    fn reference_variances(&self, u: &DVector<f64>, weight: f64) -> Vec<f64> {
        let (_, mut curvature) = self.derivatives(u);
        let silent: Vec<bool> = (0..u.len()).map(|j| curvature[(j, j)] == 0.0).collect();
        silent.iter().enumerate().filter(|(_, silent)| **silent).for_each(|(j, _)| curvature[(j, j)] = 1.0);
        let Some(inverse) = Cholesky::new(curvature).map(|factor| factor.inverse()) else {
            return vec![f64::INFINITY; u.len()];
        };
        let variance = |j: usize| {
            let row = self.scale.row(j).transpose();
            let unknown = row.iter().zip(&silent).any(|(factor, silent)| *silent && *factor != 0.0);
            if unknown { f64::INFINITY } else { row.dot(&(&inverse * &row)) / weight }
        };
        (0..u.len()).map(variance).collect()
    }

    /// The minimum at one weight, from a possible point.
    fn newton(&self, start: DVector<f64>, weight: f64) -> Option<DVector<f64>> {
        let by = self.by(weight);
        let divisor = |j: usize| (self.values[j] * self.values[j] + weight).sqrt();
        let mut u = start;
        let mut z = self.turn.tr_mul(&u);
        for j in 0..z.len() {
            z[j] *= if j < self.values.len() { divisor(j) } else { weight.sqrt() };
        }
        let misfit = |z: &DVector<f64>| {
            DVector::from_fn(self.values.len(), |j, _| self.values[j] / divisor(j) * z[j] - self.right[j])
        };
        for _ in 0..STEPS {
            let short = misfit(&z);
            let mut gradient = by.tr_mul(&self.derivatives(&u).0) * weight;
            for (j, short) in short.iter().enumerate() {
                gradient[j] += self.values[j] / divisor(j) * short;
            }
            let step = -Cholesky::new(self.curvature(&u, &by, weight))?.solve(&gradient);
            let slope = gradient.dot(&step);
            if !slope.is_finite() {
                return None;
            }
            if -slope <= LEFT * weight {
                break;
            }
            let before = self.divergence(&u);
            let moved = &by * &step;
            let mut share = 1.0;
            let found = loop {
                let next = &u + &moved * share;
                let after = self.divergence(&next);
                // Differences of squares, so that a small decrease of a large sum keeps its digits.
                let gained = DVector::from_fn(short.len(), |j, _| self.values[j] / divisor(j) * step[j] * share);
                let change = gained.dot(&(&short + &gained * 0.5)) + weight * (after - before);
                if change <= DECREASE * share * slope {
                    break Some(next);
                }
                share *= 0.5;
                if share < 1e-12 {
                    break None;
                }
            };
            // Rounding hides any further decrease.
            let Some(next) = found else { break };
            z += &step * share;
            u = next;
        }
        Some(u)
    }
}
