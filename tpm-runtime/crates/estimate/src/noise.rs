//! Noise of a record whose inputs are known exactly because they were applied, not measured.
//!
//! Between the lines of the spectrum such a record holds the sensors' noise n and the motion nu that this noise caused on
//! its way round the loop. The motion obeys the model, so that `J q - B u = J n` whatever nu is (J is the periodic derivative
//! of the rows along the motion). Formed bin by bin, this residual shows the noise of the equations without the motion
//! that the inputs explain. Its level is smooth in frequency where the plant's response is not; a line therefore gets the
//! level of its neighbours times its own response.
//!
//! The mean of a row with terms that are even in the velocity holds `mean Phi(q + nu) = mean Phi(q) + Phi'' cov(nu) / 2`. Since
//! nu follows from the inputs, the shift is worked out and the mean can be used. Invariant: a record is refined at
//! estimates that were found without these corrections, which are of second order in the noise.

use crate::along::Along;
use crate::error::EstimateError;
use crate::run::Run;
use crate::select::strongest;
use num_complex::Complex;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{Dims, Model};
use tpm_motion::{Spectra, equal_rounding_runs, held, repeating_variance};
use tpm_numerics::fourier::{coefficient, synthesise};
use tpm_numerics::{DMatrix, DVector, tolerance};

/// Points of a period at which second derivatives are averaged.
const CURVATURE_POINTS: usize = 128;
/// Step of second differences as a share of a slot's amplitude.
const DIFFERENCE_STEP: f64 = 1e-2;
/// Fewest bins over which a level of white noise is averaged.
const LEAST_LEVEL_BINS: usize = 96;
/// Fewest bins nearest to a line from which its noise besides the sensors' white noise is read.
const LEAST_NEAREST_BINS: usize = 16;
/// Fewest periods of a record in which [`LEAST_NEAREST_BINS`] bins lie beside their own line, and not beside the next ones.
const LEAST_PERIODS: isize = 8;
/// Fewest bins over which the noise of rounding to counts is averaged. It is not white, so that only bins near a line tell
/// its level there.
const LEAST_ROUNDING_BINS: usize = 24;
/// Rounding to counts that makes up this share of a sensor's noise repeats with the motion: the noise is not white.
const MOST_WHITE_ROUNDING: f64 = 0.2;
/// Share of its variance from which on a rounding error repeats; noise of the sensor lets a smaller share average out with itself.
const LEAST_REPEATING_SHARE: f64 = 0.5;
/// A line belongs to a motion when its power is this many times that of rounding.
const LEAST_POWER_OVER_ROUNDING: f64 = 9.0;
/// Lines after which the sum of the motion between them is compared with what it was before.
const LINES_PER_BLOCK: usize = 16;
/// The sum of the motion between the lines ends where a [`LINES_PER_BLOCK`] adds less than this share.
const LEAST_BLOCK_SHARE: f64 = 1e-4;
/// Factor by which the correlation of neighbouring bins of a windowed spectrum raises the variance of the sum of their powers
/// (Hann: 1 + 2 (2/3)^2 + 2 (1/6)^2).
const BIN_CORRELATION: f64 = 1.94;
/// Lower bound on the relative standard deviation of the bias correction of a mean.
const LEAST_SHIFT_DEVIATION: f64 = 0.02;

/// What noise does to harmonic equations along a reference.
pub(super) struct NoiseAlong {
    /// Variance of every row's phasors by harmonic.
    pub(super) variance: Vec<Vec<f64>>,
    /// The part of a phasor's error, as a variance, that every run of the same motion repeats because it is rounded to the same counts;
    /// laid out as `variance`.
    pub(super) repeated: Vec<Vec<f64>>,
    /// Per row, the shifts of the means of the regressors and, last, of the known term by the motion that noise causes on its
    /// way round the loop. Beside them the standard deviation of a shift as a share of it. Nothing where that motion is not
    /// known.
    pub(super) shifts: Option<(Vec<Vec<f64>>, f64)>,
}

