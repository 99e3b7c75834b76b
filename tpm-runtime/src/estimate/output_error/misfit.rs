//! What a model leaves of a record, and which single term would take most of it.
//!
//! Every candidate term is one more column of the linearised record. One pass gives, for each, the value that it would have, by how
//! much it lowers the sum of squares, and how far it would move the parameters. Under a right model a candidate's gain, over the
//! variance that is left, follows chi-squared with one degree of freedom, so that the rate of false alarms is known. Candidates are
//! taken in one after the other while the best one is significant.
//!
//! Deviations grow with what is found: by the distance that the parameters move when the significant candidates are part of the
//! model, since nobody knows whether they should be, and by the power that is left at the harmonics of the motion, where noise has no
//! reason to be stronger than elsewhere.

use crate::estimate::output_error::fit::{OutputErrorFault, Signals, Solution};
use crate::estimate::output_error::problem::{Column, Place, Problem};
use crate::estimate::output_error::smoother::{Noise, Smoothed};
use crate::numerics::DVector;
use num_complex::Complex;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;

/// Rate of false alarms of all candidates together.
const FALSE_ALARMS: f64 = 0.01;
/// Most candidates that are taken in.
const MOST_TERMS: usize = 3;
/// A candidate whose column is explained by the others but for this share of its power says nothing of its own.
const OWN: f64 = 1e-8;
/// Harmonics at which the residual is compared with its neighbours.
const HARMONICS: usize = 24;
/// Standard deviations beyond which the power at the harmonics, or the correlation of neighbouring residuals, is no chance.
const CHANCE: f64 = 4.5;
/// Limits of an input that are tried, as shares of its largest value.
const LIMITS: [f64; 14] = [0.04, 0.06, 0.09, 0.13, 0.18, 0.24, 0.31, 0.39, 0.48, 0.58, 0.68, 0.78, 0.87, 0.95];

/// A term that a model may lack.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum CandidateKind {
    /// A constant force, or an offset of a sensor or of an input.
    Offset,
    /// A power of a coordinate.
    Power {
        /// The coordinate.
        coordinate: usize,
        /// The exponent.
        exponent: u32,
    },
    /// A product of two coordinates.
    Product {
        /// One coordinate.
        coordinate: usize,
        /// The other one.
        other: usize,
    },
    /// A power of a velocity.
    RatePower {
        /// The coordinate.
        coordinate: usize,
        /// The exponent.
        exponent: u32,
    },
    /// Drag, `v |v|`.
    Drag {
        /// The coordinate.
        coordinate: usize,
    },
    /// Dry friction, `sign(v)`.
    Friction {
        /// The coordinate.
        coordinate: usize,
    },
    /// More friction at low speed than at high speed.
    Stribeck {
        /// The coordinate.
        coordinate: usize,
    },
    /// A parameter that changes over the record.
    Drift {
        /// The parameter.
        parameter: usize,
    },
    /// An input, or a sensor, that is late: the value is the delay, s.
    Delay {
        /// The input.
        input: usize,
    },
    /// Dynamics between an input and the sensors: a flexible mode, or a lag of the second order.
    Flexible {
        /// The input.
        input: usize,
    },
    /// An input that does not go beyond a limit; the value is one where it is cut off sharply.
    Limit {
        /// The input.
        input: usize,
        /// The limit, unit of the input.
        limit: f64,
    },
    /// A reading that depends on the direction of the motion: backlash, or hysteresis.
    Backlash {
        /// The coordinate.
        coordinate: usize,
    },
}

/// A term that would explain what a model leaves.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Candidate {
    /// The term.
    pub term: CandidateKind,
    /// The row on which it acts; nothing for one that acts on a reading.
    pub row: Option<usize>,
    /// Its factor, in the units of row and term.
    pub value: f64,
    /// Standard deviation of the factor.
    pub std: f64,
    /// Share of the unexplained sum of squares that it takes.
    pub gain: f64,
}

