//! Rows of a model as lines of a spectrum: one transform for every column, after which no sample is needed any more.
//!
//! All columns of a row pass the same low pass and the same window. A window multiplies the equation itself, so that it biases nothing:
//! it leaves out the ends of a stretch, and the times around a reversal, where friction takes any value within its bounds and a smoothed
//! sign comes late.

use crate::likelihood::path::Path;
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::transform::Transform;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::ops::Range;
use tpm_numerics::fourier::forward;
use tpm_numerics::{DMatrix, DVector, root_mean_square, whole};

/// Share of a stretch over which the window rises and falls.
const TAPER: f64 = 0.1;
/// Fewest lines of a band in which the noise counts as white: they tell its variance to a fifth.
const BAND_LINES: usize = 12;
/// Largest ratio of the ends of a band of more lines: a third of an octave.
const BAND_RATIO: f64 = 1.35;
/// Around a reversal, times over the highest frequency that is followed: what is left out, and over how long the window comes back.
const NOTCH: f64 = 0.6;
const NOTCH_RISE: f64 = 1.0;
/// Deviations of the velocity below which its sign is not known.
const SIGN_UNKNOWN: f64 = 3.0;
/// Least share of the record that notches may leave.
const LEAST_LEFT: f64 = 0.3;
/// Shares of the full width of a notch that are tried.
const NOTCH_SHARES: [f64; 8] = [1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.0];

/// Lines of one row: real parts, and behind them imaginary parts.
#[derive(Clone, Debug)]
pub(super) struct RowLines {
    /// Numbers of the columns, ascending; the last one is the right-hand side.
    pub(super) columns: Vec<usize>,
    /// Twice the lines times the columns.
    pub(super) entries: DMatrix<f64>,
    /// Frequency of every line, Hz.
    pub(super) frequency: Vec<f64>,
    /// Band of every line.
    pub(super) band: Vec<usize>,
    /// Lines of every stretch.
    pub(super) stretches: Vec<Range<usize>>,
    /// Power of the forces of the row, by line.
    pub(super) power: Vec<f64>,
    /// Variance of a part of a line that the sensors' noise makes, by line.
    pub(super) floor: Vec<f64>,
    /// By how much a window correlates neighbouring lines: mean of the fourth power of the window over the square of that of its square.
    pub(super) correlation: f64,
    /// Share of the record that the window leaves.
    pub(super) kept: f64,
}

impl RowLines {
    /// Number of lines.
    pub(super) fn lines(&self) -> usize {
        self.frequency.len()
    }

    /// Number of bands.
    pub(super) fn bands(&self) -> usize {
        self.band.iter().max().map_or(0, |last| last + 1)
    }

    /// Where a column stands.
    pub(super) fn place(&self, column: usize) -> Option<usize> {
        self.columns.binary_search(&column).ok()
    }

    /// The lines of a column; zeros where the row does not have it.
    pub(super) fn column(&self, column: usize) -> DVector<f64> {
        self.place(column).map_or_else(|| DVector::zeros(2 * self.lines()), |at| self.entries.column(at).into_owned())
    }

    /// Mean power of the forces of a line.
    pub(super) fn force(&self) -> f64 {
        2.0 * self.power.iter().sum::<f64>() / self.lines().max(1) as f64
    }

    /// These columns, those that the row has, with every part of a line multiplied by its weight; beside them their places in the list.
    pub(super) fn weighted(&self, columns: &[usize], weights: &[f64]) -> (Vec<usize>, DMatrix<f64>) {
        let all = columns.iter().enumerate();
        let (at, places): (Vec<usize>, Vec<usize>) =
            all.filter_map(|(at, &column)| Some((at, self.place(column)?))).unzip();
        let matrix =
            DMatrix::from_fn(weights.len(), places.len(), |part, i| self.entries[(part, places[i])] * weights[part]);
        (at, matrix)
    }

    /// Mean power per line of a column.
    pub(super) fn size(&self, column: usize) -> f64 {
        self.place(column).map_or(0.0, |at| self.entries.column(at).norm_squared() / self.lines().max(1) as f64)
    }

