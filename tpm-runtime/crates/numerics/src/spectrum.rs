//! What the spectrum of a measured coordinate says: the noise of its sensor, up to which frequency the motion stands out of it, and what
//! share of every frequency is motion.

use crate::fourier::forward;
use crate::whole;
use std::f64::consts::PI;

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
/// Frequencies up to which a model is compared with a motion, in units of the highest that is followed.
const COMPARED: f64 = 1.25;
/// Share of the power of a motion beyond which it may end.
const NEARLY_ALL: f64 = 0.999;
/// The median of a power whose mean is one, for averages of a few overlapping segments.
const MEDIAN_POWER: f64 = 0.9;
/// Corner frequencies at which colours of a sensor's noise are tried, per octave: neighbours differ by less than their spectra can be told
/// apart.
const CORNERS_PER_OCTAVE: i32 = 4;
/// Octaves below half of the sampling frequency down to which corners are tried.
const CORNER_OCTAVES: i32 = 10;
/// A colour is looked at where it makes the noise at the edge of the motion's band at least twice that of the upper quarter: below, it
/// moves no edge by more than a few per cent.
const COLOURED: f64 = 2.0;
/// Rounds in which the edge of the band and the colour above it are found from each other.
const ROUNDS: usize = 8;

/// A spectrum by averaged segments (Welch 1967).
#[derive(Clone, Debug)]
struct Welch {
    /// From one bin to the next, Hz.
    spacing: f64,
    /// Power of each bin per Hz, to one side.
    density: Vec<f64>,
}

/// Density of a sensor's noise per Hz, to one side: white, or of first order,
///
/// ```text
/// S(f) = level / (1 + r^2 - 2 r cos(2 pi f h)).
/// ```
#[derive(Clone, Copy, Debug)]
struct Floor {
    level: f64,
    /// Correlation r of one sample with the next.
    correlation: f64,
    /// Time from one to the next, s.
    h: f64,
}

impl Floor {
    fn at(&self, frequency: f64) -> f64 {
        self.level / self.whitened((2.0 * PI * frequency * self.h).cos())
    }

    /// What a density times this is white, given the cosine of the phase between samples.
    fn whitened(&self, cosine: f64) -> f64 {
        1.0 + self.correlation * (self.correlation - 2.0 * cosine)
    }

    /// The colour of first order that is likeliest (Whittle 1953) for the densities of bins at which nothing moves; nothing without bins.
    fn of(bins: impl Iterator<Item = (f64, f64)>, h: f64) -> Option<Self> {
        let bins: Vec<(f64, f64)> = bins.map(|(f, power)| ((2.0 * PI * f * h).cos(), power)).collect();
        let count = Some(bins.len() as f64).filter(|count| *count > 0.0)?;
        let tried = (0..=CORNERS_PER_OCTAVE * CORNER_OCTAVES).map(|k| {
            let corner = 0.5 / h * 2.0_f64.powf(-f64::from(k) / f64::from(CORNERS_PER_OCTAVE));
            let correlation = if k == 0 { 0.0 } else { (-2.0 * PI * corner * h).exp() };
            let colour = Floor { level: 1.0, correlation, h };
            let (mut level, mut logs) = (0.0, 0.0);
            for (cosine, power) in &bins {
                let whitened = colour.whitened(*cosine);
                level += power * whitened;
                logs -= whitened.ln();
            }
            level /= count;
            (level.max(f64::MIN_POSITIVE).ln() + logs / count, Floor { level, ..colour })
        });
        tried.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, likeliest)| likeliest)
    }
}

/// What the spectrum of one coordinate says.
#[derive(Clone, Debug)]
pub struct Spectrum {
    /// Deviation, in the unit of the coordinate, of white noise whose density is the median density of this spectrum above a quarter of
    /// the sampling rate.
    pub noise: f64,
    floor: Floor,
    /// Highest frequency at which the motion stands out of the noise, Hz.
    pub followed: f64,
    /// Highest frequency at which it stands far out of the noise, Hz.
    pub used: f64,
    share: Welch,
}

