//! Trajectory patterns with numbers in them, and the motions that they prescribe.
//!
//! Invariant: a [`Trajectory`] is `q_c(t) = mean_c + sum_k [cos_ck cos(k w t) + sin_ck sin(k w t)]` for every coordinate of a
//! model, in the model's units, with one fundamental w (rad/s) for all; a [`ReferencePattern`] is such a sum whose
//! coefficients still hold powers of amplitudes. Derivatives are taken term by term and are exact.

use num_complex::Complex;

/// One harmonic of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Multiple of the fundamental, at least 1.
    pub harmonic: u32,
    /// Factor of the cosine.
    pub cos: f64,
    /// Factor of the sine.
    pub sin: f64,
}

impl Line {
    /// The derivative of an order of `cos * cos(x) + sin * sin(x)` with respect to x, from sine and cosine of x.
    fn turned(&self, (sin, cos): (f64, f64), order: usize) -> f64 {
        // Every differentiation turns cos into -sin, sin into cos.
        let (of_cos, of_sin) = match order % 4 {
            0 => (cos, sin),
            1 => (-sin, cos),
            2 => (-cos, -sin),
            _ => (sin, -cos),
        };
        self.cos * of_cos + self.sin * of_sin
    }
}

/// A finite Fourier series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HarmonicSeries {
    /// The constant term.
    pub mean: f64,
    /// The harmonics.
    pub lines: Vec<Line>,
}

impl HarmonicSeries {
    /// The series of one-sided phasors `a_k - j b_k`, from the mean on, with those harmonics for which `keep` is true.
    pub fn from_phasors(phasors: &[Complex<f64>], keep: impl Fn(usize, &Complex<f64>) -> bool) -> Self {
        let kept = phasors.iter().enumerate().skip(1).filter(|(k, z)| keep(*k, z));
        HarmonicSeries {
            mean: phasors.first().map_or(0.0, |mean| mean.re),
            lines: kept.map(|(k, z)| Line { harmonic: k as u32, cos: z.re, sin: -z.im }).collect(),
        }
    }

    /// The n-th derivative with respect to time at the phase `w t` (rad).
    #[must_use]
    pub fn derivative(&self, phase: f64, frequency: f64, order: usize) -> f64 {
        let mean = if order == 0 { self.mean } else { 0.0 };
        self.lines.iter().fold(mean, |sum, line| {
            let scale = (0..order).fold(1.0, |power, _| power * f64::from(line.harmonic) * frequency);
            sum + scale * line.turned((f64::from(line.harmonic) * phase).sin_cos(), order)
        })
    }

    /// Highest harmonic, 0 for a constant.
    #[must_use]
    pub fn highest_harmonic(&self) -> u32 {
        self.lines.iter().map(|line| line.harmonic).max().unwrap_or(0)
    }
}

/// The prescribed motion of every coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Fundamental angular frequency w, rad/s.
    pub frequency: f64,
    /// One series per coordinate of the model.
    pub coordinates: Vec<HarmonicSeries>,
}

impl Trajectory {
    /// The motion at the phase `w t` (rad): as many derivatives of every coordinate as `out` has room for, laid out as
    /// models read it (`out[n * coordinates + c]`).
    pub fn motion(&self, phase: f64, out: &mut [f64]) {
        self.motion_by(|harmonic| (f64::from(harmonic) * phase).sin_cos(), out);
    }

    /// The motion where `turned` gives the sine and the cosine of every harmonic's phase.
    fn motion_by(&self, turned: impl Fn(u32) -> (f64, f64), out: &mut [f64]) {
        let count = self.coordinates.len().max(1);
        out.fill(0.0);
        for (c, series) in self.coordinates.iter().enumerate() {
            if let Some(position) = out.get_mut(c) {
                *position = series.mean;
            }
            for line in &series.lines {
                let turned = turned(line.harmonic);
                let mut scale = 1.0;
                for (order, slot) in out.iter_mut().skip(c).step_by(count).enumerate() {
                    *slot += scale * line.turned(turned, order);
                    scale = scale * f64::from(line.harmonic) * self.frequency;
                }
            }
        }
    }

