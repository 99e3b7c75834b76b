//! What the spectrum of a measured coordinate says: the noise of its sensor, up to which frequency the motion stands out of it, and what
//! share of every frequency is motion.

use std::f64::consts::PI;
use tpm_numerics::fourier::forward;

/// Shape of the Kaiser window: its side lobes lie 105 dB below the main lobe, so that a motion hides no sensor noise that is 1e-5 of it.
const KAISER_SHAPE: f64 = 14.0;
/// Half width of the window's main lobe, in bins.
const MAIN_LOBE: usize = 5;
/// Segments of a quarter of the record, and of two seconds at least, tell where the motion falls to the noise.
const SEGMENTS: f64 = 4.0;
const LEAST_SEGMENT: f64 = 2.0;
/// Length of the segments that tell the share of the motion at every frequency, s: short ones have many of a kind to average.
const SHARE_SEGMENT: f64 = 1.0;
/// Where the power of a motion falls below this many times that of the noise, the motion is no longer followed.
const FOLLOWED: f64 = 3.0;
/// Where the power of a motion falls below this many times that of the noise, its equations are no longer used.
const USED: f64 = 100.0;
/// The median of a power whose mean is one, for averages of a few overlapping segments.
const MEDIAN_POWER: f64 = 0.9;

/// A spectrum by averaged segments (Welch 1967).
#[derive(Clone, Debug)]
struct Welch {
    /// From one bin to the next, Hz.
    spacing: f64,
    /// Power of each bin per Hz, to one side.
    density: Vec<f64>,
}

/// What the spectrum of one coordinate says.
#[derive(Clone, Debug)]
pub(super) struct Spectrum {
    /// Deviation of white noise of the sensor, unit of the coordinate.
    pub(super) noise: f64,
    /// Highest frequency at which the motion stands out of the noise, Hz.
    pub(super) followed: f64,
    /// Highest frequency at which it stands far out of the noise, Hz.
    pub(super) used: f64,
    share: Welch,
}

impl Spectrum {
    /// The spectrum of a coordinate that was measured in stretches of even samples, `h` seconds apart.
    pub(super) fn of(signals: &[&[f64]], h: f64) -> Self {
        let longest = signals.iter().map(|signal| signal.len()).max().unwrap_or(0);
        let whole = longest as f64 * h;
        let length = (LEAST_SEGMENT.max(whole / SEGMENTS) / h) as usize;
        let fine = Welch::of(signals, h, length.clamp(1, longest.max(1)));
        let quarter = 0.25 / h;
        let mut high: Vec<f64> = fine.bins().filter(|(f, _)| *f > quarter).map(|(_, p)| p).collect();
        high.sort_by(f64::total_cmp);
        let floor = high.get(high.len() / 2).copied().unwrap_or(0.0) / MEDIAN_POWER;
        let first = MAIN_LOBE.max(3);
        let below = |ratio: f64| {
            let smooth = |k: usize| {
                let near = &fine.density[k.saturating_sub(1)..(k + 2).min(fine.density.len())];
                near.iter().sum::<f64>() / near.len() as f64
            };
            let end = (first..fine.density.len()).find(|&k| smooth(k) < ratio * floor);
            end.map_or(0.25 / h, |k| (k as f64 * fine.spacing).min(0.25 / h))
        };
        let noise = (floor * 0.5 / h).sqrt();
        let (followed, used) = (below(FOLLOWED), below(USED));
        let segment = ((SHARE_SEGMENT / h) as usize).clamp(1, longest.max(1));
        let mut share = Welch::of(signals, h, segment);
        let logs: Vec<f64> = share.density.iter().map(|p| p.max(f64::MIN_POSITIVE).ln()).collect();
        for (k, p) in share.density.iter_mut().enumerate() {
            let near = &logs[k.saturating_sub(1)..(k + 2).min(logs.len())];
            let smooth = (near.iter().sum::<f64>() / near.len() as f64).exp();
            *p = if k < MAIN_LOBE { 1.0 } else { (1.0 - floor / smooth).max(0.0) };
        }
        Spectrum { noise, followed, used, share }
    }