    /// Takes the power of the forces from a column of lines, three lines wide; from the largest of the row's own columns where it is nothing.
    pub(super) fn take_power(&mut self, column: DVector<f64>) {
        let nothing = column.iter().all(|x| *x == 0.0);
        let own = self.entries.columns(0, self.columns.len().saturating_sub(1));
        let largest = own.column_iter().max_by(|a, b| a.norm().total_cmp(&b.norm()));
        let column = largest.filter(|_| nothing).map_or(column, |largest| largest.into_owned());
        let lines = self.lines();
        let own: Vec<f64> = (0..lines).map(|l| column[l].powi(2) + column[lines + l].powi(2)).collect();
        self.power = vec![0.0; own.len()];
        for range in &self.stretches {
            let part = &own[range.clone()];
            for k in 0..part.len() {
                let below = part.get(k.wrapping_sub(1)).or(part.get(1)).copied().unwrap_or(part[k]);
                let above = part.get(k + 1).copied().unwrap_or(part[k]);
                self.power[range.start + k] = 0.5 * (0.25 * below + 0.5 * part[k] + 0.25 * above);
            }
        }
    }

    /// Whether a part of a line is always zero: the imaginary part at no frequency.
    pub(super) fn is_void(&self, part: usize) -> bool {
        let lines = self.lines();
        part >= lines && self.frequency[part - lines] <= 0.0
    }
}

/// How a row is looked at: its low pass, the frequency up to which its lines are used, and the coordinate whose reversals are left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct View {
    pub(super) low_pass: LowPass,
    /// Hz.
    pub(super) used: f64,
    /// Time that is lost at either end of a stretch, s.
    pub(super) lost: f64,
    pub(super) coordinate: Option<usize>,
    /// Deviation of the coordinate's velocity.
    pub(super) rate_deviation: f64,
    /// Highest frequency at which the coordinate is followed, Hz.
    pub(super) followed: f64,
    /// Largest share of the full width that the notches around reversals may have.
    pub(super) notch: f64,
}

/// The window of a row over a stretch, of unit sum of squares.
struct Window {
    range: Range<usize>,
    weights: Vec<f64>,
    correlation: f64,
    kept: f64,
}

impl View {
    fn window(&self, path: &Path) -> Option<Window> {
        let valid = path.valid(self.lost);
        let n = valid.len();
        if n < 2 * BAND_LINES {
            return None;
        }
        let edge = if path.circular { 0.0 } else { 0.5 * TAPER * n as f64 };
        let taper = |k: usize| {
            let near = (k as f64 + 0.5).min(n as f64 - k as f64 - 0.5);
            if near < edge { 0.5 - 0.5 * (PI * near / edge).cos() } else { 1.0 }
        };
        let notch = self.coordinate.map(|c| self.notch(path, &valid, c));
        let of = |k: usize| taper(k) * notch.as_ref().map_or(1.0, |notch| notch[k]);
        let weights: Vec<f64> = (0..n).map(of).collect();
        let mean = |power: i32| weights.iter().map(|w| w.powi(power)).sum::<f64>() / n as f64;
        let (second, fourth) = (mean(2), mean(4));
        let length = (second * n as f64).sqrt();
        let weights = weights.iter().map(|w| w / length).collect();
        Some(Window { range: valid, weights, correlation: fourth / (second * second), kept: second })
    }

    /// One, and nothing around the times at which the velocity of a coordinate is small.
    fn notch(&self, path: &Path, valid: &Range<usize>, c: usize) -> Vec<f64> {
        let n = valid.len();
        let v = path.series(c, 1);
        let a = root_mean_square(path.series(c, 2));
        let width = self.low_pass.cut_off / (2.0 * PI);
        let slow = (SIGN_UNKNOWN * self.rate_deviation).max(a / (2.0 * PI * self.followed));
        let mut weights = vec![1.0; n];
        for share in NOTCH_SHARES.into_iter().filter(|share| *share <= self.notch) {
            let reach = whole::below(share * NOTCH / width / path.apart);
            let rise = whole::below(NOTCH_RISE / width / path.apart) + 1;
            let bad: Vec<bool> = valid.clone().map(|k| v[k].abs() < share * slow).collect();
            weights = rounded(&widened(&bad, reach + rise, path.circular), rise, path.circular);
            if weights.iter().map(|w| w * w).sum::<f64>() > LEAST_LEFT * n as f64 {
                break;
            }
        }
        weights
    }

