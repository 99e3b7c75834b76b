//! The fastest and the largest motion along a pattern that motors can follow.
//!
//! Invariant: the share of the limits that a motion uses is a continuous function of its frequency and of its size. The bound
//! is the first value, going up from slow or small motions, at which the share is 1: every slower or smaller motion is feasible,
//! as far as a grid of steps of a fifth shows; the root itself is found to rounding.

use crate::actuator::demand::Demand;
use crate::actuator::motor::{Limit, Motor};
use crate::actuator::requirement::{Requirement, requirements};
use tpm_motion::TrialError;
use tpm_motion::trajectory::Trajectory;
use tpm_numerics::Iteration;

/// Samples of a period while the bound is bracketed.
const BRACKET_SAMPLES: usize = 512;
/// Samples of a period while the bound is refined.
const ROOT_SAMPLES: usize = 2048;
/// The search for the root in its bracket, which ends at rounding of the root.
const ROOT_SEARCH: Iteration = Iteration { most: 80, settled: 4.0 * f64::EPSILON };
/// Ratio of neighbouring values of the grid.
const GRID_RATIO: f64 = 1.2;
/// Factor by which the grid reaches below and above the given value.
const GRID_REACH: f64 = 1e3;

/// The largest feasible frequency or size of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// Feasible up to this value, where one input meets one limit.
    At {
        /// Frequency (rad/s) or factor of the amplitudes.
        value: f64,
        /// Index of the input.
        input: usize,
        /// The limit that the input meets.
        limit: Limit,
    },
    /// Not even slow or small motions are feasible.
    Never {
        /// Index of the input.
        input: usize,
        /// The limit that the input meets.
        limit: Limit,
    },
    /// No limit is met up to this value, the end of the grid.
    Beyond(f64),
}

/// The largest share of a limit that is used, with the input and the limit.
fn share(found: &[Requirement]) -> (f64, usize, Limit) {
    found.iter().fold((0.0, 0, Limit::Current), |most, requirement| {
        let worst = requirement.worst();
        if worst.share() > most.0 { (worst.share(), requirement.input, worst.limit) } else { most }
    })
}

/// The largest feasible frequency (rad/s), or the largest feasible factor on all amplitudes, searched upwards from a
/// thousandth of `near`; `motion` gives the trajectory for a value of it.
///
/// # Errors
/// [`TrialError`] when a motion cannot be evaluated.
pub fn bound(
    demand: &Demand<'_>,
    motors: &[Option<Motor>],
    near: f64,
    mut motion: impl FnMut(f64) -> Result<Trajectory, TrialError>,
) -> Result<Bound, TrialError> {
    let mut used = |value: f64, samples: usize| -> Result<(f64, usize, Limit), TrialError> {
        let trajectory = motion(value)?;
        let least = 16 * (trajectory.highest_harmonic() as usize).next_power_of_two();
        Ok(share(&requirements(demand, motors, &trajectory, samples.max(least))?))
    };
    // 1. The smallest value of the grid, which must be feasible.
    let mut low = near / GRID_REACH;
    let (first, input, limit) = used(low, BRACKET_SAMPLES)?;
    if first > 1.0 {
        return Ok(Bound::Never { input, limit });
    }
    // 2. A bracket of the first value at which a limit is met.
    let mut high = low * GRID_RATIO;
    while used(high, BRACKET_SAMPLES)?.0 <= 1.0 {
        low = high;
        high *= GRID_RATIO;
        if high > near * GRID_REACH {
            return Ok(Bound::Beyond(low));
        }
    }
    // The finer period may move the root a little beyond the bracket.
    (low, high) = (low / 1.01, high * 1.01);
    let mut ends = [used(low, ROOT_SAMPLES)?.0 - 1.0, used(high, ROOT_SAMPLES)?.0 - 1.0];
    let (mut a, mut b) = (low, high);
    // 3. The root, by the method of false position with halved weights (the Illinois rule): the share is smooth but for
    // corners where another limit takes over.
    for _ in 0..ROOT_SEARCH.most {
        if (b - a).abs() <= ROOT_SEARCH.settled * b {
            break;
        }
        let mut middle = (a * ends[1] - b * ends[0]) / (ends[1] - ends[0]);
        if !(middle > a && middle < b) {
            middle = 0.5 * (a + b);
        }
        let value = used(middle, ROOT_SAMPLES)?.0 - 1.0;
        if value == 0.0 {
            (a, b) = (middle, middle);
        } else if value > 0.0 {
            (b, ends) = (middle, [ends[0] / 2.0, value]);
        } else {
            (a, ends) = (middle, [value, ends[1] / 2.0]);
        }
    }
    let (_, input, limit) = used(b, ROOT_SAMPLES)?;
    Ok(Bound::At { value: a, input, limit })
}

