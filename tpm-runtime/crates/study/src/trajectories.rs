//! A pattern compared with the usual laws of a stroke: the inputs that each needs, and their harmonics (Feng, chapter
//! 2).
//!
//! Invariant: all motions make the strokes of the pattern, forth and back, in the same time. A coordinate whose
//! harmonics are all multiples of m makes m strokes during one of the fundamental. The inputs are sampled in the middle
//! of equal intervals. The corners of all laws lie at the edges of these intervals, so that a jump is never sampled.

use num_integer::gcd;
use serde::Serialize;
use std::f64::consts::PI;
use tpm_motion::TrialError;
use tpm_motion::profile::Law;
use tpm_motion::trajectory::{HarmonicSeries, Trajectory};
use tpm_numerics::fourier::analyse;
use tpm_plant::actuator::Demand;
use tpm_report::number;
use tpm_symbolic::budget;

/// Number of samples in a period: 2^7 3^3 5, so that a third of a stroke is a whole number of samples for up to six
/// strokes in half a period.
pub(super) const SAMPLES: usize = 17_280;
/// Highest harmonic that is computed. The error of the sampling would distort higher ones.
const REACH: usize = 400;
/// Smallest amplitude of a harmonic that counts as needed, as a share of the largest amplitude.
const NEEDED: f64 = 1e-2;
/// Largest velocity at the end of a stroke that counts as rest, as a share of the stroke's mean velocity.
const REST: f64 = 1e-9;

/// Operations for a number that a sample reads or writes, for the budget.
const VISITED: u64 = 1;

/// Why a pattern has no strokes to compare.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StrokeError {
    /// A coordinate moves at an end of its stroke.
    #[error(
        "{coordinate} has the velocity {} at the phase {} of the pattern, and nothing follows that goes on with it: a stroke ends \
         where the pattern rests",
        number(*velocity), number(*phase)
    )]
    Moving {
        /// Name of the coordinate.
        coordinate: String,
        /// Its velocity.
        velocity: f64,
        /// The phase of the coordinate, rad.
        phase: f64,
    },
    /// A coordinate ends where it began.
    #[error("{coordinate} ends where it begins, so that there is no stroke to compare")]
    NoTravel {
        /// Name of the coordinate.
        coordinate: String,
    },
    /// The inputs cannot be computed.
    #[error(transparent)]
    Inputs(#[from] TrialError),
}

/// The demand of a motion on one input.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InputUse {
    /// Name of the input.
    pub input: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Largest magnitude.
    pub peak: f64,
    /// Root mean square.
    pub rms: f64,
    /// Highest harmonic above a hundredth of the largest one.
    pub highest: usize,
    /// Root mean square of all harmonics above the highest that the pattern needs, unit of the input.
    pub beyond: f64,
    /// Magnitude of the mean and of every harmonic.
    pub harmonics: Vec<f64>,
    /// Samples over a period.
    #[serde(skip)]
    pub samples: Vec<f64>,
}

/// Travel and largest velocity and acceleration of a coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CoordinateUse {
    /// Name of the coordinate.
    pub coordinate: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Distance between the ends of its stroke.
    pub travel: f64,
    /// Largest magnitude of the velocity.
    pub velocity: f64,
    /// Largest magnitude of the acceleration.
    pub acceleration: f64,
}

/// One of the motions that are compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Moved {
    /// Name of the motion.
    pub name: String,
    /// The demand on every input; nothing where an input would have to be infinite.
    pub inputs: Option<Vec<InputUse>>,
    /// Travel, velocity and acceleration of the coordinates.
    pub coordinates: Vec<CoordinateUse>,
}

/// A pattern and the laws that are compared with it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trajectories {
    /// Fundamental frequency of the strokes forth and back, rad/s.
    pub frequency: f64,
    /// Highest derivative of a coordinate that an input depends on.
    pub derivatives: usize,
    /// The pattern first, then the laws.
    pub motions: Vec<Moved>,
}

/// A stroke of one coordinate.
struct Stroke<'t> {
    series: &'t HarmonicSeries,
    /// Number of strokes of the coordinate during one stroke of the fundamental.
    multiple: u32,
    start: f64,
    travel: f64,
}