/// What noise does to the equations along a reference, harmonics 0 to `highest`; nothing where no noise stands out of rounding.
///
/// # Errors
/// [`EstimateError::Model`] when the model refuses an evaluation.
pub(super) fn noise_along(
    model: &dyn Model<f64>,
    run: &Run<'_>,
    along: &Along,
    theta: &[f64],
    highest: usize,
) -> Result<Option<NoiseAlong>, EstimateError> {
    let (dims, spectra) = (model.dims(), run.spectra);
    let Some(bins) = Bins::of(spectra, run.hold, dims) else { return Ok(None) };
    let sensors = bins.sensors(dims.coordinates);
    let noisy = |(c, power): (usize, &f64)| *power > (tolerance::READING * strongest(&spectra.lines[c])).powi(2);
    if !sensors.white.iter().enumerate().any(noisy) {
        return Ok(None);
    }
    let slots = along.slots();
    let maps: Vec<Vec<f64>> = along.map.chunks_exact(dims.inputs.max(1)).map(<[f64]>::to_vec).collect();
    let gains: Vec<Vec<Vec<Complex<f64>>>> = (0..dims.rows).map(|row| along.gains(row, theta)).collect();
    let of_row = |row: usize| {
        let (variance, apart) = row_variance(&bins, (&maps[row], highest), slots, &gains[row], &sensors);
        variance.iter().zip(&apart).map(|(noise, apart)| noise + apart).collect()
    };
    let variance = (0..dims.rows).map(of_row).collect();
    let repeated = gains.iter().map(|gain| row_rounding(&bins, highest, slots, gain, &sensors.repeated)).collect();
    let shifts = match true_motion(&bins, &maps, slots, &gains, dims.coordinates) {
        Some((motion, uncertainty)) => {
            Some((shifts(model, &run.trial.constants, spectra, highest, slots, &motion)?, uncertainty))
        }
        None => None,
    };
    Ok(Some(NoiseAlong { variance, repeated, shifts }))
}

/// What rounding to counts adds to every line of each coordinate, as a share of the variance that the noise of its sensor makes: in one
/// run, because it repeats with the motion, and alike in every run of the same motion.
pub(super) fn rounding_shares(spectra: &Spectra, hold: Hold, dims: Dims) -> Vec<(f64, f64)> {
    let Some(bins) = Bins::of(spectra, hold, dims) else {
        return vec![(0.0, 0.0); dims.coordinates];
    };
    let of = |c: usize| {
        let white = bins.white(c);
        let share = |power: f64| if white > 0.0 { power / white } else { 0.0 };
        let (repeating, repeated) = bins.repeating(c);
        (share(repeating), share(repeated))
    };
    (0..dims.coordinates).map(of).collect()
}

/// What the sensors of a record add to its transforms.
pub(super) struct Sensors {
    /// Power of every sensor's white noise in a bin.
    pub(super) white: Vec<f64>,
    /// Power that rounding to counts gives every line of a sensor because it repeats with the motion.
    repeating: Vec<f64>,
    /// Power of rounding to counts in every line of a sensor that all runs of the same motion repeat; zero without counts.
    pub(super) repeated: Vec<f64>,
    /// Whether rounding to counts makes up so much of the noise that it repeats.
    pub(super) counted: bool,
}

/// The windowed transforms of a record of whole periods.
pub(super) struct Bins<'a> {
    spectra: &'a Spectra,
    hold: Hold,
    periods: isize,
    /// Bins of the transforms.
    count: isize,
    /// How many of the first 0, 1, ... bins from a line on lie between the lines, where a periodic signal has nothing.
    between: Vec<isize>,
}

impl<'a> Bins<'a> {
    /// The transforms of a record. Nothing where periods are not whole numbers of samples (a shift by a harmonic is then no
    /// shift by bins), are fewer than four, or where channels or rows do not fit.
    pub(super) fn of(spectra: &'a Spectra, hold: Hold, dims: Dims) -> Option<Self> {
        let channels = spectra.bins.len() == dims.coordinates + dims.inputs;
        let usable = spectra.has_whole_periods() && dims.rows == dims.coordinates && spectra.periods >= 4 && channels;
        let periods = spectra.periods as isize;
        let mut between = vec![0];
        for beyond in 0..periods {
            let free = beyond.min(periods - beyond) as f64 > spectra.window.guard();
            between.push(between[beyond as usize] + isize::from(free));
        }
        let count = spectra.bins.first().map_or(0, Vec::len) as isize;
        usable.then_some(Bins { spectra, hold, periods, count, between })
    }

    /// What the sensors of the first `coordinates` channels add.
    pub(super) fn sensors(&self, coordinates: usize) -> Sensors {
        let white: Vec<f64> = (0..coordinates).map(|c| self.white(c)).collect();
        let (repeating, repeated) = (0..coordinates).map(|c| self.repeating(c)).unzip();
        Sensors { repeating, repeated, counted: self.counted(&white), white }
    }

    /// Whether rounding to counts makes up so much of the sensors' noise, given in every bin, that it repeats.
    fn counted(&self, white: &[f64]) -> bool {
        // The transform of white noise has E|X|^2 = sigma^2 bandwidth / N in every bin.
        let samples = self.spectra.samples_per_period * self.spectra.periods as f64;
        let share = MOST_WHITE_ROUNDING * samples / self.spectra.window.bandwidth();
        white.iter().zip(&self.spectra.steps).any(|(power, step)| step * step / 12.0 > share * power)
    }