impl Spectrum {
    /// The spectrum of a coordinate that was measured in stretches of even samples, `h` seconds apart.
    #[must_use]
    pub fn of(signals: &[&[f64]], h: f64) -> Self {
        let longest = signals.iter().map(|signal| signal.len()).max().unwrap_or(0);
        let duration = longest as f64 * h;
        let length = whole::below(LEAST_SEGMENT.max(duration / SEGMENTS) / h);
        let fine = Welch::of(signals, h, length.clamp(1, longest.max(1)));
        let quarter = 0.25 / h;
        let mut high: Vec<f64> = fine.bins().filter(|(f, _)| *f > quarter).map(|(_, p)| p).collect();
        high.sort_by(f64::total_cmp);
        let white = high.get(high.len() / 2).copied().unwrap_or(0.0) / MEDIAN_POWER;
        let white = Floor { level: white, correlation: 0.0, h };
        let first = MAIN_LOBE.max(3);
        let end = fine.density.len();
        let smooth = |k: usize| {
            let near = &fine.density[k.saturating_sub(1)..(k + 2).min(end)];
            near.iter().sum::<f64>() / near.len() as f64
        };
        let under = |k: usize, ratio: f64, floor: &Floor| smooth(k) < ratio * floor.at(k as f64 * fine.spacing);
        // The bin up to which nearly all of the motion's power lies: a motion of a few sines falls to the noise between them, too.
        let most = |floor: &Floor| {
            let own = || {
                let bins = fine.bins().enumerate().take_while(|(_, (f, _))| *f <= quarter);
                bins.map(|(k, (_, power))| if under(k, FOLLOWED, floor) { 0.0 } else { power })
            };
            let nearly_all = NEARLY_ALL * own().sum::<f64>();
            let mut sum = 0.0;
            let reached = |power: f64| {
                sum += power;
                sum >= nearly_all
            };
            own().position(reached).unwrap_or(0)
        };
        let below = |ratio: f64, floor: &Floor| {
            let edge = (first.max(most(floor))..end).find(|k| under(*k, ratio, floor));
            edge.map_or(quarter, |k| (k as f64 * fine.spacing).min(quarter))
        };
        // The noise is seen above the motion, whose band is known by the noise.
        let mut floor = white;
        for _ in 0..ROUNDS {
            let edge = below(FOLLOWED, &floor);
            let Some(coloured) = Floor::of(fine.bins().filter(|(f, _)| *f > edge), h) else { break };
            let before = std::mem::replace(&mut floor, coloured);
            if coloured.correlation == before.correlation {
                break;
            }
        }
        if floor.at(below(FOLLOWED, &floor)) < COLOURED * white.level {
            floor = white;
        }
        let noise = (white.level * 0.5 / h).sqrt();
        let (followed, used) = (below(FOLLOWED, &floor), below(USED, &floor));
        let segment = whole::below(SHARE_SEGMENT / h).clamp(1, longest.max(1));
        let mut share = Welch::of(signals, h, segment);
        let logs: Vec<f64> = share.density.iter().map(|p| p.max(f64::MIN_POSITIVE).ln()).collect();
        let spacing = share.spacing;
        for (k, p) in share.density.iter_mut().enumerate() {
            let near = &logs[k.saturating_sub(1)..(k + 2).min(logs.len())];
            let smooth = (near.iter().sum::<f64>() / near.len() as f64).exp();
            let floor = floor.at(k as f64 * spacing);
            *p = if k < MAIN_LOBE { 1.0 } else { (1.0 - floor / smooth).max(0.0) };
        }
        Spectrum { noise, floor, followed, used, share }
    }

    /// Frequency up to which a model is compared with the motion, Hz.
    #[must_use]
    pub fn compared(&self) -> f64 {
        COMPARED * self.followed
    }

    /// Variance of white noise whose density is that of the sensor's noise at a frequency, Hz.
    pub fn noise_at(&self, frequency: f64) -> f64 {
        0.5 * self.floor.at(frequency) / self.floor.h
    }

    /// Share of the power at a frequency, Hz, that is motion: the response of the smoother that gives E[q | y], Wiener's.
    pub fn share(&self, frequency: f64) -> f64 {
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
pub fn rate_deviation(noise: f64, followed: f64, h: f64) -> f64 {
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

    /// Sines with nothing between them and nothing below them, and the hum of the mains on the sensor.
    #[test]
    fn a_motion_of_a_few_sines_ends_above_the_last_of_them() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let sine = |frequency: f64, t: f64| (2.0 * std::f64::consts::PI * frequency * t + frequency).sin();
        let signal: Vec<f64> = (0..20_000)
            .map(|k| {
                let t = 1e-3 * f64::from(k);
                let motion: f64 = [2.3, 5.1, 9.2].iter().map(|f| sine(*f, t) / f).sum();
                motion + 1e-3 * sine(50.0, t) + 1e-5 * Distribution::<f64>::sample(&StandardNormal, &mut rng)
            })
            .collect();
        let found = Spectrum::of(&[&signal], 1e-3);
        assert!(found.used > 9.2 && found.followed >= found.used && found.followed < 14.0, "{found:?}");
    }

    #[test]
    fn coloured_noise_is_not_taken_for_motion() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let (h, noise, correlation) = (1e-3, 1e-3, 0.95_f64);
        let mut colour = 0.0;
        let signal: Vec<f64> = (0..10_000)
            .map(|k| {
                let fresh: f64 = StandardNormal.sample(&mut rng);
                colour = correlation * colour + (1.0 - correlation * correlation).sqrt() * fresh;
                let t = f64::from(k) * h;
                (2.0 * std::f64::consts::PI * (0.5 * t + 0.375 * t * t)).sin() + noise * colour
            })
            .collect();
        let found = Spectrum::of(&[&signal], h);
        // Density of the noise, over that of white noise of the same deviation.
        let exact = |f: f64| {
            (1.0 - correlation * correlation)
                / (1.0 + correlation * correlation - 2.0 * correlation * (2.0 * std::f64::consts::PI * f * h).cos())
        };
        for f in [20.0, 100.0, 400.0] {
            let ratio = found.noise_at(f) / (noise * noise * exact(f));
            assert!((ratio - 1.0).abs() < 0.25, "{f} Hz: {ratio}");
        }
        // The chirp ends at 8 Hz; the noise falls to a tenth only at 25 Hz.
        assert!(found.used > 6.0 && found.followed >= found.used && found.followed < 16.0, "{found:?}");
    }
}