/// Compares the strokes of a pattern from the phase 0 to the phase `end` (rad) with the laws, forth and back. `derivatives` is
/// the highest derivative of a coordinate that an input depends on.
///
/// # Errors
/// [`StrokeError`] when a coordinate does not rest at an end or has no travel, or the inputs cannot be computed.
pub fn trajectories(
    demand: &Demand<'_>,
    trajectory: &Trajectory,
    end: f64,
    derivatives: usize,
) -> Result<Trajectories, StrokeError> {
    let model = demand.model();
    let size = model.dims();
    let widest = size.motion_len() + model.inverse_workspace_len() + 2 * size.input_map_len();
    budget::charge(VISITED.saturating_mul((widest * (Law::ALL.len() + 1)) as u64).saturating_mul(SAMPLES as u64));
    // The stroke of every coordinate, which must rest at both ends.
    let mut strokes = Vec::with_capacity(trajectory.coordinates.len());
    for (c, series) in trajectory.coordinates.iter().enumerate() {
        let multiple = series.lines.iter().fold(0, |all, line| gcd(all, line.harmonic)).max(1);
        let phase = end / f64::from(multiple);
        let [start, finish] = [0.0, phase].map(|phase| series.derivative(phase, trajectory.frequency, 0));
        let size: f64 = series.lines.iter().map(|line| line.cos.hypot(line.sin)).sum();
        let coordinate = || model.coordinate(c).name.to_string();
        for phase in [0.0, phase] {
            let velocity = series.derivative(phase, trajectory.frequency, 1);
            if velocity.abs() > REST * size * f64::from(multiple) * trajectory.frequency {
                return Err(StrokeError::Moving { coordinate: coordinate(), velocity, phase });
            }
        }
        if size > 0.0 && (finish - start).abs() <= REST * size {
            return Err(StrokeError::NoTravel { coordinate: coordinate() });
        }
        strokes.push(Stroke { series, multiple, start, travel: finish - start });
    }
    let frequency = trajectory.frequency * PI / end;
    let of = |law: Option<Law>| -> Result<Moved, StrokeError> {
        let motions = motions(demand, &strokes, frequency, trajectory.frequency, law);
        let dims = model.dims();
        let coordinates = (0..dims.coordinates)
            .map(|c| {
                let peak = |order: usize| {
                    let at = motions.iter().skip(order * dims.coordinates + c).step_by(dims.motion_len());
                    if order > dims.order { 0.0 } else { at.fold(0.0, |most: f64, value| most.max(value.abs())) }
                };
                let label = model.coordinate(c);
                CoordinateUse {
                    coordinate: label.name.into(),
                    unit: label.unit.map(Into::into),
                    travel: strokes[c].travel.abs(),
                    velocity: peak(1),
                    acceleration: peak(2),
                }
            })
            .collect();
        // The derivative of a quantity that jumps is an impulse.
        let finite = law.is_none_or(|law| derivatives <= law.continuous() + 1);
        let inputs = if finite { Some(inputs(demand, motions)?) } else { None };
        Ok(Moved { name: law.map_or("pattern", Law::name).to_string(), inputs, coordinates })
    };
    // The pattern first, then the laws.
    let mut motions = vec![of(None)?];
    for law in Law::ALL {
        motions.push(of(Some(law))?);
    }
    // For every input, the harmonics above those that the pattern needs.
    let needed: Vec<usize> = motions[0].inputs.iter().flatten().map(|input| input.highest).collect();
    for moved in &mut motions {
        for (input, &needed) in moved.inputs.iter_mut().flatten().zip(&needed) {
            let kept: f64 = input.harmonics.iter().take(needed + 1).skip(1).map(|line| line * line / 2.0).sum();
            let mean = input.harmonics.first().map_or(0.0, |mean| mean * mean);
            input.beyond = (input.rms * input.rms - mean - kept).max(0.0).sqrt();
        }
    }
    Ok(Trajectories { frequency, derivatives, motions })
}

