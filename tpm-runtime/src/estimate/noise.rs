//! Noise of a record whose inputs are known exactly because they were applied, not measured.
//!
//! Between the lines of the spectrum such a record holds the sensors' noise n and the motion nu that this noise caused on
//! its way round the loop. The motion obeys the model, so that `J q - B u = J n` whatever nu is (J is the periodic derivative
//! of the rows along the motion): formed bin by bin, this residual shows the noise of the equations without the motion
//! that the inputs explain. Its level is smooth in frequency where the plant's response is not; a line therefore gets the
//! level of its neighbours times its own response.
//!
//! The mean of a row with terms that are even in the velocity holds `mean Phi(q + nu) = mean Phi(q) + Phi'' cov(nu) / 2`, and
//! since nu follows from the inputs, this shift is worked out and the mean can be used. Invariant: a record is refined at
//! estimates that were found without all this; what is added are corrections of second order in the noise.

use crate::estimate::along::Along;
use crate::estimate::error::EstimateError;
use crate::estimate::run::Run;
use crate::estimate::select::strongest;
use crate::numerics::fourier::{coefficient, synthesise};
use crate::numerics::{DMatrix, DVector};
use crate::run::Spectra;
use crate::run::held;
use num_complex::Complex;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::{Dims, Model};

/// An error, or noise, below this share of a signal's largest harmonic is rounding, not noise that could be weighed.
pub(super) const ROUNDING: f64 = 1e-9;
/// Points of a period at which second derivatives are averaged.
const POINTS: usize = 128;
/// Step of second differences as a share of a slot's amplitude.
const STEP: f64 = 1e-2;
/// Bins that one level of noise averages, at least.
const BINS: usize = 96;
/// Bins that show what a line has besides the sensors' white noise.
const NEAREST: usize = 16;
/// Periods in a record from which on so many bins lie beside a line, and not beside the next ones.
const CLOSE: isize = 8;
/// The same for counts, whose errors are not white: both at once, from the bins nearest to a line.
const COUNTED: usize = 24;
/// Rounding to counts that makes up this share of a sensor's noise repeats with the motion: the noise is not white.
const REPEATING: f64 = 0.2;
/// The motion between the lines is summed up to where so many lines add less than a share of it.
const BLOCK: usize = 16;
const NEGLIGIBLE: f64 = 1e-4;
/// Neighbouring bins of a windowed spectrum hang together: the sum of their powers varies as that of so many times fewer
/// (Hann: 1 + 2 (2/3)^2 + 2 (1/6)^2).
const TOGETHER: f64 = 1.94;
/// Least standard deviation of a shift of a mean as a share of it.
const SHIFT_UNCERTAINTY: f64 = 0.02;

/// What noise does to harmonic equations along a reference.
pub(super) struct NoiseAlong {
    /// Variance of every row's phasors by harmonic.
    pub(super) variance: Vec<Vec<f64>>,
    /// What the motion that noise causes on its way round the loop adds to the means of the regressors and, last, of the known
    /// term, per row, with the standard deviation of it as a share; nothing where that motion is not known.
    pub(super) shifts: Option<(Vec<Vec<f64>>, f64)>,
}

/// What noise does to the equations along a reference up to a harmonic; nothing where none stands out of rounding.
///
/// # Errors
/// [`EstimateError::Model`].
pub(super) fn noise_along(
    model: &dyn Model<f64>,
    run: &Run<'_>,
    along: &Along,
    theta: &[f64],
    highest: usize,
) -> Result<Option<NoiseAlong>, EstimateError> {
    let (dims, spectra) = (model.dims(), run.spectra);
    let Some(bins) = Bins::of(spectra, run.hold, dims) else { return Ok(None) };
    let white: Vec<f64> = (0..dims.coordinates).map(|c| bins.white(c)).collect();
    let noisy = |(c, power): (usize, &f64)| *power > (ROUNDING * strongest(&spectra.lines[c])).powi(2);
    if !white.iter().enumerate().any(noisy) {
        return Ok(None);
    }
    let counted = bins.counted(&white);
    let slots = along.slots();
    let maps: Vec<Vec<f64>> = along.map.chunks_exact(dims.inputs.max(1)).map(<[f64]>::to_vec).collect();
    let gains: Vec<Vec<Vec<Complex<f64>>>> = (0..dims.rows).map(|row| along.gains(row, theta)).collect();
    let of_row = |row: usize| {
        let (variance, apart) = row_variance(&bins, (&maps[row], highest), slots, &gains[row], &white, counted);
        variance.iter().zip(&apart).map(|(noise, apart)| noise + apart).collect()
    };
    let variance = (0..dims.rows).map(of_row).collect();
    let shifts = match true_motion(&bins, &maps, slots, &gains, dims.coordinates) {
        Some((motion, uncertainty)) => {
            Some((shifts(model, &run.trial.constants, spectra, highest, slots, &motion)?, uncertainty))
        }
        None => None,
    };
    Ok(Some(NoiseAlong { variance, shifts }))
}

