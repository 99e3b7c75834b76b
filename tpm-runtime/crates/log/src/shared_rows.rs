//! Rows for channels that were recorded at times of their own: topics at their own rates, and exports in which a line holds what changed.
//!
//! The rows are those of the coordinate that was read least often, so that no reading of a coordinate counts twice; without coordinates
//! those of the channel that was read most often. What stays between its stamps, such as a command, has its last reading
//! there; what moves smoothly lies on the cubic through its readings around. Which of both a channel is, its readings say: of smooth
//! ones a cubic through the neighbours predicts more than the reading before does. Coordinates and rates are smooth.
//!
//! Invariant: no row lies where a smooth channel was not read for longer than its usual step, or where a channel was not read yet.

use crate::resample::residuals;
use crate::stamps::{LEAST_GAP, Resolution, Stamps};
use tpm_numerics::{root_mean_square, through};

/// Fewest readings of a coordinate.
const FEWEST_READINGS: usize = 16;
/// Fewest readings that show whether a channel is smooth.
const FEWEST_JUDGED: usize = 6;

/// Largest distance of a smooth channel's readings from the cubic, as a share of the steps between them; of a step it is three quarters.
const MOST_MISSED: f64 = 0.5;

/// The readings of a channel that are there: their rows, stamps and values.
struct Own {
    time: Vec<f64>,
    values: Vec<f64>,
    /// The usual step; nothing of a channel that is held.
    step: Option<f64>,
}

impl Own {
    fn of(time: &[f64], channel: &[f64], is_smooth: bool) -> Self {
        let there = time.iter().zip(channel).filter(|(_, value)| value.is_finite());
        let (time, values): (Vec<f64>, Vec<f64>) = there.unzip();
        let smooth = is_smooth || predicts(&time, &values);
        let step = smooth.then(|| Stamps { time: &time, resolution: &Resolution::default() }.usual_step());
        Own { time, values, step }
    }

    /// The value at a time; `next` is the place of the first reading behind it. Nothing where none is known.
    fn at(&self, time: f64, next: usize) -> Option<f64> {
        let before = next.checked_sub(1)?;
        let Some(step) = self.step else { return Some(self.values[before]) };
        if self.time[before] == time {
            return Some(self.values[before]);
        }
        let behind = *self.time.get(next)?;
        if behind - self.time[before] > LEAST_GAP * step {
            return None;
        }
        let first = before.saturating_sub(1).min(self.time.len().checked_sub(4)?);
        let nodes = [first, first + 1, first + 2, first + 3];
        let value = through(nodes.map(|n| self.time[n] - time), nodes.map(|n| self.values[n]), 0.0);
        // Two readings with one stamp have no cubic.
        value.is_finite().then_some(value)
    }
}

/// Whether the cubic through the neighbours of a reading is much nearer to it than the reading before. Of steps and of noise it is not.
fn predicts(time: &[f64], values: &[f64]) -> bool {
    let steps = root_mean_square(values.windows(2).map(|pair| pair[1] - pair[0]));
    let misses = || residuals(|i| time[i], values, 1, 2);
    values.len() >= FEWEST_JUDGED && root_mean_square(misses()) < MOST_MISSED * steps
}

/// Rows that channels share.
pub(super) struct SharedRows {
    /// The channel whose rows they are.
    pub(super) reference: usize,
    /// Rows of the file that are kept, in order.
    pub(super) rows: Vec<usize>,
    /// The channels, then the rates, at these rows; a rate may hold NaN.
    pub(super) values: Vec<Vec<f64>>,
    /// Channels that are held between their readings.
    pub(super) held: Vec<usize>,
}

impl SharedRows {
    /// The rows of channels, NaN where one has no reading, of which the first are coordinates; `rates` are theirs. Nothing where most
    /// rows are whole, or one channel has too few readings, or time does not advance: such a record has holes.
    pub(super) fn of(
        time: &[f64],
        channels: &[impl AsRef<[f64]>],
        coordinates: usize,
        rates: &[impl AsRef<[f64]>],
    ) -> Option<Self> {
        let channels: Vec<&[f64]> = channels.iter().map(AsRef::as_ref).collect();
        let whole = (0..time.len()).filter(|row| channels.iter().all(|channel| channel[*row].is_finite())).count();
        if channels.len() < 2 || 2 * whole >= time.len() || !time.is_sorted() {
            return None;
        }
        let count = |channel: &&[f64]| channel.iter().filter(|value| value.is_finite()).count();
        let counts: Vec<usize> = channels.iter().map(count).collect();
        // A command that changes seldom was written seldom; a motion of so few readings shows nothing.
        let read = |(c, count): (usize, &usize)| *count >= if c < coordinates { FEWEST_READINGS } else { 1 };
        if !counts.iter().enumerate().all(read) {
            return None;
        }
        let reference = if coordinates > 0 {
            (0..coordinates).min_by_key(|c| counts[*c])?
        } else {
            (0..channels.len()).rev().max_by_key(|c| counts[*c])?
        };
        let all = channels.iter().copied().chain(rates.iter().map(AsRef::as_ref)).enumerate();
        let own: Vec<Own> =
            all.map(|(c, values)| Own::of(time, values, c < coordinates || c >= channels.len())).collect();
        let mut shared = SharedRows {
            reference,
            rows: Vec::new(),
            values: vec![Vec::new(); own.len()],
            held: (0..channels.len()).filter(|c| *c != reference && own[*c].step.is_none()).collect(),
        };
        let mut next = vec![0; own.len()];
        let mut at = vec![None; own.len()];
        for row in (0..time.len()).filter(|row| channels[reference][*row].is_finite()) {
            for ((own, next), value) in own.iter().zip(&mut next).zip(&mut at) {
                *value = own.at(time[row], advanced(own, next, time[row]));
            }
            at[reference] = Some(channels[reference][row]);
            if at[..channels.len()].iter().all(Option::is_some) {
                shared.rows.push(row);
                shared.values.iter_mut().zip(&at).for_each(|(values, value)| values.push(value.unwrap_or(f64::NAN)));
            }
        }
        Some(shared)
    }
}

