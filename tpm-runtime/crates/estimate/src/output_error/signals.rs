//! The signals of a record, the motion from which a fit begins, and the noise that the sensors are taken to have.

use crate::local;
use crate::output_error::noise::Noise;
use num_complex::Complex;
use std::sync::OnceLock;
use tpm_controller::harmonics::Hold;
use tpm_motion::equal_rounding_runs;
use tpm_numerics::{root_mean_square, tolerance};

/// Power that harmonics leave of a record, in units of its noise, above which they are no description of its motion.
const MOST_UNEXPLAINED_POWER: f64 = 100.0;
/// Share of a period over which a polynomial is fitted on either side of a sample, as one over this.
const POLYNOMIAL_PERIOD_DIVISOR: f64 = 60.0;

/// What is known of a record's motion before it is simulated.
#[derive(Clone, Debug)]
pub enum Course {
    /// It repeats.
    Periodic {
        /// Samples of a period.
        samples_per_period: f64,
        /// Phasors of the coordinates at the harmonics of the period, as far as they stand out of the noise.
        lines: Vec<Vec<Complex<f64>>>,
        /// Phasors of the inputs at the harmonics of the period, as far as they stand out of the noise.
        input_lines: Vec<Vec<Complex<f64>>>,
    },
    /// It need not repeat.
    Any {
        /// Samples in which the motion goes to and fro once, on the average.
        typical_period: f64,
        /// Samples on either side of a sample over which a polynomial follows the motion.
        reach: usize,
        /// Highest frequency of every coordinate's motion, Hz.
        highest: Vec<f64>,
        /// Times that one and the same motion is recorded; one where nothing repeats.
        copies: f64,
    },
}

/// A measured rate of a coordinate.
#[derive(Clone, Debug)]
pub struct Rate<'a> {
    /// The coordinate.
    pub coordinate: usize,
    /// Readings, unit of the coordinate per second.
    pub readings: &'a [f64],
    /// Standard deviation of their white noise.
    pub noise: f64,
}

/// The signals of a record.
#[derive(Clone, Debug)]
pub struct Signals<'a> {
    /// Time between samples, s.
    pub sample_time: f64,
    /// What the inputs do between samples.
    pub hold: Hold,
    /// Measured coordinates.
    pub coordinates: Vec<&'a [f64]>,
    /// Measured rates, where there are any. The fit uses those that are the rates of the motion but for white noise.
    pub rates: Vec<Rate<'a>>,
    /// Recorded inputs.
    pub inputs: Vec<&'a [f64]>,
    /// What is known of the motion beforehand.
    pub course: Course,
    /// Samples before which something was left out, so that the motion begins anew.
    pub joins: Vec<usize>,
    /// White noise of each sensor by the spectrum: a standard deviation.
    pub white: Vec<f64>,
    /// Step of each sensor; zero where its values lie on no grid.
    pub steps: Vec<f64>,
    /// The inputs without their noise, computed on first use: hundreds of harmonics take longer to add up than a fit takes for a step.
    pub denoised_inputs: OnceLock<Vec<Vec<f64>>>,
}

/// Samples on either side of a sample over which a polynomial follows a motion that repeats.
pub fn reach_in(samples_per_period: f64) -> usize {
    (samples_per_period / POLYNOMIAL_PERIOD_DIVISOR) as usize
}

/// Variance of a sensor's noise beside its rounding to counts, given what is white in its readings and the size of a count. Nothing where
/// the noise is so large that the errors of rounding do not repeat with the motion, and for a sensor without counts.
pub fn beside_counts(white: f64, step: f64) -> Option<f64> {
    let own = (white * white - step * step / 12.0).max(0.0);
    (step > 0.0 && own.sqrt() < 0.5 * step).then_some(own)
}

/// A harmonic on its way through the samples.
struct Wave {
    /// Angle from one sample to the next, rad.
    angle: f64,
    phasor: Complex<f64>,
    now: Complex<f64>,
    turn: Complex<f64>,
}