    /// Power that rounding to counts gives every line of a sensor because it repeats with the motion: as noise of one run, and alike in all
    /// runs of the same motion. Where the motion rests, one error lasts so long that even the small share that noise of the sensor leaves
    /// counts in one run.
    fn repeating(&self, channel: usize) -> (f64, f64) {
        let alike = self.alike(channel);
        let repeated = self.rounding(channel, alike);
        let rests = self.spectra.rests.get(channel).copied().unwrap_or(false);
        (if alike < LEAST_REPEATING_SHARE && !rests { 0.0 } else { repeated }, repeated)
    }

    /// The share of the error of counts that is the same in every period; zero without counts.
    fn alike(&self, channel: usize) -> f64 {
        let Some(step) = self.spectra.steps.get(channel).filter(|step| **step > 0.0) else { return 0.0 };
        let samples = self.spectra.samples_per_period * self.spectra.periods as f64;
        // Noise of the sensor and motion that differs from period to period alike bring the counts out of step with the period. The
        // transform of white noise has E|X|^2 = sigma^2 bandwidth / N in every bin.
        let free = (0..self.count).filter(|bin| self.free(*bin));
        let (power, number) =
            free.fold((0.0, 0.0), |(power, number), bin| (power + self.at(channel, bin).norm_sqr(), number + 1.0));
        let between = power / f64::max(number, 1.0) * samples / self.spectra.window.bandwidth();
        let own = between / (step * step) - 1.0 / 12.0;
        repeating_variance(own.max(0.0)) / repeating_variance(0.0)
    }

