//! The signals of a record, the motion from which a fit begins, and the noise that the sensors are taken to have.

use crate::estimate::output_error::local;
use crate::estimate::output_error::noise::Noise;
use crate::numerics::root_mean_square;
use crate::run::alike;
use num_complex::Complex;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;

/// Least noise of a sensor, as a share of its root mean square: rounding of numbers that a file holds.
const ROUNDING: f64 = 1e-9;
/// Power that harmonics leave of a record, in units of its noise, above which they are no description of its motion.
const UNEXPLAINED: f64 = 100.0;
/// Share of a period over which a polynomial is fitted on either side of a sample, as one over this.
const LOCAL: u32 = 60;

/// The signals of a record over whole periods.
#[derive(Clone, Debug)]
pub struct Signals<'a> {
    /// Time between samples, s.
    pub sample_time: f64,
    /// What the inputs do between samples.
    pub hold: Hold,
    /// Measured coordinates.
    pub coordinates: Vec<&'a [f64]>,
    /// Recorded inputs.
    pub inputs: Vec<&'a [f64]>,
    /// Samples of a period.
    pub samples_per_period: f64,
    /// Samples before which something was left out, so that the motion begins anew.
    pub joins: Vec<usize>,
    /// White noise of each sensor by the spectrum: a standard deviation.
    pub white: Vec<f64>,
    /// Step of each sensor; zero where its values lie on no grid.
    pub steps: Vec<f64>,
    /// Phasors of the coordinates at the harmonics of the period, as far as they stand out of the noise.
    pub lines: Vec<Vec<Complex<f64>>>,
    /// Share of the force that the values from which the fit begins leave unexplained.
    pub unexplained: f64,
    /// Phasors of the inputs at the harmonics of the period, as far as they stand out of the noise.
    pub input_lines: Vec<Vec<Complex<f64>>>,
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
    /// The motion from which the fit begins, given derivatives of coordinates at every sample: that of the harmonics, or of
    /// polynomials over a few samples for a coordinate whose record the harmonics do not explain, such as one that has not settled.
    pub(super) fn motion(&self, slots: &[(usize, usize)]) -> Vec<f64> {
        let samples = self.coordinates.first().map_or(0, |c| c.len());
        let n = slots.len();
        let mut motion = vec![0.0; samples * n];
        for (c, signal) in self.coordinates.iter().enumerate() {
            let mut periodic = vec![0.0; samples];
            self.synthesise(&self.lines[c], 0, periodic.iter_mut());
            let power = |left: &mut dyn Iterator<Item = f64>| left.map(|e| e * e).sum::<f64>() / samples.max(1) as f64;
            let left = power(&mut signal.iter().zip(&periodic).map(|(x, y)| x - y));
            let noise = self.white[c].powi(2) + self.steps[c].powi(2) / 12.0;
            let order = slots.iter().filter(|slot| slot.0 == c).map(|slot| slot.1).max().unwrap_or(0);
            let half = ((self.samples_per_period / f64::from(LOCAL)) as usize).max(3 + order);
            let local = if left > UNEXPLAINED * noise {
                local::derivatives(signal, self.sample_time, half, order, 1)
            } else {
                None
            };
            for (s, &(_, derivative)) in slots.iter().enumerate().filter(|(_, slot)| slot.0 == c) {
                let to = motion.iter_mut().skip(s).step_by(n);
                match &local {
                    Some(local) => {
                        let from = local.iter().skip(derivative).step_by(order + 1);
                        to.zip(from).for_each(|(to, from)| *to = *from);
                    }
                    None => self.synthesise(&self.lines[c], derivative, to),
                }
            }
        }
        motion
    }

    /// The highest harmonic of a coordinate that is no smaller than a thousandth of the largest.
    pub(super) fn highest(&self, coordinate: usize) -> usize {
        let lines = &self.lines[coordinate];
        let peak = lines.iter().skip(1).map(|line| line.norm()).fold(0.0, f64::max);
        lines.iter().rposition(|line| line.norm() >= 1e-3 * peak).unwrap_or(1).max(1)
    }

    /// The periodic part of an input.
    pub(super) fn periodic_input(&self, input: usize) -> Vec<f64> {
        let mut wave = vec![0.0; self.inputs[input].len()];
        self.synthesise(&self.input_lines[input], 0, wave.iter_mut());
        wave
    }

    /// Adds a derivative of a Fourier series to successive samples.
    fn synthesise<'s>(
        &self,
        lines: &[Complex<f64>],
        derivative: usize,
        mut samples: impl ExactSizeIterator<Item = &'s mut f64>,
    ) {
        let fundamental = 2.0 * std::f64::consts::PI / (self.samples_per_period * self.sample_time);
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
        let outputs = self.coordinates.len();
        let samples = self.coordinates.first().map_or(0, |c| c.len());
        let mut readings = vec![0.0; samples * outputs];
        for (c, signal) in self.coordinates.iter().enumerate() {
            let least = (ROUNDING * root_mean_square(signal.iter().copied())).powi(2).max(f64::MIN_POSITIVE);
            let step = self.steps[c];
            if let Some(own) = self.beside_counts(c) {
                let rounded = step * step / 12.0;
                // The error is a function of the phase of a periodic motion, the same in every period.
                let copies = (samples as f64 / self.samples_per_period.max(1.0)).max(1.0);
                let mut motion = vec![0.0; samples];
                self.synthesise(&self.lines[c], 0, motion.iter_mut());
                let mut first = 0;
                for length in alike(&motion, step) {
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
        let (step, white) = (self.steps[coordinate], self.white[coordinate]);
        let own = (white * white - step * step / 12.0).max(0.0);
        (step > 0.0 && own.sqrt() < 0.5 * step).then_some(own)
    }
}