/// What a model leaves of a record.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Misfit {
    /// Variance of the innovations, in units of what the noise model states.
    pub scale: f64,
    /// Correlation of neighbouring innovations.
    pub correlation: f64,
    /// Mean power of the innovations at the harmonics of the motion, in units of their power elsewhere.
    pub periodic: f64,
    /// Whether that power is beyond chance.
    pub repeats: bool,
    /// Significant candidates, the strongest first.
    pub terms: Vec<Candidate>,
    /// How far every free parameter moves when these terms are part of the model.
    pub shift: Vec<f64>,
    /// Factor on variances for what no candidate explains.
    pub inflation: f64,
}

/// A candidate with its column.
pub(super) struct Proposed {
    term: CandidateKind,
    pub(super) column: Column,
}

/// The candidates of a record, along the estimated motion.
pub(super) fn columns(
    problem: &Problem<'_>,
    signals: &Signals<'_>,
    motion: &[f64],
    theta: &[f64],
) -> Result<Vec<Proposed>, OutputErrorFault> {
    let model = problem.machine.model;
    let dims = model.dims();
    let (n, samples) = (problem.states.len(), problem.samples());
    let (regressors, maps) = problem.along(motion, theta)?;
    let state = |c: usize, d: usize| problem.states.iter().position(|&of| of == (c, d));
    let series = |s: usize| -> Vec<f64> { motion.iter().skip(s).step_by(n).copied().collect() };
    let positions: Vec<Vec<f64>> = (0..dims.coordinates).filter_map(|c| state(c, 0)).map(series).collect();
    let rates: Vec<Vec<f64>> = (0..dims.coordinates)
        .map(|c| state(c, 1).map_or_else(|| vec![0.0; samples], |s| motion.iter().skip(s).step_by(n).copied().collect()))
        .collect();
    let mut proposed = Vec::new();
    let held = problem.hold == Hold::Zoh;
    for row in 0..dims.rows {
        let mut add = |term: CandidateKind, values: Vec<f64>, held: bool| {
            proposed.push(Proposed { term, column: Column { place: Place::Row(row), values, held } });
        };
        add(CandidateKind::Offset, vec![1.0; samples], false);
        for coordinate in 0..dims.coordinates {
            if dims.coordinates > 2 && coordinate != row {
                continue;
            }
            let (x, v) = (&positions[coordinate], &rates[coordinate]);
            let middle = x.iter().sum::<f64>() / samples.max(1) as f64;
            let speed = (v.iter().map(|v| v * v).sum::<f64>() / samples.max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
            let of = |values: &[f64], f: &dyn Fn(f64) -> f64| -> Vec<f64> { values.iter().map(|&value| f(value)).collect() };
            for exponent in [2, 3] {
                let value = |x: f64| if middle.abs() > 1e9 { x } else { x.powi(exponent as i32) };
                add(CandidateKind::Power { coordinate, exponent }, of(x, &value), false);
            }
            add(CandidateKind::RatePower { coordinate, exponent: 2 }, of(v, &|v| v * v), false);
            add(CandidateKind::RatePower { coordinate, exponent: 3 }, of(v, &|v| v * v * v), false);
            add(CandidateKind::Drag { coordinate }, of(v, &|v| v * v.abs()), false);
            let sign = |v: f64| (v / (0.02 * speed)).tanh();
            add(CandidateKind::Friction { coordinate }, of(v, &sign), false);
            let slow = |v: f64| sign(v) * (-(v / (0.2 * speed)).powi(2)).exp();
            add(CandidateKind::Stribeck { coordinate }, of(v, &slow), false);
            if dims.coordinates == 2 && coordinate == 0 {
                let product = x.iter().zip(&positions[1]).map(|(a, b)| a * b).collect();
                add(CandidateKind::Product { coordinate: 0, other: 1 }, product, false);
            }
        }
        let at = |k: usize| 2.0 * k as f64 / samples.max(1) as f64 - 1.0;
        for &parameter in &problem.free {
            let entry = |k: usize| regressors[k * dims.regressor_len() + row * dims.parameters + parameter];
            let first = (0..row).all(|r| {
                (0..samples).all(|k| regressors[k * dims.regressor_len() + r * dims.parameters + parameter].abs() <= 0.0)
            });
            if first {
                add(CandidateKind::Drift { parameter }, (0..samples).map(|k| entry(k) * at(k)).collect(), false);
            }
        }
        for (input, u) in signals.inputs.iter().enumerate() {
            let factor = |k: usize| maps[k * dims.input_map_len() + row * dims.inputs + input];
            if (0..samples).all(|k| factor(k).abs() <= 0.0) {
                continue;
            }
            let h = problem.sample_time;
            let before = |k: usize, by: usize| u[k.saturating_sub(by)];
            add(
                CandidateKind::Delay { input },
                (0..samples).map(|k| factor(k) * (u[k] - before(k, 1)) / h).collect(),
                held,
            );
            let bend = |k: usize| (u[k] - 2.0 * before(k, 1) + before(k, 2)) / (h * h);
            add(CandidateKind::Flexible { input }, (0..samples).map(|k| factor(k) * bend(k)).collect(), held);
            let peak = u.iter().map(|u| u.abs()).fold(0.0, f64::max);
            for share in LIMITS {
                let limit = share * peak;
                let excess = |k: usize| factor(k) * u[k].signum() * (u[k].abs() - limit).max(0.0);
                add(CandidateKind::Limit { input, limit }, (0..samples).map(excess).collect(), held);
            }
        }
    }
    for (coordinate, v) in rates.iter().enumerate() {
        let speed = (v.iter().map(|v| v * v).sum::<f64>() / samples.max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
        let values = v.iter().map(|v| (v / (0.02 * speed)).tanh()).collect();
        proposed.push(Proposed {
            term: CandidateKind::Backlash { coordinate },
            column: Column { place: Place::Reading(coordinate), values, held: false },
        });
    }
    Ok(proposed)
}

/// What the innovations show, given the first `p` columns for the parameters and the others for the candidates.
pub(super) fn judge(
    smoothed: &Smoothed,
    p: usize,
    proposed: Vec<Proposed>,
    bare: &Solution,
    signals: &Signals<'_>,
    noise: &Noise,
) -> Misfit {
    let width = smoothed.width();
    let m = width - 1 - p;
    let root = |r: usize, c: usize| if c >= r { smoothed.root[r * width + c] } else { 0.0 };
    let freedom = (smoothed.places.len() as f64 - p as f64).max(1.0);
    let rest = root(width - 1, width - 1).powi(2);
    let target = DVector::from_fn(m, |i, _| root(p + i, width - 1));
    let column = |j: usize| DVector::from_fn(m, |i, _| root(p + i, p + j));
    let whole: Vec<f64> = (0..m).map(|j| (0..width - 1).map(|r| root(r, p + j).powi(2)).sum::<f64>()).collect();
    // With quantised readings the noise is stated, and never less than that.
    let least = if signals.counted() { 1.0 } else { 0.0 };
    let significant = 2.0 * (m.max(1) as f64 / FALSE_ALARMS).ln();
    let mut left = target.clone();
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut chosen: Vec<(usize, f64)> = Vec::new();
    let own = |j: usize, basis: &[DVector<f64>]| -> Option<DVector<f64>> {
        let mut column = column(j);
        for direction in basis {
            let share = direction.dot(&column);
            column -= direction * share;
        }
        (column.norm_squared() > OWN * whole[j].max(f64::MIN_POSITIVE)).then_some(column)
    };
    while chosen.len() < MOST_TERMS {
        let gain = |j: usize| own(j, &basis).map(|own| (j, own.dot(&left).powi(2) / own.norm_squared()));
        let best = (0..m).filter(|j| chosen.iter().all(|(i, _)| i != j)).filter_map(gain).max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((j, gain)) = best else { break };
        let after = ((rest + left.norm_squared() - gain) / freedom).max(least);
        if !(gain > significant * after) {
            break;
        }
        let Some(own) = own(j, &basis) else { break };
        let direction = own.normalize();
        let share = direction.dot(&left);
        left -= &direction * share;
        basis.push(direction);
        chosen.push((j, gain));
    }
    let scale = ((rest + left.norm_squared()) / freedom).max(least);
    // The chosen candidates together: values, and how far they move the parameters.
    let q = chosen.len();
    let mut terms = Vec::new();
    let mut shift = vec![0.0; p];
    if q > 0 {
        let matrix = crate::numerics::DMatrix::from_fn(m, q, |i, c| root(p + i, p + chosen[c].0));
        let gram = matrix.tr_mul(&matrix);
        if let Some(cholesky) = gram.cholesky() {
            let values = cholesky.solve(&matrix.tr_mul(&target));
            let covariance = cholesky.inverse();
            let excess: f64 = (rest + target.norm_squared() - scale * freedom).max(f64::MIN_POSITIVE);
            for (c, &(j, gain)) in chosen.iter().enumerate() {
                terms.push(Candidate {
                    term: proposed[j].term,
                    row: match proposed[j].column.place {
                        Place::Row(row) => Some(row),
                        Place::Reading(_) => None,
                    },
                    value: values[c],
                    std: (scale * covariance[(c, c)]).sqrt(),
                    gain: (gain / excess).min(1.0),
                });
            }
            let felt = DVector::from_fn(p, |r, _| (0..q).map(|c| root(r, p + chosen[c].0) * values[c]).sum::<f64>());
            if let Some(moved) = bare.root.solve_upper_triangular(&felt) {
                shift = moved.iter().copied().collect();
            }
        }
    }
    let innovations = smoothed.remaining(p, &bare.step, &chosen.iter().map(|c| c.0).collect::<Vec<_>>(), &terms);
    let correlation = neighbours(&innovations, signals.coordinates.len());
    let (periodic, repeats) = at_harmonics(&innovations, smoothed, signals);
    let repeats = repeats && !signals.counted();
    let correlated = correlation * (innovations.len() as f64).sqrt() > CHANCE && !signals.counted();
    let mut inflation: f64 = if repeats { periodic.max(1.0) } else { 1.0 };
    if correlated {
        inflation = inflation.max((1.0 + correlation) / (1.0 - correlation).max(0.01));
    }
    let _ = noise;
    Misfit { scale, correlation, periodic, repeats, terms, shift, inflation }
}

/// Correlation of successive innovations of the same sensor.
fn neighbours(innovations: &[f64], outputs: usize) -> f64 {
    let power: f64 = innovations.iter().map(|e| e * e).sum();
    let product: f64 = innovations.iter().zip(innovations.iter().skip(outputs)).map(|(a, b)| a * b).sum();
    if power > 0.0 { product / power } else { 0.0 }
}

/// Mean power at the lowest harmonics in units of the mean power, and whether that is beyond chance.
fn at_harmonics(innovations: &[f64], smoothed: &Smoothed, signals: &Signals<'_>) -> (f64, bool) {
    let outputs = signals.coordinates.len();
    let period = signals.samples_per_period;
    let mut power = 0.0;
    let mut count = 0.0;
    for c in 0..outputs {
        let of = || {
            let own = |((_, place), _): &((&f64, &(u32, u32)), ())| place.1 as usize == c;
            innovations.iter().zip(&smoothed.places).zip(std::iter::repeat(())).filter(own)
        };
        let (sum, number) = of().fold((0.0, 0.0), |(sum, number), ((e, _), ())| (sum + e * e, number + 1.0));
        let variance = sum / f64::max(number, 1.0);
        if variance <= 0.0 {
            continue;
        }
        let highest = HARMONICS.min((period / 4.0) as usize);
        for k in 1..=highest {
            let angle = -2.0 * std::f64::consts::PI * k as f64 / period;
            let mut line = Complex::new(0.0, 0.0);
            for ((e, &(sample, _)), ()) in of() {
                let (sine, cosine) = (angle * f64::from(sample)).sin_cos();
                line += Complex::new(e * cosine, e * sine);
            }
            power += line.norm_sqr() / number / variance;
            count += 1.0;
        }
    }
    if count > 0.0 {
        let mean = power / count;
        // |line|^2 over its mean is exponential: mean one, variance one.
        (mean, (mean - 1.0) * f64::sqrt(count) > CHANCE)
    } else {
        (1.0, false)
    }
}
