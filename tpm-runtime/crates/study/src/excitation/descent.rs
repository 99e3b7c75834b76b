//! Minimisation of a smooth function by the quasi-Newton method of Broyden, Fletcher, Goldfarb and Shanno.
//!
//! Invariant: a step is taken only to a point at which the function is finite and has decreased enough (Armijo), so that a function that is
//! infinite outside a set keeps the search inside.

use tpm_numerics::{DMatrix, DVector};

/// Share of the predicted decrease that a step must bring.
const DECREASE: f64 = 1e-4;
/// Most halvings of a step.
const HALVINGS: usize = 30;
/// Longest step in a number of the point.
const LONGEST: f64 = 0.5;
/// The search ends after this many successive steps that decrease the function by less than its share of the value.
const IDLE: usize = 5;
const LEAST_DECREASE: f64 = 1e-6;

/// Goes downhill from a point, in place, and returns the value there. `function` writes the gradient into its second argument; `go_on`
/// sees the value after every step, of which there are at most `steps`.
pub(super) fn descend(
    point: &mut DVector<f64>,
    steps: usize,
    mut function: impl FnMut(&[f64], &mut [f64]) -> f64,
    go_on: impl Fn(f64) -> bool,
) -> f64 {
    let size = point.len();
    let mut gradient = DVector::zeros(size);
    let mut value = function(point.as_slice(), gradient.as_mut_slice());
    let mut inverse: Option<DMatrix<f64>> = None;
    let mut next_gradient = DVector::zeros(size);
    let mut idle = 0;
    for _ in 0..steps {
        if !value.is_finite() || !go_on(value) {
            break;
        }
        let mut direction = match &inverse {
            Some(inverse) => -(inverse * &gradient),
            None => -&gradient,
        };
        let mut slope = direction.dot(&gradient);
        if slope >= 0.0 {
            inverse = None;
            direction = -&gradient;
            slope = -gradient.norm_squared();
        }
        let longest = direction.amax();
        if longest == 0.0 || !longest.is_finite() {
            break;
        }
        // The first step has no scale of its own.
        let mut length = if inverse.is_some() { (LONGEST / longest).min(1.0) } else { 0.1 / longest };
        let mut accepted = None;
        for _ in 0..HALVINGS {
            let next = &*point + length * &direction;
            let found = function(next.as_slice(), next_gradient.as_mut_slice());
            if found.is_finite() && found <= value + DECREASE * length * slope {
                accepted = Some((next, found));
                break;
            }
            length *= 0.5;
        }
        let Some((next, found)) = accepted else {
            // A direction from a poor model of the curvature is given up for the steepest one.
            if inverse.take().is_none() {
                break;
            }
            continue;
        };
        let step = &next - &*point;
        let change = &next_gradient - &gradient;
        update(&mut inverse, &step, &change);
        idle = if value - found > LEAST_DECREASE * value.abs().max(1e-3) { 0 } else { idle + 1 };
        *point = next;
        std::mem::swap(&mut gradient, &mut next_gradient);
        value = found;
        if idle >= IDLE {
            break;
        }
    }
    value
}

/// The inverse of the curvature after a step with this change of the gradient.
fn update(inverse: &mut Option<DMatrix<f64>>, step: &DVector<f64>, change: &DVector<f64>) {
    let product = step.dot(change);
    if product <= 1e-10 * step.norm() * change.norm() {
        return;
    }
    let size = step.len();
    let h = inverse.get_or_insert_with(|| DMatrix::identity(size, size) * (product / change.norm_squared()));
    let hy = &*h * change;
    let factor = (1.0 + change.dot(&hy) / product) / product;
    h.ger(factor, step, step, 1.0);
    h.ger(-1.0 / product, step, &hy, 1.0);
    h.ger(-1.0 / product, &hy, step, 1.0);
}

#[cfg(test)]
mod tests {
    use super::descend;
    use tpm_numerics::DVector;

    #[test]
    fn the_valley_of_rosenbrock_is_followed_to_its_end() {
        let mut point = DVector::from_vec(vec![-1.2, 1.0]);
        let value = descend(
            &mut point,
            200,
            |x, gradient| {
                let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
                gradient[0] = -2.0 * a - 400.0 * x[0] * b;
                gradient[1] = 200.0 * b;
                a * a + 100.0 * b * b
            },
            |_| true,
        );
        assert!(value < 1e-10 && (point[0] - 1.0).abs() < 1e-4, "{value} {point}");
    }

    #[test]
    fn a_barrier_is_not_passed() {
        let mut point = DVector::from_vec(vec![0.0, 0.0]);
        descend(
            &mut point,
            100,
            |x, gradient| {
                let room = 1.0 - x[0];
                if room <= 0.0 {
                    return f64::INFINITY;
                }
                gradient[0] = -1.0 + 1e-3 / room;
                gradient[1] = 2.0 * (x[1] - 0.3);
                -x[0] - 1e-3 * room.ln() + (x[1] - 0.3) * (x[1] - 0.3)
            },
            |_| true,
        );
        assert!((point[0] - 0.999).abs() < 1e-4 && (point[1] - 0.3).abs() < 1e-3, "{point}");
    }
}
