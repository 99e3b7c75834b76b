//! The share of its motors' limits that a run uses, by sample and by harmonic.
//!
//! ```text
//! I_k = U_k / (k_t r) ,     V_k = (R + j k w L) I_k + j k w k_v r Q_k         (Feng, Eqns C.1, C.2, harmonic by harmonic)
//! ```
//!
//! Invariant: U_k are the harmonics of the force on the coordinate, Q_k those of the coordinate. The identified model
//! contains the rotor, so that the rotor inertia of a motor file is not counted again. Sample n of a period is that of
//! the trial.

use crate::actuator::motor::{Limit, Motor};
use crate::actuator::requirement::Requirement;
use num_complex::Complex;
use serde::Serialize;
use std::fmt;
use tpm_controller::model::Model;
use tpm_report::digits;

/// Significant digits of a value beside its limit.
const VALUE_DIGITS: usize = 4;

/// A motor on the coordinate that its rotor turns with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounted {
    /// The motor.
    pub motor: Motor,
    /// Index of the coordinate.
    pub coordinate: usize,
}

/// The limit of which a run uses the largest share, with the sample, the time and the harmonic.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LimitUse {
    /// Name of the input.
    pub input: String,
    /// Name of the limit: command (of the input itself), current, voltage or power of a motor; force, speed, power or bandwidth of any
    /// other actuator.
    pub limit: &'static str,
    /// Unit of value and limit, when it is known.
    pub unit: Option<String>,
    /// Largest value over the period.
    pub value: f64,
    /// Value of the limit.
    pub available: f64,
    /// Largest value as a share of the limit.
    pub share: f64,
    /// Sample of the period with the largest value.
    pub sample: usize,
    /// Time of the largest value since the start of the period, s.
    pub time: f64,
    /// The harmonic with the largest amplitude, and this amplitude; nothing for a power, whose harmonics are not those of the
    /// motion.
    pub harmonic: Option<(usize, f64)>,
    /// What the user can do; nothing for motors, whose sizing reports remedies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<&'static str>,
    /// The samples that were cut although the periodic motion keeps the limit; nothing where it passes the limit itself, or where nothing
    /// was cut.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut: Option<Cut>,
}

/// Samples in which an input was cut at a limit that the periodic motion keeps: what the feedback makes of the sensors' noise and rounding
/// passes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Cut {
    /// How many samples were cut.
    pub samples: usize,
    /// Samples of the whole run.
    pub of: usize,
}

impl fmt::Display for LimitUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = self.unit.as_deref().map(|unit| format!(" {unit}")).unwrap_or_default();
        if let Some(cut) = self.cut {
            return write!(
                f,
                "in {} of {} samples of the run, at {}{unit} for the {} of {}; the periodic motion takes {}{unit} of it ({:.1} %), the rest \
                 is what the feedback makes of the sensors' noise and rounding; lower its gains, or filter its rate with a longer time constant",
                cut.samples,
                cut.of,
                self.available,
                self.limit,
                self.input,
                digits(self.value, VALUE_DIGITS),
                100.0 * self.share
            );
        }
        write!(
            f,
            "the {} of {} takes {}{unit} of {}{unit} ({:.1} %) at sample {} of the period ({:.4} s)",
            self.limit,
            self.input,
            digits(self.value, VALUE_DIGITS),
            self.available,
            100.0 * self.share,
            self.sample,
            self.time
        )?;
        let written = match self.harmonic {
            Some((harmonic, _)) if self.limit == "bandwidth" => write!(f, ", by harmonic {harmonic} of its force"),
            Some((0, value)) => write!(f, ", {}{unit} of it as its mean", digits(value, VALUE_DIGITS)),
            Some((harmonic, value)) => {
                write!(f, ", {}{unit} of it by harmonic {harmonic}", digits(value, VALUE_DIGITS))
            }
            None => Ok(()),
        };
        written?;
        self.remedy.map_or(Ok(()), |remedy| write!(f, "; {remedy}"))
    }
}

/// The line, harmonic and amplitude, with the largest positive amplitude.
pub fn strongest(lines: impl Iterator<Item = (usize, f64)>) -> Option<(usize, f64)> {
    lines.filter(|(_, size)| *size > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))
}

impl Mounted {
    /// The motor without the inertia that the model contains.
    #[must_use]
    pub fn bare(&self) -> Motor {
        Motor { rotor_inertia: 0.0, ..self.motor }
    }

    /// The limit of which a planned motion uses the largest share.
    #[must_use]
    pub fn planned(&self, model: &dyn Model<f64>, requirement: &Requirement, samples: usize) -> LimitUse {
        let worst = requirement.worst();
        let harmonic = strongest(requirement.harmonics.iter().map(|line| {
            let size = match worst.limit {
                Limit::Current => (line.independent + line.dependent).norm(),
                Limit::Voltage => (line.independent_voltage + line.dependent_voltage).norm(),
                Limit::Power => 0.0,
            };
            (line.harmonic, size)
        }));
        let period = requirement.samples.len() as f64 * requirement.samples.get(1).map_or(0.0, |sample| sample.time);
        let sample = if period > 0.0 { (worst.time / period * samples as f64).round() as usize } else { 0 };
        let (limit, unit) = worst.limit.name_and_unit();
        LimitUse {
            input: model.input(requirement.input).name.to_string(),
            limit,
            unit: Some(unit.to_string()),
            value: worst.value,
            available: worst.available,
            share: worst.share(),
            sample: sample % samples.max(1),
            time: worst.time,
            harmonic,
            remedy: None,
            cut: None,
        }
    }

