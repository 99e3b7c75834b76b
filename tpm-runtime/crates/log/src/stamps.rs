//! Time stamps: the digits to which they are printed, and whether they lie on an even grid.

use std::collections::BTreeMap;

/// Largest deviation of a time step from the sample time, as a share of the sample time.
pub(super) const MOST_JITTER: f64 = 0.01;
/// Largest deviation of a time stamp from the even grid, as a share of the sample time.
pub(super) const MOST_DRIFT: f64 = 0.5;
/// A step longer than this multiple of the usual one is a gap.
pub(super) const LEAST_GAP: f64 = 1.5;
/// Fewest steps that differ from the usual one for stamps to count as rounded so coarsely that their steps alternate.
const LEAST_ALTERNATING: usize = 8;
/// Most steps whose median is the usual step; of more steps, equally spaced ones are used.
const MOST_MEDIAN_STEPS: usize = 1 << 20;

/// Value of one unit in the last digit to which stamps are printed, by the power of ten below the stamp.
///
/// Stamps may be printed without trailing zeros, or with a fixed number of significant digits. The finest digit among
/// the stamps of one power of ten is therefore the digit to which these are rounded.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Resolution {
    digits: BTreeMap<i32, f64>,
    /// Range of the magnitudes that have the current power of ten.
    range: (f64, f64),
    decade: i32,
    finest: f64,
}

impl Resolution {
    /// Takes in the last digit of a stamp.
    pub(super) fn take(&mut self, stamp: f64, last_digit: f64) {
        let size = stamp.abs();
        if !(self.range.0 <= size && size < self.range.1) {
            self.decade = decade(stamp);
            self.range = if size > 0.0 {
                (10.0_f64.powi(self.decade), 10.0_f64.powi(self.decade + 1))
            } else {
                (0.0, f64::MIN_POSITIVE)
            };
            self.finest = self.digits.get(&self.decade).copied().unwrap_or(f64::INFINITY);
        }
        if last_digit < self.finest {
            self.finest = last_digit;
            self.digits.insert(self.decade, last_digit);
        }
    }

    /// Value of one unit in the last digit of a stamp; zero where stamps are not rounded to a digit.
    pub(super) fn at(&self, stamp: f64) -> f64 {
        if self.digits.is_empty() { 0.0 } else { self.digits.get(&decade(stamp)).copied().unwrap_or(0.0) }
    }
}

/// The power of ten below a number; the least one for zero.
fn decade(value: f64) -> i32 {
    if value.abs() > 0.0 { value.abs().log10().floor() as i32 } else { i32::MIN }
}

/// Value of one unit in the last printed digit of a decimal number.
pub(super) fn last_digit(text: &[u8], decimal: u8) -> f64 {
    let (mut decimals, mut fraction) = (0, false);
    for (at, &byte) in text.iter().enumerate() {
        if byte == decimal {
            fraction = true;
        } else if byte == b'e' || byte == b'E' {
            let exponent = std::str::from_utf8(&text[at + 1..]).ok().and_then(|text| text.trim().parse::<i32>().ok());
            return 10.0_f64.powi(exponent.unwrap_or(0) - decimals);
        } else if fraction && byte.is_ascii_digit() {
            decimals += 1;
        }
    }
    const TENTHS: [f64; 13] = [1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12];
    TENTHS.get(decimals as usize).copied().unwrap_or_else(|| 10.0_f64.powi(-decimals))
}

/// Time stamps with the digits to which they were printed, in the unit of the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stamps<'a> {
    pub(super) time: &'a [f64],
    pub(super) resolution: &'a Resolution,
}

/// A deviation of time stamps from an even grid, in the unit of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Uneven {
    /// The step to a sample is not the usual one.
    Step {
        /// The sample.
        sample: usize,
        /// Step from the sample before.
        step: f64,
        /// The usual step.
        expected: f64,
    },
    /// The stamp of a sample lies apart from the grid through the first and the last stamp.
    Drift {
        /// The sample.
        sample: usize,
        /// Deviation from the grid.
        deviation: f64,
        /// Step of the grid.
        expected: f64,
    },
}