/// The windowed transforms of a record of whole periods.
pub(super) struct Bins<'a> {
    spectra: &'a Spectra,
    hold: Hold,
    periods: isize,
    /// Bins of the transforms.
    count: isize,
    /// Bins between the lines, where a periodic signal has nothing, among the first 0, 1, ... of a line's.
    between: Vec<isize>,
}

impl<'a> Bins<'a> {
    /// Nothing where the record does not have them for a machine of these sizes: broken periods have no bins between the lines
    /// in common with the shifts of the periodic derivative.
    pub(super) fn of(spectra: &'a Spectra, hold: Hold, dims: Dims) -> Option<Self> {
        let whole = (spectra.samples_per_period - spectra.samples_per_period.round()).abs() < 1e-9;
        let channels = spectra.bins.len() == dims.coordinates + dims.inputs;
        let usable = whole && dims.rows == dims.coordinates && spectra.periods >= 4 && channels;
        let periods = spectra.periods as isize;
        let mut between = vec![0];
        for beyond in 0..periods {
            let free = beyond.min(periods - beyond) as f64 > spectra.window.guard();
            between.push(between[beyond as usize] + isize::from(free));
        }
        let count = spectra.bins.first().map_or(0, Vec::len) as isize;
        usable.then_some(Bins { spectra, hold, periods, count, between })
    }

    /// Whether rounding to counts makes up so much of the sensors' noise, given in every bin, that it repeats.
    pub(super) fn counted(&self, white: &[f64]) -> bool {
        // The transform of white noise has E|X|^2 = sigma^2 bandwidth / N in every bin.
        let samples = self.spectra.samples_per_period * self.spectra.periods as f64;
        let share = REPEATING * samples / self.spectra.window.bandwidth();
        white.iter().zip(&self.spectra.steps).any(|(power, step)| step * step / 12.0 > share * power)
    }

    /// Whether anything stands between the lowest lines of the coordinates.
    pub(super) fn hold_noise(&self, coordinates: usize) -> bool {
        (0..coordinates).any(|c| self.level(c, 0, self.spectra.highest().min(32)) > 0.0)
    }

    fn at(&self, channel: usize, bin: isize) -> Complex<f64> {
        let value = self.spectra.bins[channel].get(bin.unsigned_abs()).copied().unwrap_or_default();
        if bin < 0 { value.conj() } else { value }
    }

    fn frequency(&self, bin: isize) -> f64 {
        bin as f64 / self.periods as f64 * self.spectra.fundamental
    }

    /// A bin of an input as the force that was applied.
    fn applied(&self, coordinates: usize, input: usize, bin: isize) -> Complex<f64> {
        self.at(coordinates + input, bin) * held(self.hold, self.frequency(bin) * self.spectra.sample_time)
    }

    /// The bins between the lines below a bin.
    fn free_below(&self, bin: isize) -> isize {
        let bin = bin.clamp(0, self.count);
        let of_line = |beyond: isize| self.between[beyond as usize];
        bin / self.periods * of_line(self.periods) + of_line(bin % self.periods)
    }

    /// A bin between the lines, where a periodic signal has nothing.
    fn free(&self, bin: isize) -> bool {
        self.free_below(bin + 1) > self.free_below(bin)
    }