/// All amplitudes times a factor.
#[must_use]
pub fn scaled(amplitudes: &[f64], factor: f64) -> Vec<f64> {
    amplitudes.iter().map(|amplitude| factor * amplitude).collect()
}

#[cfg(test)]
mod tests {
    use super::{Bound, bound, scaled};
    use crate::actuator::demand::Demand;
    use crate::actuator::motor::tests::feng;
    use crate::actuator::motor::{Limit, Limits, Motor};
    use tpm_motion::trajectory::{HarmonicSeries, Line, Part, ReferencePattern};
    use tpm_test_support::models::MassSpringDrag;

    fn cosine() -> ReferencePattern {
        let series = HarmonicSeries { mean: 0.0, lines: vec![Line { harmonic: 1, cos: 1.0, sin: 0.0 }] };
        ReferencePattern {
            name: None,
            amplitudes: vec!["lambda".into()],
            frequency: "w".into(),
            coordinates: vec![vec![Part { powers: vec![(0, 1)], frequency_power: 0, series }]],
            others: vec![],
        }
    }

    #[test]
    fn the_bound_of_an_inertia_is_c12() {
        let motor = Motor { limits: Limits { current: 12.3, ..Limits::default() }, ..feng() };
        let inertia = 4.4e-3;
        let demand = Demand::new(&MassSpringDrag, &[inertia, 0.0, 0.0], &[], &[vec![0]]);
        let pattern = cosine();
        let found = bound(&demand, &[Some(motor)], 3.0, |w| Ok(pattern.trajectory(&[5.0], w))).expect("a model");
        let Bound::At { value, input: 0, limit: Limit::Current } = found else { panic!("{found:?}") };
        let expected = motor.cut_off(5.0, inertia);
        assert!((value - expected).abs() < 1e-12 * expected, "{value} {expected}");
        // The other way round: the largest amplitude at that frequency.
        let sized = |factor: f64| Ok(pattern.trajectory(&scaled(&[0.1], factor), expected));
        let found = bound(&demand, &[Some(motor)], 1.0, sized).expect("a model");
        let Bound::At { value, .. } = found else { panic!("{found:?}") };
        assert!((value - 50.0).abs() < 1e-10, "{value}");
    }

    #[test]
    fn what_is_never_or_always_feasible_is_said() {
        let demand = Demand::new(&MassSpringDrag, &[1e-3, 400.0, 0.0], &[], &[vec![0]]);
        let pattern = cosine();
        let found = bound(&demand, &[Some(feng())], 3.0, |w| Ok(pattern.trajectory(&[5.0], w))).expect("a model");
        assert!(
            matches!(found, Bound::Never { input: 0, .. }),
            "a spring that the stalled motor cannot hold: {found:?}"
        );
        let strong = Motor { limits: Limits::default(), ..feng() };
        let found = bound(&demand, &[Some(strong)], 3.0, |w| Ok(pattern.trajectory(&[5.0], w))).expect("a model");
        assert!(matches!(found, Bound::Beyond(_)));
    }
}