impl<'a> Stamps<'a> {
    /// Stamps of a stretch.
    pub(super) fn part(self, from: usize, to: usize) -> Stamps<'a> {
        Stamps { time: &self.time[from..to], resolution: self.resolution }
    }

    /// Median of the steps; zero for less than two stamps.
    pub(super) fn usual_step(&self) -> f64 {
        self.usual_over(1)
    }

    /// Median of the mean steps over so many; zero for fewer.
    pub(super) fn usual_over(&self, span: usize) -> f64 {
        let stride = (self.time.len() / MOST_MEDIAN_STEPS).max(1);
        let mean = |all: &[f64]| (all[span] - all[0]) / span as f64;
        let mut steps: Vec<f64> = self.time.windows(span + 1).step_by(stride).map(mean).collect();
        if steps.is_empty() {
            return 0.0;
        }
        let middle = steps.len() / 2;
        let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
        *median
    }

    /// Median of the steps by which time goes on.
    pub(super) fn usual_tick(&self) -> f64 {
        let mut own = self.time.to_vec();
        own.dedup();
        Stamps { time: &own, ..*self }.usual_step()
    }

    /// By how much a step may differ from the usual one because its two stamps are rounded.
    fn rounding(&self, sample: usize, usual: f64) -> f64 {
        let [before, after] = [self.time[sample - 1], self.time[sample]];
        self.resolution.at(before).max(self.resolution.at(after)).min(0.5 * usual.abs())
    }

    /// The samples before which time jumps ahead by more than steps of this size do.
    pub(super) fn jumps(self, usual: f64) -> impl Iterator<Item = usize> + 'a {
        (1..self.time.len()).filter(move |&sample| {
            let step = self.time[sample] - self.time[sample - 1];
            step > LEAST_GAP * usual && step - usual > 1.01 * self.rounding(sample, usual)
        })
    }

    /// Stamps that repeat the one before where the next one comes later by as many usual steps as there are rows up to it: the clock was not
    /// read again when these rows were written. With each of them the time at which it lies evenly between its neighbours.
    pub(super) fn stale(&self) -> Vec<(usize, f64)> {
        let usual = self.usual_step();
        if usual <= 0.0 || self.is_coarse_grid() {
            return Vec::new();
        }
        let mut found = Vec::new();
        let mut from = 0;
        while from < self.time.len() {
            let first = self.time[from];
            let rows = self.time[from..].iter().take_while(|stamp| **stamp == first).count();
            let next = from + rows;
            if let Some(&end) = self.time.get(next).filter(|_| rows > 1) {
                let even = rows as f64 * usual;
                if (end - first - even).abs() <= (LEAST_GAP - 1.0) * usual {
                    found.extend((1..rows).map(|k| (from + k, first + (end - first) * k as f64 / rows as f64)));
                }
            }
            from = next;
        }
        found
    }

    /// Whether stamps are printed so coarsely that their steps alternate, yet every stamp lies within its last digit of
    /// an even grid. A few unusual steps are not enough, since samples may be missing there.
    pub(super) fn is_coarse_grid(&self) -> bool {
        let (Some(first), Some(last)) = (self.time.first(), self.time.last()) else { return false };
        let step = (last - first) / (self.time.len() - 1).max(1) as f64;
        let digit = self.resolution.at(*last);
        let coarse = digit > 0.5 * step && digit < 8.0 * step;
        if !coarse {
            return false;
        }
        let usual = self.usual_step();
        let odd = self.time.windows(2).filter(|pair| (pair[1] - pair[0] - usual).abs() > 0.5 * digit).count();
        let near = |(i, t): (usize, &f64)| (t - first - i as f64 * step).abs() <= 1.01 * digit;
        odd >= LEAST_ALTERNATING && self.time.is_sorted() && self.time.iter().enumerate().all(near)
    }

    /// The sample time of an even grid. A stamp that is printed with few digits may be off by one in its last digit.
    ///
    /// # Errors
    /// [`Uneven`] at the first stamp that does not lie on an even grid.
    pub(super) fn even_step(&self) -> Result<f64, Uneven> {
        let (first, last) = (self.time[0], self.time[self.time.len() - 1]);
        let step = (last - first) / (self.time.len() - 1) as f64;
        if self.is_coarse_grid() {
            return Ok(step);
        }
        let usual = self.usual_step();
        for sample in 1..self.time.len() {
            let step = self.time[sample] - self.time[sample - 1];
            let off = (step - usual).abs();
            if step <= 0.0 || off > MOST_JITTER * usual.abs() && off > 1.01 * self.rounding(sample, usual) {
                return Err(Uneven::Step { sample, step, expected: usual });
            }
        }
        for (sample, t) in self.time.iter().enumerate() {
            let deviation = t - first - sample as f64 * step;
            if deviation.abs() > MOST_DRIFT * step && deviation.abs() > self.resolution.at(*t) {
                return Err(Uneven::Drift { sample, deviation, expected: step });
            }
        }
        Ok(step)
    }
}

#[cfg(test)]
mod tests {
    use super::{Resolution, Stamps, last_digit};

    #[test]
    fn the_last_digit_of_a_number_is_read() {
        for (text, digit) in [("12.340", 1e-3), ("7", 1.0), ("1.5e-3", 1e-4), ("-0.25", 1e-2), ("1E3", 1e3)] {
            assert!((last_digit(text.as_bytes(), b'.') / digit - 1.0).abs() < 1e-12, "{text}");
        }
        assert!((last_digit(b"0,25", b',') - 0.01).abs() < 1e-15);
    }

    #[test]
    fn stamps_that_were_not_read_again_lie_between_their_neighbours() {
        let resolution = Resolution::default();
        let mut time: Vec<f64> = (0..100).map(|i| 20.0 * f64::from(i)).collect();
        (9..90).step_by(9).for_each(|k| time[k] = time[k - 1]);
        let found = Stamps { time: &time, resolution: &resolution }.stale();
        assert_eq!(found, (9..90).step_by(9).map(|k| (k, 20.0 * k as f64)).collect::<Vec<_>>());
        // A row that was written twice has no time of its own, and neither has one at the end.
        let mut twice: Vec<f64> = (0..100).map(|i| 20.0 * f64::from(i)).collect();
        twice.insert(50, twice[49]);
        twice.push(twice[100]);
        assert_eq!(Stamps { time: &twice, resolution: &resolution }.stale(), []);
    }

    #[test]
    fn stamps_coarser_than_the_step_lie_on_a_grid() {
        let mut resolution = Resolution::default();
        let time: Vec<f64> = (0..900).map(|i| (1.2 * f64::from(i)).floor()).collect();
        time.iter().for_each(|t| resolution.take(*t, 1.0));
        assert!(Stamps { time: &time, resolution: &resolution }.is_coarse_grid());
        let late: Vec<f64> = time.iter().map(|t| if *t > 500.0 { t + 5.0 } else { *t }).collect();
        assert!(!Stamps { time: &late, resolution: &resolution }.is_coarse_grid());
    }
}
