//! What fits of the rig's records are held against: the true spread of its parameters, and the Cramer-Rao bound.

use tpm_numerics::{DMatrix, DVector, root_mean_square};
use tpm_test_support::rig::{SAMPLE_TIME, TRUTH};

/// Parameters near the truth.
pub(crate) const START: [f64; 3] = [1.04 * TRUTH[0], 0.9 * TRUTH[1], 1.02 * TRUTH[2]];

/// The band that the ratio of a spread to the true deviation keeps to with 99.8 %, for a number of fits: roots of chi-squared over its
/// degrees of freedom (Wilson and Hilferty).
fn band(fits: usize) -> std::ops::Range<f64> {
    let spread = 2.0 / (9.0 * fits as f64);
    let edge = |z: f64| (1.0 - spread + z * spread.sqrt()).powf(1.5);
    edge(-3.09)..edge(3.09)
}

/// Checks the scores of every parameter, errors in units of the stated deviation fit by fit, and returns the share of all within 1.96.
pub(crate) fn calibrated(what: &str, scores: [Vec<f64>; 3]) -> f64 {
    let ratios = scores.each_ref().map(|scores| root_mean_square(scores.iter().copied()));
    assert!(ratios.iter().all(|ratio| band(scores[0].len()).contains(ratio)), "{what}: {ratios:?}");
    let all: Vec<f64> = scores.concat();
    all.iter().filter(|z| z.abs() < 1.96).count() as f64 / all.len() as f64
}

/// A and b of `[x, v]_{k+1} = A [x, v]_k + b u_k` for the linear machine under a held force, by the series of the matrix exponential.
fn transition([m, d, k]: [f64; 3]) -> ([[f64; 2]; 2], [f64; 2]) {
    let rate = [[0.0, 1.0, 0.0], [-k / m, -d / m, 1.0 / m], [0.0; 3]];
    let mut term = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut sum = term;
    for order in 1..20 {
        let mut next = [[0.0; 3]; 3];
        for (r, row) in next.iter_mut().enumerate() {
            for (c, entry) in row.iter_mut().enumerate() {
                *entry = (0..3).map(|i| term[r][i] * rate[i][c]).sum::<f64>() * SAMPLE_TIME / f64::from(order);
            }
        }
        term = next;
        for (row, add) in sum.iter_mut().zip(&term) {
            row.iter_mut().zip(add).for_each(|(entry, add)| *entry += add);
        }
    }
    ([[sum[0][0], sum[0][1]], [sum[1][0], sum[1][1]]], [sum[0][2], sum[1][2]])
}

/// Positions, then velocities of the linear machine under a held force, in units of their noise, from parameters and starting state.
fn readings(unknown: &[f64; 5], force: &[f64], [of_position, of_velocity]: [f64; 2]) -> Vec<f64> {
    let (a, b) = transition([unknown[0], unknown[1], unknown[2]]);
    let [mut x, mut v] = [unknown[3], unknown[4]];
    let step = |u: &f64| {
        let before = (x / of_position, v / of_velocity);
        (x, v) = (a[0][0] * x + a[0][1] * v + b[0] * u, a[1][0] * x + a[1][1] * v + b[1] * u);
        before
    };
    let (mut positions, velocities): (Vec<f64>, Vec<f64>) = force.iter().map(step).unzip();
    positions.extend(velocities);
    positions
}

/// Least deviations of the parameters for white noise of the sensors and a force that is known, the starting state unknown.
pub(crate) fn cramer_rao(force: &[f64], noise: [f64; 2]) -> [f64; 3] {
    let at = [TRUTH[0], TRUTH[1], TRUTH[2], 0.266, 0.0];
    let sensitivity = DMatrix::from_columns(
        &[1e-4, 1e-4, 1e-3, 1e-4, 1e-4]
            .iter()
            .enumerate()
            .map(|(j, step)| {
                let moved = |by: f64| {
                    let mut unknown = at;
                    unknown[j] += by;
                    readings(&unknown, force, noise)
                };
                let (after, before) = (moved(*step), moved(-step));
                DVector::from_iterator(after.len(), after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * step)))
            })
            .collect::<Vec<_>>(),
    );
    let covariance = sensitivity.tr_mul(&sensitivity).cholesky().expect("all show").inverse();
    [0, 1, 2].map(|j| covariance[(j, j)].sqrt())
}
