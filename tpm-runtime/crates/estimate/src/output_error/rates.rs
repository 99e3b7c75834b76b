//! Measured rates as readings of the motion.
//!
//! A column of rates may be a tachometer's. It may also have been computed from the positions by a drive, late by a filter and with their
//! noise. A rate is a reading of its own where it differs from the rate of the estimated motion by white noise alone:
//!
//! ```text
//! rate_k - v_k = gain v_k - delay dv/dt + offset + e_k ,
//! ```
//!
//! with gain, delay, offset and the correlation of neighbouring e_k all zero within chance.

use crate::output_error::problem::{Differentiable, Problem};
use crate::output_error::signals::{Rate, Signals};
use crate::output_error::state::State;
use tpm_numerics::{DMatrix, DVector, alarm};

/// What a measured rate is to the fit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct RateUse {
    /// The coordinate.
    pub coordinate: usize,
    /// Standard deviation of its noise, unit of the coordinate per second; nothing where it was not compared with the motion.
    pub noise: Option<f64>,
    /// Why it is not used; nothing where it is.
    pub fault: Option<RateFault>,
}

/// Why a measured rate is no reading of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum RateFault {
    /// The rate is so many times that of the motion.
    Gain(f64),
    /// It comes so many seconds after the motion; negative where it comes before it.
    Late(f64),
    /// It is off by so much, unit of the coordinate per second.
    Offset(f64),
    /// Its errors are correlated from sample to sample.
    Coloured(f64),
    /// The simulation found no motion with which it could be compared.
    NotCompared,
}

/// The record with those of its measured rates that are readings of the motion, what every rate is to the fit, and the parameters with
/// which the rates were compared.
pub(super) fn trusted<'a>(
    machine: Differentiable<'a>,
    constants: &'a [f64],
    signals: &Signals<'a>,
    start: &[f64],
    free: &[usize],
    hidden: &[Vec<f64>],
) -> (Signals<'a>, Vec<RateUse>, Vec<f64>) {
    let offered = signals.rates.clone();
    let mut without = Signals { rates: Vec::new(), ..signals.clone() };
    if offered.is_empty() {
        return (without, Vec::new(), start.to_vec());
    }
    let unused =
        |rate: &Rate<'_>| RateUse { coordinate: rate.coordinate, noise: None, fault: Some(RateFault::NotCompared) };
    let settled = || {
        let noise = without.noise();
        let mut problem = Problem::new(machine, constants, &without, &noise, free, hidden).ok()?;
        let mut state = State::begun(&problem, &without, noise, start);
        problem.steps = problem.needed_steps(&state.trajectory, &state.theta).ok()?;
        state.settle(&problem, &without, true).ok()?;
        // While a friction's force is free the velocity is that of noisy positions.
        let loose = problem.loose(&state.trajectory, &state.theta).ok()?;
        let switches = machine.derivatives.switches();
        let free = |k: usize| loose[k * switches..(k + 1) * switches].iter().any(|size| *size > 0.0);
        let apart: Vec<bool> = problem.breaks.iter().enumerate().map(|(k, breaks)| *breaks || free(k)).collect();
        Some((problem, state, apart))
    };
    let Some((problem, state, apart)) = settled() else {
        return (without, offered.iter().map(unused).collect(), start.to_vec());
    };
    let n = problem.states.len();
    let uses: Vec<RateUse> = (offered.iter())
        .map(|rate| {
            let place = problem.states.iter().position(|&of| of == (rate.coordinate, 1));
            let compared = place.and_then(|s| {
                let velocity: Vec<f64> = state.trajectory.states.iter().skip(s).step_by(n).copied().collect();
                compared(rate.readings, &velocity, &apart, problem.sample_time)
            });
            compared
                .map_or_else(|| unused(rate), |(noise, fault)| RateUse { noise: Some(noise), fault, ..unused(rate) })
        })
        .collect();
    let theta = state.theta;
    for (rate, found) in offered.iter().zip(&uses) {
        if let (Some(noise), None) = (found.noise, found.fault) {
            without.rates.push(Rate { noise, ..rate.clone() });
        }
    }
    (without, uses, theta)
}