    /// The motion at sample `n` of a period of `samples`, with the phase reduced so that late samples are as exact as early
    /// ones, advanced by `advance` samples.
    pub fn motion_at(&self, n: usize, samples: usize, advance: f64, out: &mut [f64]) {
        let reduced = (n % samples) as f64 + advance;
        self.motion(2.0 * std::f64::consts::PI * reduced / samples as f64, out);
    }

    /// The motion at the samples of a whole period, one after the other, each with `width` numbers laid out as models read them. Harmonics
    /// meet the same phases again and again, so that far fewer sines are computed than by [`motion_at`](Self::motion_at).
    pub(crate) fn period(&self, samples: usize, width: usize) -> Vec<f64> {
        let turn = |n: usize| (2.0 * std::f64::consts::PI * n as f64 / samples as f64).sin_cos();
        let turns: Vec<(f64, f64)> = (0..samples).map(turn).collect();
        let mut motions = vec![0.0; samples * width];
        for (n, motion) in motions.chunks_exact_mut(width.max(1)).enumerate() {
            self.motion_by(|harmonic| turns[(harmonic as usize % samples) * n % samples], motion);
        }
        motions
    }

    /// Whether another trajectory prescribes the same motion of all coordinates but the open ones, whose motion follows from the
    /// parameters.
    pub fn prescribes_as(&self, other: &Trajectory, open: &[usize]) -> bool {
        self.frequency.to_bits() == other.frequency.to_bits()
            && (0..self.coordinates.len()).all(|c| open.contains(&c) || self.coordinates[c] == other.coordinates[c])
    }

    /// Highest harmonic of any coordinate.
    #[must_use]
    pub fn highest_harmonic(&self) -> u32 {
        self.coordinates.iter().map(HarmonicSeries::highest_harmonic).max().unwrap_or(0)
    }
}

/// A series multiplied by powers of amplitudes.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Amplitudes by index into [`ReferencePattern::amplitudes`], with their powers.
    pub powers: Vec<(usize, i32)>,
    /// Power of the fundamental frequency, such as -1 where an amplitude is a velocity.
    pub frequency_power: i32,
    /// The series that these powers multiply.
    pub series: HarmonicSeries,
}

/// A trajectory pattern whose amplitudes and frequency are open (Feng, chapter 2).
#[derive(Clone, Debug, PartialEq)]
pub struct ReferencePattern {
    /// Name of the pattern; nothing for a pattern without a name.
    pub name: Option<String>,
    /// Names of the amplitudes.
    pub amplitudes: Vec<String>,
    /// Name of the fundamental frequency.
    pub frequency: String,
    /// Per coordinate, the parts that add up to its motion; none where the pattern leaves the coordinate open.
    pub coordinates: Vec<Vec<Part>>,
    /// Further patterns of the same model: a stage of a campaign may play one of them by its name.
    pub others: Vec<ReferencePattern>,
}

impl ReferencePattern {
    /// This pattern, or the one of the others, that has a name.
    #[must_use]
    pub fn named(&self, name: &str) -> Option<&ReferencePattern> {
        core::iter::once(self).chain(&self.others).find(|pattern| pattern.name.as_deref() == Some(name))
    }

    /// Coordinates that the pattern leaves open: their motion follows from the rows without an input.
    #[must_use]
    pub fn open(&self) -> Vec<usize> {
        (0..self.coordinates.len()).filter(|&c| self.coordinates[c].is_empty()).collect()
    }

