//! Channels that say the same: a rate beside its position, a quantity that was recorded twice, a reference beside what follows it.
//!
//! Over the frequencies at which both move, one channel is a gain and a delay away from the other, or from its rate,
//! `b(t) = g a(t - tau)` or `b(t) = g a'(t - tau)`. The delay is the slope of the phase between them.

use crate::inspect::channel::ChannelReport;
use crate::inspect::signal::Signal;
use num_complex::Complex;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::PI;
use tpm_log::Role;
use tpm_numerics::Iteration;
use tpm_numerics::fourier::forward;

/// Most channels that are compared with each other, of a log without a model: every pair takes its time.
pub(super) const MOST_COMPARED: usize = 128;
/// Most samples on which two channels are compared.
const MOST_SAMPLES: usize = 1 << 17;
/// Most frequencies on which they are compared.
const MOST_FREQUENCIES: usize = 4096;
/// Least coherence of two channels before a delay is looked for.
const LEAST_COHERENCE: f64 = 0.8;
/// Least coherence of two columns behind the delay for one to follow from the other.
const LEAST_COHERENCE_OF_COPY: f64 = 0.997;
/// Least coherence behind the delay of a coordinate and its rate, of which a model says that they belong together.
const LEAST_COHERENCE_OF_RATE: f64 = 0.9;
/// Least spread of the frequencies, as a share of their mean: at one frequency everything is a gain and a delay away from everything.
const LEAST_SPREAD: f64 = 0.15;
/// The search for a delay, until a step is a small share of the sample time.
const DELAY_SEARCH: Iteration = Iteration { most: 30, settled: 1e-6 };

/// How one channel follows from another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum RelationKind {
    /// It is the rate of the other one.
    Rate,
    /// It is the other one.
    Same,
}

/// A channel that follows from another one.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Relation {
    /// How it follows.
    pub kind: RelationKind,
    /// The other channel.
    pub of: String,
    /// The channel.
    pub channel: String,
    /// Factor from the other channel, or from its rate.
    pub gain: f64,
    /// Time by which the channel is later, s.
    pub delay: f64,
    /// Standard deviation of that time, s.
    pub deviation: f64,
    /// Share of the channel that does not follow, root mean square.
    pub apart: f64,
}

/// A channel by its frequencies.
struct Spectrum {
    bins: Vec<Complex<f64>>,
    /// Frequencies up to this one hold motion, Hz.
    highest: f64,
}

/// The relations between channels, at most one of a kind for a channel. Of columns without a model the first [`MOST_COMPARED`] are compared.
pub(super) fn relations(signals: &[Signal<'_>], reports: &[ChannelReport], sample_time: f64) -> Vec<Relation> {
    let longest = signals.iter().flat_map(|signal| &signal.parts).max_by_key(|part| part.values.len());
    let Some(segment) = longest.map(|part| part.segment) else { return Vec::new() };
    let modelled = signals.iter().any(|signal| signal.role != Role::Column);
    let signals = if modelled { signals } else { &signals[..signals.len().min(MOST_COMPARED)] };
    let spectrum = |(signal, report): (&Signal<'_>, &ChannelReport)| -> Option<Spectrum> {
        let values = signal.part(segment)?.values;
        let highest = report.highest.filter(|_| !report.constant)?;
        Some(Spectrum { bins: windowed(&values[..values.len().min(MOST_SAMPLES)]), highest })
    };
    let spectra: Vec<Option<Spectrum>> = signals.par_iter().zip(reports).map(spectrum).collect();
    let samples = longest.map_or(0, |part| part.values.len().min(MOST_SAMPLES));
    let spacing = 2.0 * PI / (samples as f64 * sample_time);
    let of = |b: usize| -> Vec<Relation> {
        let own = &signals[b];
        let related = |kind: RelationKind| -> Option<Relation> {
            let fits = |a: &usize| match (modelled, kind) {
                (true, RelationKind::Rate) => {
                    own.role == Role::Rate && format!("dot({})", signals[*a].name) == own.name
                }
                (true, RelationKind::Same) => false,
                (false, RelationKind::Rate) => *a != b,
                (false, RelationKind::Same) => *a < b,
            };
            let candidates = (0..signals.len()).filter(fits).filter_map(|a| {
                let (first, second) = (spectra[a].as_ref()?, spectra[b].as_ref()?);
                let found = Compared::of(first, second, kind, spacing)?.aligned(sample_time)?;
                let enough = if modelled { LEAST_COHERENCE_OF_RATE } else { LEAST_COHERENCE_OF_COPY };
                (found.coherence >= enough).then_some((a, found))
            });
            let (a, found) = candidates.max_by(|x, y| x.1.coherence.total_cmp(&y.1.coherence))?;
            Some(Relation {
                kind,
                of: signals[a].name.to_string(),
                channel: own.name.to_string(),
                gain: found.gain,
                delay: found.delay,
                deviation: found.deviation,
                apart: (1.0 - found.coherence * found.coherence).max(0.0).sqrt(),
            })
        };
        // A copy of a channel is a rate whenever that channel is.
        let kinds = [RelationKind::Same, RelationKind::Rate];
        kinds.into_iter().find_map(related).into_iter().collect()
    };
    (0..signals.len()).into_par_iter().map(of).collect::<Vec<_>>().into_iter().flatten().collect()
}

/// Transform of samples under a Hann window, without their mean.
fn windowed(values: &[f64]) -> Vec<Complex<f64>> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let hann = |k: usize| 0.5 - 0.5 * (2.0 * PI * (k as f64 + 0.5) / n).cos();
    let mut input: Vec<f64> = values.iter().enumerate().map(|(k, x)| (x - mean) * hann(k)).collect();
    let plan = forward(values.len());
    let mut bins = plan.make_output_vec();
    plan.process(&mut input, &mut bins).expect("invariant: buffers were made for this transform");
    bins
}