    /// The limit of which a played run used the largest share: `force` and `motion` are the phasors of input and coordinate from
    /// harmonic 0 on, `fundamental` is in rad/s, and a period has `samples` samples.
    #[must_use]
    pub fn measured(
        &self,
        input: &str,
        force: &[Complex<f64>],
        motion: &[Complex<f64>],
        fundamental: f64,
        samples: usize,
    ) -> LimitUse {
        let motor = &self.motor;
        let current: Vec<Complex<f64>> =
            force.iter().map(|line| line / (motor.torque_constant * motor.ratio)).collect();
        let voltage: Vec<Complex<f64>> = (0..current.len())
            .map(|k| {
                let w = k as f64 * fundamental;
                let speed = Complex::new(0.0, w) * motion.get(k).copied().unwrap_or_default();
                Complex::new(motor.resistance, w * motor.inductance) * current[k] + speed * motor.back_emf * motor.ratio
            })
            .collect();
        let at = |lines: &[Complex<f64>], n: usize| -> f64 {
            let angle = 2.0 * std::f64::consts::PI * n as f64 / samples as f64;
            lines.iter().enumerate().map(|(k, line)| (line * Complex::from_polar(1.0, k as f64 * angle)).re).sum()
        };
        let (mut most, mut found) = (-1.0, (Limit::Current, 0.0, 0));
        for n in 0..samples {
            let (current, voltage) = (at(&current, n), at(&voltage, n));
            for (limit, value) in
                [(Limit::Current, current.abs()), (Limit::Voltage, voltage.abs()), (Limit::Power, current * voltage)]
            {
                let share = value / motor.limits.of(limit);
                if share > most {
                    (most, found) = (share, (limit, value, n));
                }
            }
        }
        let (limit, value, sample) = found;
        let sizes = |lines: &[Complex<f64>]| strongest(lines.iter().map(|line| line.norm()).enumerate());
        let (name, unit) = limit.name_and_unit();
        LimitUse {
            input: input.to_string(),
            limit: name,
            unit: Some(unit.to_string()),
            value,
            available: motor.limits.of(limit),
            share: most.max(0.0),
            sample,
            time: 2.0 * std::f64::consts::PI / fundamental * sample as f64 / samples.max(1) as f64,
            harmonic: match limit {
                Limit::Current => sizes(&current),
                Limit::Voltage => sizes(&voltage),
                Limit::Power => None,
            },
            remedy: None,
            cut: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Mounted;
    use crate::actuator::demand::Demand;
    use crate::actuator::motor::tests::feng;
    use crate::actuator::motor::{Limits, Motor};
    use crate::actuator::requirement::requirements;
    use num_complex::Complex;
    use std::vec;
    use tpm_motion::trajectory::{HarmonicSeries, Line, Trajectory};
    use tpm_test_support::models::MassSpringDrag;

    #[test]
    fn what_is_planned_is_what_is_measured() {
        let (theta, w, samples) = ([2e-3, 0.3, 0.0], 4.0, 256);
        let lines = vec![Line { harmonic: 1, cos: 0.7, sin: 0.1 }, Line { harmonic: 3, cos: -0.2, sin: 0.0 }];
        let trajectory =
            Trajectory { frequency: w, coordinates: vec![HarmonicSeries { mean: 0.1, lines: lines.clone() }] };
        let mut motion = vec![Complex::new(0.0, 0.0); 4];
        motion[0] = Complex::new(0.1, 0.0);
        for line in &lines {
            motion[line.harmonic as usize] = Complex::new(line.cos, -line.sin);
        }
        let force: vec::Vec<Complex<f64>> =
            (0..4).map(|k| motion[k] * (theta[1] - theta[0] * (f64::from(k as u32) * w).powi(2))).collect();
        for limits in [
            Limits { current: 3.0, ..Limits::default() },
            Limits { voltage: 5.0, ..Limits::default() },
            Limits { power: 8.0, ..Limits::default() },
        ] {
            let mounted = Mounted { motor: Motor { limits, ..feng() }, coordinate: 0 };
            let demand = Demand::new(&MassSpringDrag, &theta, &[], &[vec![0]]);
            let found = requirements(&demand, &[Some(mounted.bare())], &trajectory, samples).expect("square").remove(0);
            let planned = mounted.planned(&MassSpringDrag, &found, samples);
            let measured = mounted.measured("u", &force, &motion, w, samples);
            // The plan interpolates its peak between samples.
            assert!((planned.value / measured.value - 1.0).abs() < 1e-3, "{planned:?} {measured:?}");
            assert!(planned.sample.abs_diff(measured.sample) <= 1, "{planned:?} {measured:?}");
            assert_eq!((planned.limit, planned.unit.clone()), (measured.limit, measured.unit.clone()));
            if let (Some(planned), Some(measured)) = (planned.harmonic, measured.harmonic) {
                assert!(planned.0 == measured.0 && (planned.1 - measured.1).abs() < 1e-9);
            }
            let text = measured.to_string();
            assert!(text.contains(measured.limit) && text.contains("sample") && text.contains(" of u "), "{text}");
        }
    }
}