    /// Bins between the lines around a line that hold at least so many, symmetric where the spectrum allows.
    fn around(&self, line: usize, least: usize) -> impl Iterator<Item = isize> {
        let centre = line as isize * self.periods;
        let mut reach = self.periods / 2;
        while self.free_below(centre + reach + 1) - self.free_below(centre - reach) < least as isize
            && reach <= self.count
        {
            reach += self.periods / 2 + 1;
        }
        (centre - reach..=centre + reach).filter(|bin| self.free(*bin))
    }

    /// Power of a channel's noise in a bin: what stands between the highest lines, where no motion is.
    ///
    /// The median is deaf to what little motion there is; a median of |n|^2 is ln 2 of its mean.
    pub(super) fn white(&self, channel: usize) -> f64 {
        let highest = self.spectra.highest() as isize * self.periods;
        let free = (highest - highest / 4..highest).filter(|bin| self.free(*bin));
        let mut power: Vec<f64> = free.map(|bin| self.at(channel, bin).norm_sqr()).collect();
        if power.is_empty() {
            return 0.0;
        }
        let middle = power.len() / 2;
        let (_, median, _) = power.select_nth_unstable_by(middle, f64::total_cmp);
        *median / std::f64::consts::LN_2
    }

    /// Power of a channel in the bins between lines `from` and `to`.
    fn level(&self, channel: usize, from: usize, to: usize) -> f64 {
        (from..=to).flat_map(|k| self.around(k, 1)).map(|b| self.at(channel, b).norm_sqr()).sum()
    }
}

/// The harmonics of a row's derivatives that mix frequencies: what rounding alone leaves of a coefficient does not.
pub(super) fn mixing(gain: &[Vec<Complex<f64>>]) -> Vec<isize> {
    let strongest: Vec<f64> =
        gain.iter().map(|lines| lines.iter().map(Complex::norm_sqr).fold(0.0, f64::max)).collect();
    let reach = gain.iter().map(Vec::len).max().unwrap_or(0).max(1) as isize;
    let mixes = |m: &isize| {
        *m == 0 || gain.iter().zip(&strongest).any(|(lines, peak)| coefficient(lines, *m).norm_sqr() > 1e-14 * peak)
    };
    (1 - reach..reach).filter(mixes).collect()
}

/// The derivative of a phasor of this frequency.
fn derived(mut phasor: Complex<f64>, frequency: f64, order: usize) -> Complex<f64> {
    for _ in 0..order {
        phasor = Complex::new(-frequency * phasor.im, frequency * phasor.re);
    }
    phasor
}

/// Response of a row to the coordinates at a frequency through one harmonic of its derivative.
fn response(
    slots: &[(usize, usize)],
    gain: &[Vec<Complex<f64>>],
    m: isize,
    frequency: f64,
    response: &mut [Complex<f64>],
) {
    response.fill(Complex::new(0.0, 0.0));
    for (&(c, d), lines) in slots.iter().zip(gain) {
        response[c] += derived(coefficient(lines, m), frequency, d);
    }
}

/// E|n|^2 of the phasors of a row with these factors of the inputs, from harmonic 0 to the highest one: the part that the sensors'
/// white noise has, and what the nearest bins show beside it (motion that leaks where the rows hardly feel it, errors of counts).
pub(super) fn row_variance(
    bins: &Bins<'_>,
    (map, highest): (&[f64], usize),
    slots: &[(usize, usize)],
    gain: &[Vec<Complex<f64>>],
    white: &[f64],
    counted: bool,
) -> (Vec<f64>, Vec<f64>) {
    let coordinates = white.len();
    let mixing = mixing(gain);
    let mut through = vec![Complex::new(0.0, 0.0); coordinates];
    // The residual's power in a bin, and what the sensors' white noise makes of it.
    let mut pair = |bin: isize| -> (f64, f64) {
        let (mut residual, mut shape) = (Complex::new(0.0, 0.0), 0.0);
        for &m in &mixing {
            let source = bin - m * bins.periods;
            response(slots, gain, m, bins.frequency(source), &mut through);
            for (c, (z, size)) in through.iter().zip(white).enumerate() {
                residual += z * bins.at(c, source);
                shape += z.norm_sqr() * size;
            }
        }
        for (i, &b) in map.iter().enumerate() {
            residual -= bins.applied(coordinates, i, bin) * b;
        }
        (residual.norm_sqr(), shape)
    };
    let mut variances = (Vec::with_capacity(highest + 1), Vec::with_capacity(highest + 1));
    for k in 0..=highest {
        let mut sum = |least: usize| {
            let pairs = bins.around(k, least).map(&mut pair);
            pairs.fold((0, 0.0, 0.0), |(count, found, expected), of| (count + 1, found + of.0, expected + of.1))
        };
        let (_, found, expected) = sum(if counted { COUNTED } else { BINS });
        let level = if expected > 0.0 { found / expected } else { 0.0 };
        let mut apart = 0.0;
        if !counted && bins.periods >= CLOSE {
            let (near, found, expected) = sum(NEAREST);
            apart = ((found - level * expected) / f64::from(near.max(1))).max(0.0);
        }
        let scale = if k == 0 { 1.0 } else { 4.0 };
        let (_, shape) = pair(k as isize * bins.periods);
        variances.0.push(scale * level * shape);
        variances.1.push(scale * apart);
    }
    variances
}