    /// The trajectory for given amplitudes (in the order of the names) and frequency (rad/s).
    #[must_use]
    pub fn trajectory(&self, amplitudes: &[f64], frequency: f64) -> Trajectory {
        let coordinates = self
            .coordinates
            .iter()
            .map(|parts| {
                let mut sum = HarmonicSeries::default();
                for part in parts {
                    let scale =
                        part.powers.iter().fold(frequency.powi(part.frequency_power), |product, &(which, power)| {
                            product * amplitudes.get(which).copied().unwrap_or(0.0).powi(power)
                        });
                    sum.mean += scale * part.series.mean;
                    for line in &part.series.lines {
                        let scaled = Line { cos: scale * line.cos, sin: scale * line.sin, ..*line };
                        match sum.lines.iter_mut().find(|present| present.harmonic == line.harmonic) {
                            Some(present) => {
                                present.cos += scaled.cos;
                                present.sin += scaled.sin;
                            }
                            None => sum.lines.push(scaled),
                        }
                    }
                }
                sum
            })
            .collect();
        Trajectory { frequency, coordinates }
    }
}

/// Why a pattern of a model file cannot be played.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PatternError {
    /// A coordinate has no motion.
    #[error("the pattern gives the coordinate `{coordinate}` no motion")]
    NoMotion {
        /// Name of the coordinate.
        coordinate: String,
    },
    /// A factor of the pattern has no value.
    #[error("the pattern needs a value of `{name}`")]
    NoValue {
        /// Name of the constant.
        name: String,
    },
}

#[cfg(test)]
pub(crate) mod tests {
    use super::{HarmonicSeries, Line, Part, ReferencePattern};
    use std::f64::consts::PI;

    /// lambda (cos th - 1/9 cos 3 th), the rest-to-rest pattern of order 3 (Feng, Eqn 2.21), for one coordinate.
    pub(crate) fn rest_to_rest_3() -> ReferencePattern {
        let lines = vec![Line { harmonic: 1, cos: 1.0, sin: 0.0 }, Line { harmonic: 3, cos: -1.0 / 9.0, sin: 0.0 }];
        ReferencePattern {
            name: None,
            amplitudes: vec!["lambda".to_string()],
            frequency: "w".to_string(),
            coordinates: vec![vec![Part {
                powers: vec![(0, 1)],
                frequency_power: 0,
                series: HarmonicSeries { mean: 0.0, lines },
            }]],
            others: vec![],
        }
    }

    #[test]
    fn a_period_is_the_motion_at_its_samples() {
        let lines = (1..40).map(|harmonic| Line { harmonic, cos: 0.3, sin: -0.2 }).collect();
        let mut trajectory = rest_to_rest_3().trajectory(&[0.3], PI);
        trajectory.coordinates.push(HarmonicSeries { mean: 0.1, lines });
        let mut motion = [0.0; 6];
        // Fewer samples than harmonics too.
        for samples in [24, 100] {
            for (n, period) in trajectory.period(samples, 6).chunks_exact(6).enumerate() {
                trajectory.motion_at(n, samples, 0.0, &mut motion);
                for (order, (a, b)) in period.iter().zip(motion).enumerate() {
                    let size = (40.0 * PI).powi(i32::try_from(order / 2).expect("small"));
                    assert!((a - b).abs() < 1e-11 * size, "{n} of {samples}, {order}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn derivatives_agree_with_the_closed_form_of_the_velocity() {
        // x' = -lambda w (4/3) sin^3 th, x''' etc. vanish at both ends.
        let trajectory = rest_to_rest_3().trajectory(&[0.3], PI);
        let mut motion = [0.0; 4];
        for i in 0..16 {
            let phase = 2.0 * PI * f64::from(i) / 16.0;
            trajectory.motion(phase, &mut motion);
            let sin = phase.sin();
            assert!((motion[1] + 0.3 * PI * 4.0 / 3.0 * sin.powi(3)).abs() < 1e-15);
            let acceleration = -0.3 * PI * PI * 4.0 * sin * sin * phase.cos();
            assert!((motion[2] - acceleration).abs() < 1e-14);
        }
        trajectory.motion_at(16 * 7 + 8, 16, 0.0, &mut motion);
        assert!((motion[0] + 0.3 * 8.0 / 9.0).abs() < 1e-15);
        assert!(motion[1].abs() < 1e-15 && motion[2].abs() < 1e-14 && motion[3].abs() < 1e-12);
        assert_eq!(trajectory.highest_harmonic(), 3);
    }
}