    /// What notches of every width leave of a stretch; nothing for a row without a coordinate of its own.
    pub(super) fn left_by_notches(&self, path: &Path) -> Option<Masks> {
        let coordinate = self.coordinate?;
        let valid = path.valid(self.lost);
        let shares = NOTCH_SHARES.into_iter().rev().filter(|share| *share <= self.notch);
        let of = |share: f64| {
            let weights = View { notch: share, ..*self }.notch(path, &valid, coordinate);
            (share, weights.iter().map(|weight| *weight > 0.5).collect())
        };
        let of_share = shares.map(of).collect();
        Some(Masks { valid, of_share })
    }

    /// What the low pass of the row leaves of every bin of a stretch.
    pub(super) fn shares(&self, path: &Path) -> Vec<f64> {
        let spacing = 2.0 * PI / (path.points as f64 * path.apart);
        (0..=path.points / 2).map(|k| self.low_pass.response(k as f64 * spacing)).collect()
    }

    /// A signal behind the low pass of the row, whose shares are given, along the whole stretch.
    pub(super) fn passed(path: &Path, shares: &[f64], signal: &[f64]) -> Vec<f64> {
        Transform::new(signal, path.points, path.apart).weighted(path.points, shares)
    }
}

/// What notches leave of a stretch.
pub(super) struct Masks {
    /// The points that are used.
    pub(super) valid: Range<usize>,
    /// For every share of the full width, the narrowest first, which of these points are left.
    pub(super) of_share: Vec<(f64, Vec<bool>)>,
}

/// Whether a mask leaves enough of a record.
pub(super) fn is_enough(mask: &[bool]) -> bool {
    mask.iter().filter(|left| **left).count() as f64 > LEAST_LEFT * mask.len() as f64
}

/// Marks all that is within `reach` of a mark.
fn widened(marks: &[bool], reach: usize, circular: bool) -> Vec<bool> {
    let n = marks.len();
    let mut sums = vec![0_i64; n + 1];
    let mut add = |from: usize, to: usize| {
        sums[from] += 1;
        sums[to] -= 1;
    };
    for k in (0..n).filter(|&k| marks[k]) {
        let (from, to) = (k.saturating_sub(reach), (k + reach + 1).min(n));
        add(from, to);
        if circular && k < reach {
            add((n + k).saturating_sub(reach), n);
        }
        if circular && k + reach + 1 > n {
            add(0, (k + reach + 1 - n).min(n));
        }
    }
    let mut count = 0;
    (0..n)
        .map(|k| {
            count += sums[k];
            count > 0
        })
        .collect()
}

/// One less marks averaged by a Hann window that reaches over `reach` to either side.
fn rounded(marks: &[bool], reach: usize, circular: bool) -> Vec<f64> {
    let n = marks.len();
    // The mean of a Hann window over a run of marks is that of its integral's ends.
    let integral = |x: f64| {
        let x = x.clamp(-1.0, 1.0);
        0.5 * (1.0 + x) + (PI * x).sin() / (2.0 * PI)
    };
    let mut weights = vec![1.0_f64; n];
    let mut k = 0;
    while k < n {
        if !marks[k] {
            k += 1;
            continue;
        }
        let from = k;
        while k < n && marks[k] {
            k += 1;
        }
        // A mark at an end of a stretch that goes on goes on.
        let low = if from == 0 && !circular { f64::NEG_INFINITY } else { from as f64 };
        let high = if k == n && !circular { f64::INFINITY } else { k as f64 };
        let mut lower = |at: usize, x: f64| {
            let share = integral((high - x - 0.5) / reach as f64) - integral((low - x - 0.5) / reach as f64);
            weights[at] = (weights[at] - share).max(0.0);
        };
        for x in from.saturating_sub(reach)..(k + reach).min(n) {
            lower(x, x as f64);
        }
        if circular {
            for x in 0..reach.saturating_sub(from) {
                let beyond = x as f64 - reach.saturating_sub(from) as f64;
                lower((n as f64 + beyond) as usize % n, beyond);
            }
            for x in n..(k + reach).max(n) {
                lower((x - n) % n, x as f64);
            }
        }
    }
    weights
}