/// Samples of the motion over one period, along the pattern or a law, in the layout that models read.
fn motions(
    demand: &Demand<'_>,
    strokes: &[Stroke<'_>],
    frequency: f64,
    own_frequency: f64,
    law: Option<Law>,
) -> Vec<f64> {
    let dims = demand.model().dims();
    let mut all = vec![0.0; SAMPLES * dims.motion_len()];
    for (n, motion) in all.chunks_exact_mut(dims.motion_len()).enumerate() {
        let time = (n as f64 + 0.5) / SAMPLES as f64 * 2.0 * PI / frequency;
        for (c, stroke) in strokes.iter().enumerate() {
            // Duration of one stroke, and the phase within a stroke forth or back.
            let duration = PI / (frequency * f64::from(stroke.multiple));
            let passed = time / duration;
            let (number, tau) = (passed.floor(), passed.fract());
            let back = number % 2.0 != 0.0;
            let tau = if back { 1.0 - tau } else { tau };
            for order in 0..=dims.order {
                let value = match law {
                    None => stroke.series.derivative(tau * duration * own_frequency, own_frequency, order),
                    Some(law) => {
                        let shape = stroke.travel * law.derivative(tau, order) / duration.powi(order as i32);
                        if order == 0 { stroke.start + shape } else { shape }
                    }
                };
                motion[order * dims.coordinates + c] = if back && order % 2 == 1 { -value } else { value };
            }
        }
    }
    all
}

/// The demand of sampled motions on the inputs.
fn inputs(demand: &Demand<'_>, motions: Vec<f64>) -> Result<Vec<InputUse>, TrialError> {
    let model = demand.model();
    let count = model.dims().inputs;
    let whole = demand.whole(&motions)?;
    drop(motions);
    (0..count)
        .map(|i| {
            let samples: Vec<f64> = whole.iter().skip(i).step_by(count).copied().collect();
            // Their squares, which a root mean square adds, may be no numbers although they are.
            if let Some(sample) = samples.iter().position(|value| !(value * value * SAMPLES as f64).is_finite()) {
                return Err(TrialError::NotFinite { input: model.input(i).name.into(), sample });
            }
            let harmonics: Vec<f64> = analyse(&whole, i, count, REACH).iter().map(|line| line.norm()).collect();
            let largest = harmonics.iter().skip(1).copied().fold(0.0, f64::max);
            let highest = harmonics.iter().skip(1).rposition(|line| *line > NEEDED * largest).map_or(0, |k| k + 1);
            let label = model.input(i);
            Ok(InputUse {
                input: label.name.into(),
                unit: label.unit.map(Into::into),
                peak: samples.iter().fold(0.0, |most: f64, value| most.max(value.abs())),
                rms: (samples.iter().map(|value| value * value).sum::<f64>() / samples.len() as f64).sqrt(),
                highest,
                beyond: 0.0,
                harmonics,
                samples,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{StrokeError, trajectories};
    use std::f64::consts::PI;
    use tpm_plant::actuator::Demand;
    use tpm_test_support::models::MassSpringDrag;
    use tpm_test_support::rest_to_rest_3;

    #[test]
    fn the_pattern_ends_at_its_last_harmonic_and_the_trapezoid_does_not() {
        // Feng, chapter 2: m x'' + k1 x + k2 x'^2 along the pattern of order 3 has no harmonic above 6.
        let demand = Demand::new(&MassSpringDrag, &[2.0, 40.0, 1.5], &[], &[vec![0]]);
        let trajectory = rest_to_rest_3().trajectory(&[0.3], PI);
        let found = trajectories(&demand, &trajectory, PI, 2).expect("strokes");
        let input = |at: usize| &found.motions[at].inputs.as_ref().expect("finite")[0];
        let pattern = input(0);
        // Feng, Eqn 3.26: the mean 5/9 k2 lambda^2 w^2 and the first harmonic k1 lambda - m lambda w^2.
        assert!((pattern.harmonics[0] - 5.0 / 9.0 * 1.5 * 0.09 * PI * PI).abs() < 1e-9);
        assert!((pattern.harmonics[1] - (40.0_f64 * 0.3 - 2.0 * 0.3 * PI * PI).abs()).abs() < 1e-9);
        assert!(pattern.harmonics[7..].iter().all(|line| *line < 1e-9 * pattern.harmonics[1]));
        let trapezoid = input(3);
        assert_eq!(found.motions[3].name, "trapezoid");
        assert!(trapezoid.highest > 20 && trapezoid.beyond > 100.0 * pattern.beyond, "{}", trapezoid.highest);
        // The acceleration of this law jumps by 4.5 travel/T^2 at the ends of thirds.
        let peak = found.motions[3].coordinates[0].acceleration;
        let travel = 2.0 * 0.3 * 8.0 / 9.0;
        assert!((peak - 4.5 * travel).abs() < 1e-12, "{peak}");
        assert!((found.motions[3].coordinates[0].velocity - 1.5 * travel).abs() < 1e-9);
        // An input that depends on a fourth derivative would be infinite along all of the laws.
        let flexible = trajectories(&demand, &trajectory, PI, 4).expect("strokes");
        assert!(
            flexible.motions[0].inputs.is_some() && flexible.motions[1..].iter().all(|moved| moved.inputs.is_none())
        );
        let early = trajectories(&demand, &trajectory, PI / 2.0, 2);
        assert!(matches!(early, Err(StrokeError::Moving { .. })), "{early:?}");
        let whole = trajectories(&demand, &trajectory, 2.0 * PI, 2);
        assert!(matches!(whole, Err(StrokeError::NoTravel { .. })), "{whole:?}");
    }
}