/// Covariance of the motion between the lines, per pair of slots: what the inputs between the lines explain, or what was
/// measured where that is less (near a resonance of the plant inputs say little). Beside it the standard deviation of its
/// largest share: the mean over a record weighs this motion otherwise than the bins do, and some bins are hidden by the lines.
pub(super) fn true_motion(
    bins: &Bins<'_>,
    maps: &[Vec<f64>],
    slots: &[(usize, usize)],
    gains: &[Vec<Vec<Complex<f64>>>],
    coordinates: usize,
) -> Option<(DMatrix<f64>, f64)> {
    let spectra = bins.spectra;
    // The transform of white noise has E|X|^2 = sigma^2 bandwidth / N in every bin.
    let bandwidth = spectra.window.bandwidth();
    let mut covariance = DMatrix::zeros(slots.len(), slots.len());
    // The highest derivative of a coordinate enters its rows linearly and shifts nothing by itself; its spectrum may be wide.
    let order = |c: usize| slots.iter().filter(|slot| slot.0 == c).map(|slot| slot.1).max().unwrap_or(0);
    let states: Vec<usize> = (0..slots.len()).filter(|&s| slots[s].1 < order(slots[s].0)).collect();
    let mut checked = vec![0.0; states.len()];
    let mut squares = vec![0.0; states.len()];
    let zero = Complex::new(0.0, 0.0);
    let mut matrix = DMatrix::from_element(coordinates, coordinates, zero);
    let (mut force, mut through) = (DVector::from_element(coordinates, zero), vec![zero; coordinates]);
    let mut parts = vec![zero; slots.len()];
    let mut powers = vec![(0.0, 0.0); coordinates];
    // The motion that the inputs explain in the bins around a line, coordinate by coordinate.
    let mut explained: Vec<Complex<f64>> = Vec::new();
    for k in 0..=spectra.highest() {
        if k > 0 && k.is_multiple_of(BLOCK) {
            let now: Vec<f64> = states.iter().map(|&s| covariance[(s, s)]).collect();
            if now.iter().zip(&checked).all(|(now, before)| now - before <= NEGLIGIBLE * now) {
                break;
            }
            checked = now;
        }
        let first = k as isize * bins.periods;
        let near = || (first..first + bins.periods).filter(|bin| bins.free(*bin));
        powers.fill((0.0, 0.0));
        explained.clear();
        for bin in near() {
            let frequency = bins.frequency(bin);
            for (row, gain) in gains.iter().enumerate() {
                response(slots, gain, 0, frequency, &mut through);
                matrix.row_mut(row).copy_from_slice(&through);
                force[row] = maps[row].iter().enumerate().map(|(i, &b)| bins.applied(coordinates, i, bin) * b).sum();
            }
            if !matrix.clone().lu().solve_mut(&mut force) {
                return None;
            }
            for (c, power) in powers.iter_mut().enumerate() {
                power.0 += force[c].norm_sqr();
                power.1 += bins.at(c, bin).norm_sqr();
            }
            explained.extend(force.iter());
        }
        if explained.is_empty() {
            return None;
        }
        // Both signs of the frequency, and the bins that the lines cover.
        let weight = 2.0 / bandwidth * bins.periods as f64 / (explained.len() / coordinates) as f64;
        for (bin, explained) in near().zip(explained.chunks_exact(coordinates)) {
            let frequency = bins.frequency(bin);
            for (part, &(c, d)) in parts.iter_mut().zip(slots) {
                let value = if powers[c].0 <= powers[c].1 { explained[c] } else { bins.at(c, bin) };
                *part = derived(value, frequency, d);
            }
            for (square, &s) in squares.iter_mut().zip(&states) {
                *square += (weight * parts[s].norm_sqr()).powi(2);
            }
            for (a, x) in parts.iter().enumerate() {
                for (b, y) in parts.iter().enumerate() {
                    covariance[(a, b)] += weight * (x * y.conj()).re;
                }
            }
        }
    }
    let share = |(square, &s): (&f64, &usize)| {
        let mean: f64 = covariance[(s, s)];
        if mean > 0.0 { (TOGETHER * square).sqrt() / mean } else { 0.0 }
    };
    let uncertainty = squares.iter().zip(&states).map(share).fold(SHIFT_UNCERTAINTY, f64::max);
    covariance.iter().all(|x: &f64| x.is_finite()).then_some((covariance, uncertainty))
}