    /// Share of the power at a frequency, Hz, that is motion: the response of the smoother that gives E[q | y], Wiener's.
    pub(super) fn share(&self, frequency: f64) -> f64 {
        let at = frequency / self.share.spacing;
        let k = at as usize;
        let of = |k: usize| self.share.density.get(k).or(self.share.density.last()).copied().unwrap_or(1.0);
        of(k) + (of(k + 1) - of(k)) * (at - k as f64)
    }
}

impl Welch {
    fn of(signals: &[&[f64]], h: f64, length: usize) -> Self {
        let window: Vec<f64> = (0..length).map(|k| kaiser(2.0 * k as f64 / (length.max(2) - 1) as f64 - 1.0)).collect();
        let power: f64 = window.iter().map(|w| w * w).sum();
        let plan = forward(length);
        let (mut segment, mut bins) = (plan.make_input_vec(), plan.make_output_vec());
        let mut density = vec![0.0; bins.len()];
        let mut count = 0;
        for signal in signals.iter().filter(|signal| signal.len() >= length) {
            for from in (0..=signal.len() - length).step_by((length / 2).max(1)) {
                let own = &signal[from..from + length];
                let (middle, slope) = line(own);
                for (k, slot) in segment.iter_mut().enumerate() {
                    *slot = window[k] * (own[k] - middle - slope * (k as f64 - 0.5 * (length - 1) as f64));
                }
                plan.process(&mut segment, &mut bins).expect("invariant: buffers were made for this transform");
                density.iter_mut().zip(&bins).for_each(|(sum, bin)| *sum += bin.norm_sqr());
                count += 1;
            }
        }
        let scale = 2.0 * h / (power.max(f64::MIN_POSITIVE) * f64::from(count.max(1)));
        density.iter_mut().for_each(|sum| *sum *= scale);
        Welch { spacing: 1.0 / (length as f64 * h), density }
    }

    /// Frequency, Hz, and density of every bin.
    fn bins(&self) -> impl Iterator<Item = (f64, f64)> {
        self.density.iter().enumerate().map(|(k, p)| (k as f64 * self.spacing, *p))
    }
}

/// Mean and slope per sample of the straight line through even samples.
fn line(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let centre = 0.5 * (n - 1.0);
    let along: f64 = values.iter().enumerate().map(|(k, x)| (k as f64 - centre) * x).sum();
    let spread = n * (n * n - 1.0) / 12.0;
    (mean, if spread > 0.0 { along / spread } else { 0.0 })
}

/// The Kaiser window at x in -1..1, by the series of the modified Bessel function.
fn kaiser(x: f64) -> f64 {
    let bessel = |x: f64| {
        let (mut sum, mut term) = (1.0, 1.0);
        for k in 1..60 {
            term *= (0.5 * x / f64::from(k)).powi(2);
            sum += term;
        }
        sum
    };
    bessel(KAISER_SHAPE * (1.0 - x * x).max(0.0).sqrt()) / bessel(KAISER_SHAPE)
}

/// Deviation of the rate of a smoothed motion, unit of the coordinate per s, from noise of the sensor up to `followed` Hz.
pub(super) fn rate_deviation(noise: f64, followed: f64, h: f64) -> f64 {
    noise * 2.0 * PI * followed * (2.0 * followed * h / 3.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::Spectrum;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn noise_and_band_of_a_motion_are_found() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let h = 1e-3;
        let noise = 1e-5;
        // A chirp up to 8 Hz.
        let motion = |k: usize| {
            let t = k as f64 * h;
            (2.0 * std::f64::consts::PI * (0.5 * t + 0.375 * t * t)).sin()
        };
        let draw = |k: usize| motion(k) + noise * Distribution::<f64>::sample(&StandardNormal, &mut rng);
        let signal: Vec<f64> = (0..10_000).map(draw).collect();
        let found = Spectrum::of(&[&signal], h);
        assert!((found.noise / noise - 1.0).abs() < 0.1, "{}", found.noise);
        assert!(found.used > 7.0 && found.followed >= found.used && found.followed < 16.0, "{found:?}");
        assert!(found.share(4.0) > 0.999 && found.share(100.0) < 0.5);
    }
}