/// The place of a channel's first reading behind a time, which does not go back.
fn advanced(own: &Own, next: &mut usize, time: f64) -> usize {
    while own.time.get(*next).is_some_and(|stamp| *stamp <= time) {
        *next += 1;
    }
    *next
}

#[cfg(test)]
mod tests {
    use super::SharedRows;

    /// Rows of readings at their stamps, by channel.
    fn rows(channels: &[Vec<(f64, f64)>]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut time: Vec<f64> = channels.iter().flatten().map(|(stamp, _)| *stamp).collect();
        time.sort_by(f64::total_cmp);
        time.dedup();
        let at =
            |channel: &Vec<(f64, f64)>, t: f64| channel.iter().find(|(own, _)| *own == t).map_or(f64::NAN, |of| of.1);
        let columns = channels.iter().map(|channel| time.iter().map(|t| at(channel, *t)).collect()).collect();
        (time, columns)
    }

    fn shared(time: &[f64], channels: &[Vec<f64>], coordinates: usize) -> Option<SharedRows> {
        SharedRows::of(time, channels, coordinates, &[] as &[Vec<f64>])
    }

    #[test]
    fn a_command_is_held_and_a_motion_is_interpolated() {
        let wave = |t: f64| (3.0 * t).sin();
        let level = |t: f64| [2.0, -1.0, 3.0, 0.0, 4.0, -2.0][(2.0 * t) as usize];
        // A coordinate every 10 ms, another every 20 ms in between, and a command that is written when it changes.
        let first: Vec<(f64, f64)> = (0..300).map(|k| f64::from(k) * 0.01).map(|t| (t, wave(t))).collect();
        let second: Vec<(f64, f64)> =
            (0..150).map(|k| f64::from(k) * 0.02 + 0.003).map(|t| (t, wave(t + 1.0))).collect();
        let command: Vec<(f64, f64)> = (0..6).map(|k| f64::from(k) * 0.5 + 0.001).map(|t| (t, level(t))).collect();
        let (time, channels) = rows(&[first, second, command]);
        let shared = shared(&time, &channels, 2).expect("times of their own");
        assert_eq!((shared.reference, &shared.held[..]), (1, &[2][..]));
        assert_eq!(shared.rows.len(), 150);
        for (k, row) in shared.rows.iter().enumerate() {
            let t = time[*row];
            assert!((shared.values[0][k] - wave(t)).abs() < 1e-6, "{t}");
            assert_eq!(shared.values[1][k], wave(t + 1.0));
            assert_eq!(shared.values[2][k], level(t - 0.001), "{t}");
        }
    }

    #[test]
    fn nothing_is_filled_in_where_a_motion_was_not_read() {
        let stamps = |offset: f64| (0..100).map(move |k| f64::from(k) * 0.01 + offset);
        let lost = |t: &f64| !(0.4..0.6).contains(t);
        let first: Vec<(f64, f64)> = stamps(0.0).filter(lost).map(|t| (t, t.sin())).collect();
        let second: Vec<(f64, f64)> = stamps(0.004).step_by(2).map(|t| (t, t.cos())).collect();
        let (time, channels) = rows(&[first, second]);
        let shared = shared(&time, &channels, 2).expect("times of their own");
        let inside = shared.rows.iter().filter(|row| (0.4..0.6).contains(&time[**row])).count();
        assert_eq!((shared.reference, inside), (1, 0));
        assert!((36..42).contains(&shared.rows.len()), "{}", shared.rows.len());
    }

    #[test]
    fn whole_rows_with_holes_are_left_alone() {
        let time: Vec<f64> = (0..100).map(f64::from).collect();
        let mut channels = vec![time.clone(), time.clone()];
        channels[1].iter_mut().step_by(3).for_each(|value| *value = f64::NAN);
        assert!(shared(&time, &channels, 1).is_none());
        // Too few readings of a coordinate.
        channels[0].iter_mut().skip(10).for_each(|value| *value = f64::NAN);
        assert!(shared(&time, &channels, 1).is_none());
    }
}