/// Shift of the mean of every regressor, then of the known term, per row: half the mean second derivative times the covariance.
pub(super) fn shifts(
    model: &dyn Model<f64>,
    constants: &[f64],
    spectra: &Spectra,
    harmonics: usize,
    slots: &[(usize, usize)],
    covariance: &DMatrix<f64>,
) -> Result<Vec<Vec<f64>>, EstimateError> {
    let dims = model.dims();
    let harmonics = harmonics.min(POINTS / 2 - 1);
    let waves: Vec<Vec<f64>> =
        slots.iter().map(|&(c, d)| synthesise(&spectra.lines[c], d, spectra.fundamental, harmonics, POINTS)).collect();
    let steps: Vec<f64> = waves
        .iter()
        .map(|wave| {
            let power = wave.iter().map(|x| x * x).sum::<f64>() / POINTS as f64;
            if power > 0.0 { STEP * power.sqrt() } else { STEP }
        })
        .collect();
    let width = dims.parameters + 1;
    let mut shift = vec![vec![0.0; width]; dims.rows];
    let mut scratch = vec![0.0; model.workspace_len()];
    let (mut phi, mut known) = (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]);
    let mut motion = vec![0.0; dims.motion_len()];
    for i in 0..POINTS {
        for (&(c, d), wave) in slots.iter().zip(&waves) {
            motion[d * dims.coordinates + c] = wave[i];
        }
        for a in 0..slots.len() {
            for b in 0..=a {
                let (at_a, at_b) = (slot_index(slots[a], dims.coordinates), slot_index(slots[b], dims.coordinates));
                // The pair (b, a) gives the same as (a, b); half of the sum is half of the diagonal plus the upper part.
                let share = if a == b { 0.5 } else { 1.0 };
                let weight = share * covariance[(a, b)] / (4.0 * steps[a] * steps[b] * POINTS as f64);
                for (sign_a, sign_b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                    let (before_a, before_b) = (motion[at_a], motion[at_b]);
                    motion[at_a] += sign_a * steps[a];
                    motion[at_b] += sign_b * steps[b];
                    model.regressor(&motion, constants, &mut scratch, &mut phi)?;
                    model.known(&motion, constants, &mut scratch, &mut known)?;
                    motion[at_a] = before_a;
                    motion[at_b] = before_b;
                    for (r, of_row) in shift.iter_mut().enumerate() {
                        for (j, sum) in of_row.iter_mut().enumerate() {
                            let value = if j < dims.parameters { phi[r * dims.parameters + j] } else { known[r] };
                            *sum += weight * sign_a * sign_b * value;
                        }
                    }
                }
            }
        }
    }
    Ok(shift)
}

const fn slot_index(slot: (usize, usize), coordinates: usize) -> usize {
    slot.1 * coordinates + slot.0
}