/// Weights of both parts of every line, given its variance.
pub(super) fn weights(variance: &[f64]) -> Vec<f64> {
    let one: Vec<f64> = variance.iter().map(|variance| 1.0 / variance.sqrt()).collect();
    one.repeat(2)
}

/// The signals of a stretch, by their numbers.
pub(super) type Signals = Vec<(usize, Vec<f64>)>;

/// Lines of the columns of a stretch, by the numbers of the columns.
type ColumnLines = BTreeMap<usize, Vec<f64>>;

/// Lines of columns that stay what they are as long as the motion does, in every view of a row, stretch by stretch.
#[derive(Debug, Default)]
pub(super) struct Remembered {
    of_view: Vec<(View, Vec<ColumnLines>)>,
}

impl Remembered {
    /// What is known in a view, which is remembered from now on.
    fn of(&mut self, view: View, stretches: usize) -> &mut [ColumnLines] {
        let at = self.of_view.iter().position(|(own, _)| *own == view).unwrap_or_else(|| {
            self.of_view.push((view, vec![ColumnLines::new(); stretches]));
            self.of_view.len() - 1
        });
        &mut self.of_view[at].1
    }
}

/// Lines of the signals of a row, from all stretches; nothing where all stretches are too short.
pub(super) fn row_lines(paths: &[Path], view: View, signals: &[Signals]) -> Option<RowLines> {
    row_lines_beside(paths, view, signals, (&mut Remembered::default(), 0))
}

/// Lines of the signals of a row, where those of the signals whose numbers are below `first` are remembered.
pub(super) fn row_lines_beside(
    paths: &[Path],
    view: View,
    signals: &[Signals],
    (remembered, first): (&mut Remembered, usize),
) -> Option<RowLines> {
    let remembered = remembered.of(view, paths.len());
    let mut numbers: Vec<usize> = signals.iter().flatten().map(|(number, _)| *number).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let mut parts: Vec<(Vec<f64>, DMatrix<f64>)> = Vec::new();
    let (mut correlation, mut kept, mut weight) = (0.0_f64, 0.0, 0.0);
    for ((path, signals), known) in paths.iter().zip(signals).zip(remembered) {
        let Some(window) = view.window(path) else { continue };
        let n = window.range.len();
        let spacing = 1.0 / (n as f64 * path.apart);
        let lines = (whole::below(view.used / spacing) + 1).min(n / 2).max(2);
        let scale = path.apart.sqrt();
        let shares = view.shares(path);
        let fresh: Vec<&(usize, Vec<f64>)> = signals.iter().filter(|(number, _)| !known.contains_key(number)).collect();
        let transformed: Vec<Vec<f64>> = fresh
            .par_iter()
            .map(|(_, signal)| {
                let passed = View::passed(path, &shares, signal);
                let mut windowed: Vec<f64> =
                    window.weights.iter().zip(&passed[window.range.clone()]).map(|(w, x)| w * x).collect();
                let plan = forward(n);
                let mut bins = plan.make_output_vec();
                plan.process(&mut windowed, &mut bins).expect("invariant: buffers were made for this transform");
                let real = bins[..lines].iter().map(|bin| scale * bin.re);
                real.chain(bins[..lines].iter().map(|bin| scale * bin.im)).collect()
            })
            .collect();
        let mut entries = DMatrix::zeros(2 * lines, numbers.len());
        known.extend(fresh.iter().map(|(number, _)| *number).zip(transformed));
        for (number, _) in signals {
            if let (Ok(at), Some(own)) = (numbers.binary_search(number), known.get(number)) {
                entries.column_mut(at).copy_from_slice(own);
            }
        }
        known.retain(|number, _| *number < first);
        parts.push(((0..lines).map(|k| k as f64 * spacing).collect(), entries));
        correlation = correlation.max(window.correlation);
        kept += window.kept * n as f64 * path.apart;
        weight += n as f64 * path.apart;
    }
    if parts.is_empty() {
        return None;
    }
    let total: usize = parts.iter().map(|(frequency, _)| frequency.len()).sum();
    let mut entries = DMatrix::zeros(2 * total, numbers.len());
    let (mut frequency, mut stretches) = (Vec::with_capacity(total), Vec::new());
    for (own, part) in &parts {
        let (from, lines) = (frequency.len(), own.len());
        entries.view_mut((from, 0), (lines, numbers.len())).copy_from(&part.rows(0, lines));
        entries.view_mut((total + from, 0), (lines, numbers.len())).copy_from(&part.rows(lines, lines));
        frequency.extend(own);
        stretches.push(from..from + lines);
    }
    Some(RowLines {
        columns: numbers,
        band: bands(&frequency),
        power: vec![0.0; total],
        floor: vec![0.0; total],
        entries,
        frequency,
        stretches,
        correlation,
        kept: if weight > 0.0 { kept / weight } else { 0.0 },
    })
}

