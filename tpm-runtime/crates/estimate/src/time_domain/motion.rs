//! A record by its frequencies: positions and rates in one, the noise of the sensors, and how fast the machine moves.

use crate::error::EstimateError;
use crate::sensor::Sensor;
use crate::time_domain::bands::Bands;
use crate::time_domain::course::{Course, Trend};
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::presliding::built_up;
use crate::time_domain::transform::{Transform, quick};
use num_complex::Complex;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Presliding;
use tpm_motion::Dynamics;

/// Seed of the noise by which the information of noise is measured.
const SEED: u64 = 0x74_706d;

/// Cut-off of the low pass behind which a coordinate is looked at for reversals, in units of the highest frequency that stands out of its noise.
const SMOOTH: f64 = 2.0;
/// A reversal counts from so many deviations of the noise on, that low pass behind it.
const REVERSES: f64 = 4.0;

/// Samples without a gap.
#[derive(Clone, Debug)]
pub struct Stretch<'a> {
    /// Measured coordinates, in the model's order and units.
    pub coordinates: Vec<&'a [f64]>,
    /// Measured rates of coordinates; nothing where a rate is not measured.
    pub rates: Vec<Option<&'a [f64]>>,
    /// Recorded inputs, in the model's order and units.
    pub inputs: Vec<&'a [f64]>,
}

impl TimeRecord<'_> {
    /// What a coordinate follows from that has no sensor.
    pub(crate) fn follows(&self, c: usize) -> Option<Presliding<f64>> {
        self.following.get(c).copied().flatten()
    }
}

impl Stretch<'_> {
    /// Number of samples.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.coordinates.first().map_or(0, |signal| signal.len())
    }
}

/// A record of one machine, in stretches of even samples.
#[derive(Clone, Debug)]
pub struct TimeRecord<'a> {
    /// Time between samples, s.
    pub sample_time: f64,
    /// What the inputs do between samples.
    pub hold: Hold,
    /// Known dynamics between the recorded inputs and the forces; inputs past the end of the list have none.
    pub actuators: &'a [Dynamics],
    /// What coordinates follow from that have no sensor, whose signals are those of the coordinates that they follow; nothing, also where the list
    /// ends, for every other one.
    pub following: &'a [Option<Presliding<f64>>],
    /// The stretches.
    pub stretches: Vec<Stretch<'a>>,
}

/// A stretch by its frequencies.
pub(crate) struct Moving {
    pub(crate) samples: usize,
    pub(crate) points: usize,
    pub(crate) coordinates: Vec<Course>,
    /// Noise of the size that the coordinates have.
    pub(crate) noise: Vec<Course>,
    pub(crate) inputs: Vec<Transform>,
}

/// A record by its frequencies.
pub(crate) struct Motion {
    pub(crate) stretches: Vec<Moving>,
    /// The coordinates that move on their own: all but those that follow from others.
    pub(crate) moving: Vec<usize>,
    /// Step of every sensor; zero where its values lie on no grid.
    pub(crate) steps: Vec<f64>,
    /// Highest angular frequency of every coordinate that stands out of its noise, rad/s.
    pub(crate) highest: Vec<f64>,
    /// Time in which the coordinates go to and fro once, on the average, s.
    pub(crate) typical_period: f64,
    /// Measured rate over the rate of the measured position, where both are measured.
    pub(crate) rate_gains: Vec<Option<f64>>,
}