impl Signals<'_> {
    /// Coordinate and derivative that every sensor reads: those of the coordinates first.
    pub(super) fn sensors(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let coordinates = (0..self.coordinates.len()).map(|c| (c, 0));
        coordinates.chain(self.rates.iter().map(|rate| (rate.coordinate, 1)))
    }

    fn samples(&self) -> usize {
        self.coordinates.first().map_or(0, |c| c.len())
    }

    /// Samples in which the motion goes to and fro once.
    pub(super) fn typical_period(&self) -> f64 {
        match self.course {
            Course::Periodic { samples_per_period, .. } => samples_per_period,
            Course::Any { typical_period, .. } => typical_period,
        }
    }

    /// Samples of a period; nothing where the motion need not repeat.
    pub(super) fn samples_per_period(&self) -> Option<f64> {
        match self.course {
            Course::Periodic { samples_per_period, .. } => Some(samples_per_period),
            Course::Any { .. } => None,
        }
    }

    /// The motion from which the fit begins, given derivatives of coordinates at every sample: that of the harmonics, or of
    /// polynomials over a few samples for a coordinate whose record no harmonics explain, such as one that has not settled.
    pub(super) fn motion(&self, slots: &[(usize, usize)]) -> Vec<f64> {
        let samples = self.samples();
        let n = slots.len();
        let mut motion = vec![0.0; samples * n];
        for (c, signal) in self.coordinates.iter().enumerate() {
            let order = slots.iter().filter(|slot| slot.0 == c).map(|slot| slot.1).max().unwrap_or(0);
            let (lines, reach) = match &self.course {
                Course::Periodic { samples_per_period, lines, .. } => {
                    let reach = reach_in(*samples_per_period);
                    (Some(&lines[c]), (!self.explained_by(&lines[c], c)).then_some(reach))
                }
                Course::Any { reach, .. } => (None, Some(*reach)),
            };
            let local = reach.and_then(|reach| self.local(signal, reach.max(3 + order), order));
            for (s, &(_, derivative)) in slots.iter().enumerate().filter(|(_, slot)| slot.0 == c) {
                let to = motion.iter_mut().skip(s).step_by(n);
                match (&local, lines) {
                    (Some(local), _) => {
                        let from = local.iter().skip(derivative).step_by(order + 1);
                        to.zip(from).for_each(|(to, from)| *to = *from);
                    }
                    (None, Some(lines)) => self.synthesise(lines, derivative, to),
                    (None, None) if derivative == 0 => to.zip(*signal).for_each(|(to, from)| *to = *from),
                    (None, None) => {}
                }
            }
        }
        motion
    }

    /// Whether harmonics leave of a coordinate's record what its noise may be.
    fn explained_by(&self, lines: &[Complex<f64>], coordinate: usize) -> bool {
        let samples = self.samples();
        let mut periodic = vec![0.0; samples];
        self.synthesise(lines, 0, periodic.iter_mut());
        let errors = self.coordinates[coordinate].iter().zip(&periodic).map(|(x, y)| x - y);
        let left = errors.map(|e| e * e).sum::<f64>() / samples.max(1) as f64;
        let noise = self.white[coordinate].powi(2) + self.steps[coordinate].powi(2) / 12.0;
        left <= MOST_UNEXPLAINED_POWER * noise
    }

    /// Derivatives 0 to `order` of a signal at every sample, sample by sample, by polynomials that reach over no join. Nothing where
    /// a stretch is too short for one.
    fn local(&self, signal: &[f64], reach: usize, order: usize) -> Option<Vec<f64>> {
        let mut out = Vec::with_capacity(signal.len() * (order + 1));
        let ends = self.joins.iter().copied().chain([signal.len()]);
        let mut from = 0;
        for to in ends {
            let own = reach.min((to - from).saturating_sub(1) / 2);
            out.extend(local::derivatives(&signal[from..to], self.sample_time, own, order, 1)?);
            from = to;
        }
        Some(out)
    }

    /// The highest frequency of a coordinate's motion, Hz: of a motion that repeats the highest harmonic that is no smaller than a
    /// thousandth of the largest.
    pub(super) fn highest(&self, coordinate: usize) -> f64 {
        match &self.course {
            Course::Periodic { samples_per_period, lines, .. } => {
                let lines = &lines[coordinate];
                let peak = lines.iter().skip(1).map(|line| line.norm()).fold(0.0, f64::max);
                let highest = lines.iter().rposition(|line| line.norm() >= 1e-3 * peak).unwrap_or(1).max(1);
                highest as f64 / (samples_per_period * self.sample_time)
            }
            Course::Any { highest, .. } => highest[coordinate],
        }
    }

    /// A coordinate without its noise: its periodic part, or what polynomials follow of it.
    fn without_noise(&self, coordinate: usize) -> Vec<f64> {
        let lines = match &self.course {
            Course::Periodic { lines, .. } => Some(&lines[coordinate]),
            Course::Any { .. } => None,
        };
        self.smooth(self.coordinates[coordinate], lines)
    }

    /// The inputs without their noise: their periodic part, or what polynomials follow of them.
    pub(super) fn inputs_without_noise(&self) -> &[Vec<f64>] {
        let of = |(input, signal): (usize, &&[f64])| {
            let lines = match &self.course {
                Course::Periodic { input_lines, .. } => Some(&input_lines[input]),
                Course::Any { .. } => None,
            };
            self.smooth(signal, lines)
        };
        self.denoised_inputs.get_or_init(|| self.inputs.iter().enumerate().map(of).collect())
    }

    fn smooth(&self, signal: &[f64], lines: Option<&Vec<Complex<f64>>>) -> Vec<f64> {
        match (lines, &self.course) {
            (Some(lines), _) => {
                let mut wave = vec![0.0; signal.len()];
                self.synthesise(lines, 0, wave.iter_mut());
                wave
            }
            (None, Course::Any { reach, .. }) => {
                self.local(signal, (*reach).max(3), 0).unwrap_or_else(|| signal.to_vec())
            }
            (None, Course::Periodic { .. }) => signal.to_vec(),
        }
    }

    /// Adds a derivative of a Fourier series to successive samples.
    fn synthesise<'s>(
        &self,
        lines: &[Complex<f64>],
        derivative: usize,
        mut samples: impl ExactSizeIterator<Item = &'s mut f64>,
    ) {
        let fundamental = 2.0 * std::f64::consts::PI / (self.typical_period() * self.sample_time);
        let wanted = |(k, line): (usize, &Complex<f64>)| {
            let phasor = line * Complex::new(0.0, k as f64 * fundamental).powu(derivative as u32);
            (phasor.norm_sqr() > 0.0).then_some((k as f64 * fundamental * self.sample_time, phasor))
        };
        let mut waves: Vec<Wave> = (lines.iter().enumerate())
            .filter_map(wanted)
            .map(|(angle, phasor)| Wave { angle, phasor, now: phasor, turn: Complex::from_polar(1.0, angle) })
            .collect();
        for i in 0..samples.len() {
            let mut sum = 0.0;
            for wave in &mut waves {
                // The angle is formed anew now and then, so that rounding does not add up.
                if i % 1024 == 0 {
                    let angle = (i as f64 * wave.angle).rem_euclid(2.0 * std::f64::consts::PI);
                    wave.now = wave.phasor * Complex::from_polar(1.0, angle);
                }
                sum += wave.now.re;
                wave.now *= wave.turn;
            }
            if let Some(slot) = samples.next() {
                *slot += sum;
            }
        }
    }

    /// The noise of the sensors: white by the spectrum, and the rounding to counts where there is any.
    ///
    /// Readings whose rounding errors are alike are one reading, and readings that repeat from period to period are those of one period.
    pub(super) fn noise(&self) -> Noise {
        let outputs = self.sensors().count();
        let samples = self.samples();
        let mut readings = vec![0.0; samples * outputs];
        for (sensor, rate) in (self.coordinates.len()..).zip(&self.rates) {
            let least = tolerance::READING * root_mean_square(rate.readings.iter().copied());
            let sigma = rate.noise.max(least).max(f64::MIN_POSITIVE);
            readings.iter_mut().skip(sensor).step_by(outputs).for_each(|slot| *slot = sigma);
        }
        for (c, signal) in self.coordinates.iter().enumerate() {
            let least = (tolerance::READING * root_mean_square(signal.iter().copied())).powi(2).max(f64::MIN_POSITIVE);
            let step = self.steps[c];
            if let Some(own) = self.beside_counts(c) {
                let rounded = step * step / 12.0;
                // The error is a function of the phase of a periodic motion, the same in every period.
                let copies = match self.course {
                    Course::Periodic { samples_per_period, .. } => samples as f64 / samples_per_period.max(1.0),
                    Course::Any { copies, .. } => copies,
                };
                let copies = copies.max(1.0);
                let motion = self.without_noise(c);
                let mut first = 0;
                for length in equal_rounding_runs(&motion, step) {
                    let variance = (rounded * length as f64 + own) * copies;
                    for sample in first..first + length {
                        readings[sample * outputs + c] = variance.max(least).sqrt();
                    }
                    first += length;
                }
            } else {
                let sigma = self.white[c].powi(2).max(least).sqrt();
                readings.iter_mut().skip(c).step_by(outputs).for_each(|slot| *slot = sigma);
            }
        }
        Noise { readings, colour: vec![0.0; outputs], inputs: vec![0.0; self.inputs.len()], only_at_turns: false }
    }

    /// Standard deviation of every sensor's noise, given that of the readings and the variance of the innovations in its units.
    pub(super) fn sensor_noise(&self, scale: &[f64], innovations: f64) -> Vec<f64> {
        let of = |(sigma, step): (&f64, &f64)| {
            // Readings whose errors are alike are given more noise than they have.
            if self.counted() && *step > 0.0 { step / 12.0_f64.sqrt() } else { sigma * innovations.sqrt() }
        };
        scale.iter().zip(&self.steps).map(of).collect()
    }

    /// Whether rounding to counts makes up the noise of a sensor.
    pub(super) fn counted(&self) -> bool {
        (0..self.steps.len()).any(|c| self.beside_counts(c).is_some())
    }

    /// Variance of a sensor's noise beside its rounding to counts, where rounding makes up its noise.
    fn beside_counts(&self, coordinate: usize) -> Option<f64> {
        beside_counts(self.white[coordinate], self.steps[coordinate])
    }
}