/// Two channels over the frequencies at which both move.
struct Compared {
    /// Angular frequency and product of one with the other's conjugate.
    cross: Vec<(f64, Complex<f64>)>,
    first: f64,
    second: f64,
}

/// A gain and a delay.
struct Aligned {
    gain: f64,
    delay: f64,
    deviation: f64,
    coherence: f64,
}

impl Compared {
    fn of(first: &Spectrum, second: &Spectrum, kind: RelationKind, spacing: f64) -> Option<Self> {
        let count = first.bins.len().min(second.bins.len());
        let highest = 2.0 * PI * first.highest.min(second.highest);
        // The window reaches over two frequencies beside its own.
        let last = ((highest / spacing).ceil() as usize).min(count.saturating_sub(1));
        let stride = (last / MOST_FREQUENCIES).max(1);
        let mut compared = Compared { cross: Vec::new(), first: 0.0, second: 0.0 };
        for k in (3..=last).step_by(stride) {
            let w = k as f64 * spacing;
            let a = match kind {
                RelationKind::Rate => first.bins[k] * Complex::new(0.0, w),
                RelationKind::Same => first.bins[k],
            };
            compared.cross.push((w, second.bins[k] * a.conj()));
            compared.first += a.norm_sqr();
            compared.second += second.bins[k].norm_sqr();
        }
        let zero = compared.product(0.0).abs();
        (zero > LEAST_COHERENCE * (compared.first * compared.second).sqrt() && compared.is_broad()).then_some(compared)
    }

    /// Whether so many frequencies take part that a delay is told from a gain.
    fn is_broad(&self) -> bool {
        let (mut sum, mut mean, mut square) = (0.0, 0.0, 0.0);
        for (w, cross) in &self.cross {
            let power = cross.norm();
            sum += power;
            mean += power * w;
            square += power * w * w;
        }
        sum > 0.0 && square / sum - (mean / sum).powi(2) > (LEAST_SPREAD * mean / sum).powi(2)
    }

    /// Sum of the products when the second channel is taken so much earlier.
    fn product(&self, delay: f64) -> f64 {
        self.cross.iter().map(|(w, cross)| (cross * Complex::from_polar(1.0, w * delay)).re).sum()
    }

    /// The delay at which both are most alike.
    fn aligned(&self, sample_time: f64) -> Option<Aligned> {
        let mut delay = 0.0;
        for _ in 0..DELAY_SEARCH.most {
            let (mut slope, mut bend) = (0.0, 0.0);
            for (w, cross) in &self.cross {
                let turned = cross * Complex::from_polar(1.0, w * delay);
                slope -= w * turned.im;
                bend -= w * w * turned.re;
            }
            let step = slope / bend;
            if !step.is_finite() {
                return None;
            }
            delay -= step.clamp(-4.0 * sample_time, 4.0 * sample_time);
            if step.abs() < DELAY_SEARCH.settled * sample_time {
                break;
            }
        }
        let product = self.product(delay);
        let coherence = product.abs() / (self.first * self.second).sqrt();
        // Every frequency has a phase of variance (1 - c^2) / (2 c^2); those that take part alike tell the slope together.
        let (mut sum, mut squares, mut power) = (0.0, 0.0, 0.0);
        for (w, cross) in &self.cross {
            sum += cross.norm();
            squares += cross.norm_sqr();
            power += w * w * cross.norm();
        }
        let (taking_part, mean_square) = (sum * sum / squares, power / sum);
        let phase = ((1.0 - coherence * coherence) / (2.0 * coherence * coherence)).max(0.0);
        let deviation = (phase / (taking_part * mean_square)).sqrt();
        Some(Aligned { gain: product / self.first, delay, deviation, coherence })
    }
}