    /// Power that the error of counts gives every line of a sensor, of which this share is the same in every period; zero without counts.
    ///
    /// The part of the error that follows from the motion is the same in every period, and in successive samples whose rounding errors are
    /// alike. It is also the same in all runs of one motion, and does not average out over them, even where noise of the sensor hides it in
    /// one run.
    fn rounding(&self, channel: usize, share: f64) -> f64 {
        let Some(step) = self.spectra.steps.get(channel).filter(|step| **step > 0.0) else { return 0.0 };
        let per_period = self.spectra.samples_per_period;
        // The motion without the lines of its rounding.
        let rounding = LEAST_POWER_OVER_ROUNDING * step * step / 3.0 / per_period;
        let of_motion = |line: &Complex<f64>| if line.norm_sqr() > rounding { *line } else { Complex::new(0.0, 0.0) };
        let lines: Vec<Complex<f64>> = self.spectra.lines[channel].iter().map(of_motion).collect();
        let motion = synthesise(&lines, 0, self.spectra.fundamental, lines.len(), per_period.round() as usize);
        let squares: usize = equal_rounding_runs(&motion, *step).iter().map(|length| length * length).sum();
        step * step / 12.0 * share * squares as f64 / (per_period * per_period)
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

    /// Number of bins between the lines among those below a bin.
    fn free_below(&self, bin: isize) -> isize {
        let bin = bin.clamp(0, self.count);
        let of_line = |beyond: isize| self.between[beyond as usize];
        bin / self.periods * of_line(self.periods) + of_line(bin % self.periods)
    }

    /// Whether a bin lies between the lines, where a periodic signal has nothing.
    fn free(&self, bin: isize) -> bool {
        self.free_below(bin + 1) > self.free_below(bin)
    }

    /// Bins between the lines around a line, at least `least` of them, symmetric where the spectrum allows.
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

    /// Power of a channel's noise in a bin, read between the highest lines, where there is hardly any motion.
    ///
    /// The median ignores the few bins that hold some; the median of |n|^2 is ln 2 times its mean.
    fn white(&self, channel: usize) -> f64 {
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

/// The harmonics of a row's derivatives that mix frequencies: those with a coefficient above rounding, and the mean.
pub(super) fn mixing(gain: &[Vec<Complex<f64>>]) -> Vec<isize> {
    let strongest: Vec<f64> =
        gain.iter().map(|lines| lines.iter().map(Complex::norm_sqr).fold(0.0, f64::max)).collect();
    let reach = gain.iter().map(Vec::len).max().unwrap_or(0).max(1) as isize;
    let mixes = |m: &isize| {
        *m == 0 || gain.iter().zip(&strongest).any(|(lines, peak)| coefficient(lines, *m).norm_sqr() > 1e-14 * peak)
    };
    (1 - reach..reach).filter(mixes).collect()
}

/// The derivative of an order of a phasor at an angular frequency.
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

/// E|n|^2 of a row's phasors, harmonics 0 to `highest`, in two parts: that of the sensors' white noise, and what the nearest
/// bins show besides (motion that leaks where the rows hardly feel it, errors of counts). `map` has the inputs' factors.
pub(super) fn row_variance(
    bins: &Bins<'_>,
    (map, highest): (&[f64], usize),
    slots: &[(usize, usize)],
    gain: &[Vec<Complex<f64>>],
    sensors: &Sensors,
) -> (Vec<f64>, Vec<f64>) {
    let Sensors { white, repeating, counted, .. } = sensors;
    let coordinates = white.len();
    let mixing = mixing(gain);
    let mut through = vec![Complex::new(0.0, 0.0); coordinates];
    // Power of the residual in a bin, and the power that the sensors' white noise gives it.
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
        let (_, found, expected) = sum(if *counted { LEAST_ROUNDING_BINS } else { LEAST_LEVEL_BINS });
        let level = if expected > 0.0 { found / expected } else { 0.0 };
        let mut apart = 0.0;
        if !*counted && bins.periods >= LEAST_PERIODS {
            let (near, found, expected) = sum(LEAST_NEAREST_BINS);
            apart = ((found - level * expected) / f64::from(near.max(1))).max(0.0);
        }
        let scale = if k == 0 { 1.0 } else { 4.0 };
        let line = k as isize * bins.periods;
        // A third of a line's noise comes from the two bins beside it, through the window. They are all of it where the row does not feel
        // the line itself, as the mean of a coordinate on which no force depends.
        let shape = (4.0 * pair(line).1 + pair(line - 1).1 + pair(line + 1).1) / 6.0;
        variances.0.push(scale * level * shape);
        variances.1.push(scale * apart);
    }
    let of_rounding = row_rounding(bins, highest, slots, gain, repeating);
    variances.1.iter_mut().zip(of_rounding).for_each(|(apart, rounding)| *apart += rounding);
    variances
}

/// E|n|^2 of a row's phasors, harmonics 0 to `highest`, when every sensor adds a power of its own to each of its lines.
pub(super) fn row_rounding(
    bins: &Bins<'_>,
    highest: usize,
    slots: &[(usize, usize)],
    gain: &[Vec<Complex<f64>>],
    power: &[f64],
) -> Vec<f64> {
    let mixing = mixing(gain);
    let mut felt = vec![Complex::new(0.0, 0.0); power.len()];
    let of = |k: usize| {
        let mut sum = 0.0;
        for &m in &mixing {
            response(slots, gain, m, bins.frequency((k as isize - m) * bins.periods), &mut felt);
            sum += felt.iter().zip(power).map(|(z, power)| z.norm_sqr() * power).sum::<f64>();
        }
        if k == 0 { sum } else { 4.0 * sum }
    };
    (0..=highest).map(of).collect()
}

/// Covariance of the motion between the lines, per pair of slots: the motion that the inputs between the lines explain, or the
/// measured one where it is less (near a resonance of the plant inputs say little). Beside it the largest relative standard
/// deviation of a variance: the mean over a record weighs this motion otherwise than the bins do, and the lines hide some bins.
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
        if k > 0 && k.is_multiple_of(LINES_PER_BLOCK) {
            let now: Vec<f64> = states.iter().map(|&s| covariance[(s, s)]).collect();
            if now.iter().zip(&checked).all(|(now, before)| now - before <= LEAST_BLOCK_SHARE * now) {
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
        if mean > 0.0 { (BIN_CORRELATION * square).sqrt() / mean } else { 0.0 }
    };
    let uncertainty = squares.iter().zip(&states).map(share).fold(LEAST_SHIFT_DEVIATION, f64::max);
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
    let harmonics = harmonics.min(CURVATURE_POINTS / 2 - 1);
    let waves: Vec<Vec<f64>> = slots
        .iter()
        .map(|&(c, d)| synthesise(&spectra.lines[c], d, spectra.fundamental, harmonics, CURVATURE_POINTS))
        .collect();
    let steps: Vec<f64> = waves
        .iter()
        .map(|wave| {
            let power = wave.iter().map(|x| x * x).sum::<f64>() / CURVATURE_POINTS as f64;
            if power > 0.0 { DIFFERENCE_STEP * power.sqrt() } else { DIFFERENCE_STEP }
        })
        .collect();
    let width = dims.parameters + 1;
    let mut shift = vec![vec![0.0; width]; dims.rows];
    let mut scratch = vec![0.0; model.workspace_len()];
    let (mut phi, mut known) = (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]);
    let mut motion = vec![0.0; dims.motion_len()];
    for i in 0..CURVATURE_POINTS {
        for (&(c, d), wave) in slots.iter().zip(&waves) {
            motion[d * dims.coordinates + c] = wave[i];
        }
        for a in 0..slots.len() {
            for b in 0..=a {
                let (at_a, at_b) = (slot_index(slots[a], dims.coordinates), slot_index(slots[b], dims.coordinates));
                // The covariance is symmetric: half of the sum over all pairs is half of the diagonal plus the lower triangle.
                let share = if a == b { 0.5 } else { 1.0 };
                let weight = share * covariance[(a, b)] / (4.0 * steps[a] * steps[b] * CURVATURE_POINTS as f64);
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