/// Standard deviation of the errors of a rate beside the velocity of a motion, and what is wrong with it, over samples before and behind
/// which the motion is not `apart`; nothing where they are too few or do not move.
pub(crate) fn compared(
    rate: &[f64],
    velocity: &[f64],
    apart: &[bool],
    sample_time: f64,
) -> Option<(f64, Option<RateFault>)> {
    let inner = |k: usize| !apart[k - 1] && !apart[k];
    let places: Vec<usize> = (1..velocity.len().saturating_sub(1)).filter(|&k| inner(k)).collect();
    let count = places.len() as f64;
    let columns = DMatrix::from_fn(places.len(), 3, |i, c| {
        let k = places[i];
        [velocity[k], -0.5 * (velocity[k + 1] - velocity[k - 1]) / sample_time, 1.0][c]
    });
    let errors = DVector::from_fn(places.len(), |i, _| rate[places[i]] - velocity[places[i]]);
    let normal = columns.tr_mul(&columns).cholesky()?;
    let found = normal.solve(&columns.tr_mul(&errors));
    let left = errors - columns * &found;
    let noise = (left.norm_squared() / (count - 3.0).max(1.0)).sqrt();
    let inverse = normal.inverse();
    let deviations = |at: usize| found[at].abs() / (noise * inverse[(at, at)].sqrt()).max(f64::MIN_POSITIVE);
    let surest = (0..3)
        .max_by(|&a, &b| deviations(a).total_cmp(&deviations(b)))
        .filter(|&at| deviations(at) > alarm::RATE_FAULT);
    let products: f64 =
        (1..places.len()).filter(|&i| places[i] == places[i - 1] + 1).map(|i| left[i] * left[i - 1]).sum();
    let correlation = products / left.norm_squared().max(f64::MIN_POSITIVE);
    let fault = match surest {
        Some(0) => Some(RateFault::Gain(1.0 + found[0])),
        Some(1) => Some(RateFault::Late(found[1])),
        Some(_) => Some(RateFault::Offset(found[2])),
        None => (correlation.abs() * count.sqrt() > alarm::RATE_FAULT).then_some(RateFault::Coloured(correlation)),
    };
    Some((noise, fault))
}

#[cfg(test)]
mod tests {
    use super::{RateFault, compared};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const H: f64 = 0.002;

    fn noise(seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..4000).map(|_| StandardNormal.sample(&mut rng)).collect()
    }

    fn velocity(late: f64) -> Vec<f64> {
        (0..4000).map(|k| (8.0 * (f64::from(k) * H - late)).sin()).collect()
    }

    #[test]
    fn a_rate_with_white_noise_is_a_reading_and_what_is_wrong_with_others_is_told() {
        let apart = vec![false; 3999];
        let true_rate = velocity(0.0);
        let of = |rate: &[f64]| compared(rate, &true_rate, &apart, H).expect("long enough");
        for seed in 0..50 {
            let rate: Vec<f64> = true_rate.iter().zip(noise(seed)).map(|(v, e)| v + 0.02 * e).collect();
            let (size, fault) = of(&rate);
            assert!(fault.is_none() && (size / 0.02 - 1.0).abs() < 0.06, "{seed}: {size} {fault:?}");
        }
        let e = noise(60);
        let with = |late: f64, gain: f64, offset: f64, colour: f64| -> Vec<f64> {
            let mut before = 0.0;
            let coloured = e.iter().map(|e| {
                before = colour * before + e;
                0.02 * before
            });
            velocity(late).iter().zip(coloured).map(|(v, e)| gain * v + offset + e).collect()
        };
        assert!(matches!(of(&with(0.0, 1.01, 0.0, 0.0)).1, Some(RateFault::Gain(gain)) if (gain - 1.01).abs() < 3e-3));
        assert!(matches!(of(&with(1e-3, 1.0, 0.0, 0.0)).1, Some(RateFault::Late(late)) if (late - 1e-3).abs() < 3e-4));
        assert!(matches!(of(&with(0.0, 1.0, 0.01, 0.0)).1, Some(RateFault::Offset(off)) if (off - 0.01).abs() < 2e-3));
        assert!(matches!(of(&with(0.0, 1.0, 0.0, 0.4)).1, Some(RateFault::Coloured(by)) if (by - 0.4).abs() < 0.1));
    }
}