impl Motion {
    /// Transforms a record; `circular` says that its ends go over into its beginnings.
    ///
    /// # Errors
    /// [`EstimateError::NoSignal`] when there are no samples.
    pub(crate) fn new(record: &TimeRecord<'_>, circular: bool) -> Result<Self, EstimateError> {
        let Some(first) = record.stretches.first() else { return Err(EstimateError::NoSignal) };
        let coordinates = first.coordinates.len();
        let of = |c: usize| -> Vec<&[f64]> { record.stretches.iter().map(|stretch| stretch.coordinates[c]).collect() };
        let rates = |c: usize| -> Option<Vec<&[f64]>> {
            record.stretches.iter().map(|stretch| stretch.rates.get(c).copied().flatten()).collect()
        };
        let (white, steps): (Vec<f64>, Vec<f64>) =
            (0..coordinates).map(|c| Sensor::of(&of(c))).map(|sensor| (sensor.noise, sensor.step)).unzip();
        let rate_noise: Vec<Option<f64>> =
            (0..coordinates).map(|c| rates(c).map(|rates| Sensor::of(&rates).noise)).collect();
        let bands: Vec<Bands> = (0..coordinates).map(|c| Bands::of(&of(c), record.sample_time)).collect();
        let highest: Vec<f64> = bands.iter().zip(&white).map(|(bands, white)| bands.highest(*white)).collect();
        let periods = bands.iter().zip(&highest).map(|(bands, highest)| bands.typical_period(*highest));
        let typical_period = periods.fold(f64::INFINITY, f64::min);
        let mut gains = vec![(0.0, 0.0); coordinates];
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        let mut stretches = Vec::with_capacity(record.stretches.len());
        for stretch in &record.stretches {
            let samples = stretch.samples();
            // Whole periods are their own spectrum; anything that is added would open them.
            let points = if circular { samples } else { quick(samples) };
            let transform = |signal: &[f64]| Transform::new(signal, points, record.sample_time);
            let mut random = |deviation: f64| -> Vec<f64> {
                let draw = |_| -> f64 { deviation * Distribution::<f64>::sample(&StandardNormal, &mut rng) };
                (0..samples).map(draw).collect()
            };
            let mut moving = Moving { samples, points, coordinates: Vec::new(), noise: Vec::new(), inputs: Vec::new() };
            for c in 0..coordinates {
                if let Some(own) = record.follows(c) {
                    let smooth = LowPass { cut_off: SMOOTH * highest[c] };
                    let mut followed = moving.coordinates[own.of].derivative(points, 0, |w| smooth.response(w));
                    followed.truncate(samples);
                    let passed = (smooth.cut_off * record.sample_time / PI).min(1.0);
                    let built = built_up(&followed, own.travel, REVERSES * white[c] * passed.sqrt());
                    moving.coordinates.push(Course::new(transform(&built), Trend::nothing()));
                    moving.noise.push(Course::new(transform(&vec![0.0; samples]), Trend::nothing()));
                    continue;
                }
                // A quarter of the fastest oscillation that stands out of the noise is nearly a parabola.
                let quarter = 0.5 * PI / highest[c].max(f64::MIN_POSITIVE) / record.sample_time;
                let near = quarter.min(samples as f64) as usize;
                let course = |position: &[f64], rate: Option<(&[f64], f64)>| {
                    let trend = if circular { Trend::nothing() } else { Trend::of(position, record.sample_time, near) };
                    let off = |signal: &[f64], derivative: usize| {
                        transform(&trend.off(signal, record.sample_time, derivative))
                    };
                    let rest = match rate {
                        Some((rate, of_rate)) => together(off(position, 0), &off(rate, 1), white[c], of_rate),
                        None => off(position, 0),
                    };
                    Course::new(rest, trend)
                };
                let measured = stretch.coordinates[c];
                let rate = stretch.rates.get(c).copied().flatten().zip(rate_noise[c]);
                if let Some((rate, _)) = rate {
                    let (position, rate) = (transform(measured), transform(rate));
                    let gain = &mut gains[c];
                    let last = (highest[c] / position.spacing()) as usize;
                    for k in 1..=last.min(points / 2) {
                        let own = Complex::new(0.0, k as f64 * position.spacing()) * position.bin(k);
                        gain.0 += (rate.bin(k) * own.conj()).re;
                        gain.1 += own.norm_sqr();
                    }
                }
                // Noise goes the way of what is measured, so that it tells what noise of the sensors makes of the equations.
                let noise = random(white[c]);
                let noise_of_rate = rate.map(|(_, of_rate)| (random(of_rate), of_rate));
                let noise_of_rate = noise_of_rate.as_ref().map(|(noise, of_rate)| (noise.as_slice(), *of_rate));
                moving.noise.push(course(&noise, noise_of_rate));
                moving.coordinates.push(course(measured, rate));
            }
            moving.inputs = stretch.inputs.iter().map(|signal| transform(signal)).collect();
            stretches.push(moving);
        }
        let gain = |(own, power): (f64, f64)| own / power.max(f64::MIN_POSITIVE);
        let rate_gains = gains.iter().zip(&rate_noise).map(|(&of, noise)| noise.map(|_| gain(of))).collect();
        let moving = (0..coordinates).filter(|&c| record.follows(c).is_none()).collect();
        Ok(Motion { stretches, moving, steps, highest, typical_period, rate_gains })
    }

    /// Highest angular frequency of any coordinate, rad/s.
    pub(crate) fn fastest(&self) -> f64 {
        self.highest.iter().copied().fold(0.0, f64::max)
    }
}

/// The most likely position of a coordinate whose rate was measured too, given the deviations of both: at low frequencies the measured
/// position, at high ones the integral of the measured rate.
fn together(position: Transform, rate: &Transform, white: f64, of_rate: f64) -> Transform {
    position.map(|w, k, bin| {
        let (own, other) = (of_rate * of_rate, (w * white).powi(2));
        if k == 0 || own + other <= 0.0 {
            return bin;
        }
        let integral = rate.bin(k) / Complex::new(0.0, w);
        (bin * own + integral * other) / (own + other)
    })
}