/// The band of every line.
fn bands(frequency: &[f64]) -> Vec<usize> {
    let mut sorted: Vec<usize> = (0..frequency.len()).collect();
    sorted.sort_by(|&a, &b| frequency[a].total_cmp(&frequency[b]));
    let mut ends = vec![0];
    let mut from = 0;
    while from < sorted.len() {
        let top = frequency[sorted[from]] * BAND_RATIO;
        let by_ratio = sorted[from..].iter().take_while(|&&at| frequency[at] < top).count();
        from = (from + by_ratio.max(BAND_LINES)).min(sorted.len());
        ends.push(from);
    }
    // What is left for the last band is too little: it goes to the one before.
    if let [.., before, last, end] = ends[..]
        && before < last
        && end - last < BAND_LINES
    {
        ends.remove(ends.len() - 2);
    }
    let mut band = vec![0; frequency.len()];
    for (number, pair) in ends.windows(2).enumerate() {
        sorted[pair[0]..pair[1]].iter().for_each(|&at| band[at] = number);
    }
    band
}

#[cfg(test)]
mod tests {
    use super::{bands, rounded, widened};

    #[test]
    fn a_notch_is_nothing_at_its_marks_and_one_far_from_them() {
        for circular in [false, true] {
            let mut marks = vec![false; 100];
            marks[2] = true;
            marks[50] = true;
            let wide = widened(&marks, 8, circular);
            assert_eq!(wide[95], circular);
            assert!(wide[0] && wide[10] && !wide[11] && wide[42] && wide[58]);
            let weights = rounded(&wide, 4, circular);
            assert!(weights[50] < 1e-12 && weights[2] < 1e-12 && weights[75] == 1.0, "{weights:?}");
            let naive = |k: usize| {
                let at = |x: i64| {
                    let n = 100;
                    let x = if circular { (x + n) % n } else { x.clamp(0, n - 1) };
                    f64::from(u8::from(wide[x as usize]))
                };
                let hann = |d: f64| 0.5 * (1.0 + (std::f64::consts::PI * d / 4.0).cos()) / 4.0;
                let fine = 200;
                let mean: f64 = (-4 * fine..4 * fine)
                    .map(|i| {
                        let d = (f64::from(i) + 0.5) / f64::from(fine);
                        at((k as f64 + 0.5 + d).floor() as i64) * hann(d) / f64::from(fine)
                    })
                    .sum();
                1.0 - mean
            };
            for (k, weight) in weights.iter().enumerate() {
                assert!((weight - naive(k)).abs() < 1e-3, "{circular} {k}: {weight} {}", naive(k));
            }
        }
    }

    #[test]
    fn bands_hold_twelve_lines_at_least_and_grow() {
        let frequency: Vec<f64> = (0..200).map(f64::from).collect();
        let band = bands(&frequency);
        let count = |number: usize| band.iter().filter(|own| **own == number).count();
        assert!((0..=*band.last().expect("lines")).all(|number| count(number) >= 12));
        assert!(count(*band.last().expect("lines") - 1) > 20);
    }
}
