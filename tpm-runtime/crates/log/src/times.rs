//! When readings were taken: at their stamps, or evenly with stamps that come late.
//!
//! Stamps may be those of the machine, of a network that delivers late and in bursts, or of a clock that ticks seldom, and readings may be
//! lost. Of all these the motion knows which is true: it is smooth along the right time. Tried are the stamps themselves, and even times that
//! are counted with steps of several sizes, since the usual step of stamps in bursts is none of the machine.
//!
//! A step that could hold more readings has lost those that do not come soon behind it. With e_i = t_i - i h the time by which a stamp is
//! late, and m the number of readings that the step before i could hold beside its own,
//!
//! ```text
//! lost_i = round((min e_j over j in i .. i+m  -  min e_j over j in i-1-m .. i-1) / h) ,      at least 0, at most m.
//! ```

use crate::resample::{is_held, roughness};
use crate::stamps::{MOST_DRIFT, Stamps};
use crate::table::Table;
use std::ops::Range;

/// Numbers of steps over which a sample time is taken as the median: one where single readings are late or lost, more where they come in
/// bursts.
const SPANS: [usize; 3] = [1, 8, 64];
/// Most readings that are looked at behind a step for those it may have lost.
const MOST_BEHIND: usize = 256;
/// Other times are believed where a motion is so much smoother along them, as a logarithm.
const CLEARLY: f64 = 0.02;

/// How stamps were read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Read {
    /// They lie on even times.
    Even,
    /// They are late: the readings were taken evenly.
    Late,
    /// They are the uneven times of the readings.
    Uneven,
}

/// The times of all readings.
#[derive(Clone, Debug)]
pub(super) struct Times {
    /// The sample time, in the unit of the stamps.
    pub(super) step: f64,
    pub(super) read: Read,
    /// The number of every sample, counted from the beginning of its run with those that are lost.
    pub(super) count: Vec<usize>,
    /// The times in samples, from the beginning of their run.
    pub(super) at: Vec<f64>,
}

impl Times {
    /// The times of the readings in runs in which time goes on.
    pub(super) fn of(table: &Table, runs: &[Range<usize>]) -> Self {
        let stamps = table.stamps();
        let even = Times::counted(stamps, runs, stamps.usual_step()).and_then(|plain| plain.if_even(stamps, runs));
        let none_lost = |even: &Times| runs.iter().all(|run| even.count[run.end - 1] == run.len() - 1);
        if let Some(even) = even.as_ref().filter(|even| none_lost(even)) {
            return even.clone();
        }
        let over = |span: usize| Times::counted(stamps, runs, stamps.usual_over(span));
        let mut late: Vec<Times> = even.into_iter().chain(SPANS.iter().filter_map(|span| over(*span))).collect();
        late.push(Times::indices(stamps, runs));
        let sorted = runs.iter().all(|run| table.time[run.clone()].windows(2).all(|pair| pair[0] < pair[1]));
        let uneven = (sorted && late[0].read != Read::Even).then(|| late[0].at_stamps(stamps, runs));
        let rough = |times: &Times| -> f64 {
            let smooth = table.channels.iter().enumerate();
            let smooth = smooth.filter(|(c, own)| *c < table.rates.len() || !is_held(&own.values));
            let of = |values: &[f64]| -> f64 {
                let own =
                    |run: &Range<usize>| run.len() as f64 * roughness(&times.at[run.clone()], &values[run.clone()]);
                runs.iter().map(own).sum::<f64>() / table.time.len() as f64
            };
            smooth.map(|(_, channel)| of(&channel.values)).sum()
        };
        // Where the motion does not tell, stamps that are nowhere half a step from even times are even, or late.
        let near = late[0].are_near(stamps, runs);
        late.extend(uneven);
        if !near {
            late.rotate_right(1);
        }
        let mut all = late.into_iter().map(|times| (rough(&times), times));
        let first = all.next().unwrap_or_else(|| (0.0, Times::indices(stamps, runs)));
        all.fold(first, |best, other| if other.0 < best.0 - CLEARLY { other } else { best }).1
    }

    /// Samples from the reading before to this one, within a run.
    pub(super) fn apart(&self, sample: usize) -> f64 {
        self.at[sample] - self.at[sample - 1]
    }

    /// The times in a stretch, in samples from its beginning.
    pub(super) fn at_from(&self, stretch: &Range<usize>) -> Vec<f64> {
        self.at[stretch.clone()].iter().map(|at| at - self.at[stretch.start]).collect()
    }

    /// Readings counted with this step; nothing where there is none.
    fn counted(stamps: Stamps<'_>, runs: &[Range<usize>], step: f64) -> Option<Self> {
        if step <= 0.0 {
            return None;
        }
        let mut count = vec![0; stamps.time.len()];
        for run in runs {
            let own = stamps.part(run.start, run.end);
            let coarse = own.is_coarse_grid();
            let late = |i: usize| own.time[i] - own.time[0] - i as f64 * step;
            let least = |range: Range<usize>| range.map(late).fold(f64::INFINITY, f64::min);
            let mut jumps = own.jumps(step).filter(|_| !coarse).peekable();
            let (mut lost, mut from) = (0, 0);
            for i in 0..run.len() {
                if jumps.next_if_eq(&i).is_some() {
                    let room = (((own.time[i] - own.time[i - 1]) / step).round() - 1.0).max(1.0);
                    let reach = (room as usize).min(MOST_BEHIND) + 1;
                    let by = least(i..(i + reach).min(run.len())) - least(from.max(i.saturating_sub(reach))..i);
                    let own_loss = (by / step).round().clamp(0.0, room) as usize;
                    lost += own_loss;
                    from = if own_loss > 0 { i } else { from };
                }
                count[run.start + i] = i + lost;
            }
        }
        Some(Times::from_count(stamps, runs, count))
    }

    /// Readings of which none is lost.
    fn indices(stamps: Stamps<'_>, runs: &[Range<usize>]) -> Self {
        let mut count = vec![0; stamps.time.len()];
        runs.iter().for_each(|run| count[run.clone()].iter_mut().enumerate().for_each(|(i, own)| *own = i));
        Times::from_count(stamps, runs, count)
    }

    /// The step of the even times through all stamps, by least squares.
    fn from_count(stamps: Stamps<'_>, runs: &[Range<usize>], count: Vec<usize>) -> Self {
        let (mut above, mut below) = (0.0, 0.0);
        for run in runs {
            let (t, k) = (&stamps.time[run.clone()], &count[run.clone()]);
            let middle = k.iter().map(|k| *k as f64).sum::<f64>() / k.len() as f64;
            for (t_i, k) in t.iter().zip(k) {
                above += (*k as f64 - middle) * (t_i - t[0]);
                below += (*k as f64 - middle).powi(2);
            }
        }
        let at = count.iter().map(|k| *k as f64).collect();
        Times { step: above / below, read: Read::Late, count, at }
    }

    /// The mean step between the ends of all runs.
    fn mean_step(&self, stamps: Stamps<'_>, runs: &[Range<usize>]) -> f64 {
        let span: f64 = runs.iter().map(|run| stamps.time[run.end - 1] - stamps.time[run.start]).sum();
        span / runs.iter().map(|run| self.count[run.end - 1] as f64).sum::<f64>()
    }

    /// The stamps themselves, in samples.
    fn at_stamps(&self, stamps: Stamps<'_>, runs: &[Range<usize>]) -> Self {
        let step = self.mean_step(stamps, runs);
        let own = |run: &Range<usize>| {
            let first = stamps.time[run.start];
            stamps.time[run.clone()].iter().map(move |t| (t - first) / step)
        };
        Times { step, read: Read::Uneven, count: self.count.clone(), at: runs.iter().flat_map(own).collect() }
    }

    /// These times where the stamps lie on them, but for rounding.
    fn if_even(self, stamps: Stamps<'_>, runs: &[Range<usize>]) -> Option<Self> {
        let step = self.mean_step(stamps, runs);
        let even = |run: &Range<usize>| {
            // Without the time of the readings that are lost.
            let own = |i: usize| stamps.time[i] - (self.count[i] - (i - run.start)) as f64 * step;
            let time: Vec<f64> = run.clone().map(own).collect();
            let apart = |own: f64| (own - step).abs() * (run.len() - 1) as f64;
            let digit = stamps.resolution.at(stamps.time[run.end - 1]);
            let own = Stamps { time: &time, ..stamps }.even_step();
            run.len() < 2 || own.is_ok_and(|own| apart(own) <= MOST_DRIFT * step || apart(own) <= digit)
        };
        runs.iter().all(even).then_some(Times { step, read: Read::Even, ..self })
    }

    /// Whether no stamp lies farther from the even times than stamps may drift.
    fn are_near(&self, stamps: Stamps<'_>, runs: &[Range<usize>]) -> bool {
        runs.iter().all(|run| {
            let off = || {
                stamps.time[run.clone()]
                    .iter()
                    .zip(&self.at[run.clone()])
                    .map(|(t, at)| t - stamps.time[run.start] - at * self.step)
            };
            let mean = off().sum::<f64>() / run.len() as f64;
            off().all(|off| (off - mean).abs() <= MOST_DRIFT * self.step)
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::format::open_columns;
    use crate::names::Signal;
    use crate::{ReadingSettings, Recording};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const ROWS: usize = 4000;

    fn motion(t: f64) -> f64 {
        0.5 * (3.0 * t).sin() + 0.2 * (9.0 * t + 1.0).sin()
    }

    /// Reads rows of stamps and times of readings, of a sensor with noise.
    fn read(rows: impl Iterator<Item = (f64, f64)>) -> Recording {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let row = |(stamp, t): (f64, f64)| {
            let noise = rng.random_range(-1e-5..1e-5);
            format!("{stamp:.6},{:.8},{:.6}\n", motion(t) + noise, (2.0 * t).cos())
        };
        let text = "t_s,x,u\n".to_owned() + &rows.map(row).collect::<String>();
        let signals = ["x", "u"].map(|name| Signal { name: name.into(), unit: None });
        let mut columns = open_columns(text.as_bytes(), "run.csv").expect("text");
        let options = ReadingSettings::default();
        Recording::of_columns(&mut *columns, "run.csv", (&signals[..1], &signals), &[], &options).expect("sound")
    }

    /// One segment that holds the motion, a sample time of so many s.
    fn holds(recording: &Recording, h: f64, far: f64) {
        let [log] = &recording.segments[..] else { panic!("{:?}", recording.report.remarks()) };
        assert!((log.sample_time / h - 1.0).abs() < 1e-4, "{}", log.sample_time);
        let off = (0..log.len()).map(|k| (log.channels[0][k] - motion(k as f64 * h)).abs());
        let largest = off.fold(0.0, f64::max);
        assert!(largest < far, "{largest}: {:?}", recording.report.remarks());
    }

    #[test]
    fn late_stamps_of_even_readings_are_even_times() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut last = -1.0;
        let stamps: Vec<f64> = (0..ROWS)
            .map(|k| {
                let late = if rng.random_bool(0.3) { rng.random_range(0.0..8e-4) } else { 0.0 };
                last = f64::max(last + 1e-4, 1e-3 * k as f64 + if rng.random_bool(0.02) { 1.6e-3 } else { late });
                last
            })
            .collect();
        let recording = read(stamps.into_iter().enumerate().map(|(k, stamp)| (stamp, 1e-3 * k as f64)));
        holds(&recording, 1e-3, 2e-5);
        assert!(recording.report.bridged.is_none() && recording.report.uneven.is_some_and(|uneven| !uneven.resampled));
    }

    #[test]
    fn readings_in_bursts_are_even_times() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut rows, mut k) = (Vec::new(), 0);
        while k < ROWS {
            let burst = rng.random_range(2..9_usize);
            let sent = 2e-3 * (k + burst - 1) as f64;
            rows.extend((0..burst).map(|of| (sent + 2e-5 * of as f64, 2e-3 * (k + of) as f64)));
            k += burst;
        }
        let recording = read(rows.into_iter());
        holds(&recording, 2e-3, 1e-3);
        assert!(recording.report.uneven.is_some_and(|uneven| !uneven.resampled));
    }

    #[test]
    fn a_clock_that_ticks_seldom_is_said() {
        let tick = 0.015_625;
        for h in [1e-3, 4e-3, 1e-2] {
            let t = |k: usize| h * k as f64;
            let recording = read((0..ROWS).map(|k| ((t(k) / tick).floor() * tick, t(k))));
            holds(&recording, recording.segments[0].sample_time, 0.01);
            assert!((recording.segments[0].sample_time / h - 1.0).abs() < 2.0 * tick / (h * ROWS as f64));
            let said = recording.report.remarks().join("; ");
            assert!(said.contains("ticks every 0.015625 s") && said.contains("--sample-time"), "{said}");
        }
    }

    #[test]
    fn lost_packets_are_bridged() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let (mut rows, mut k) = (Vec::new(), 0);
        while k < ROWS {
            let (kept, lost) = (rng.random_range(4..35_usize), rng.random_range(1..6_usize));
            rows.extend((k..k + kept).map(|k| (5e-3 * k as f64, 5e-3 * k as f64)));
            k += kept + lost;
        }
        let recording = read(rows.into_iter());
        holds(&recording, 5e-3, 1e-4);
        let bridged = recording.report.bridged.as_ref().expect("said");
        assert!(bridged.count > 150 && bridged.samples > 400 && (bridged.longest - 0.03).abs() < 1e-6, "{bridged}");
        assert!(bridged.errors.iter().all(|of| of.share < 1e-3), "{bridged}");
        assert!(recording.report.remarks().iter().any(|said| said.contains("readings are missing in")));
    }

    #[test]
    fn a_pause_and_a_jump_of_the_clock_stay_cuts() {
        // Half a period of the motion is a third of a second, of which seven seconds show a quarter.
        for (pause, segments) in [(0.02, 1), (0.06, 1), (0.8, 2), (-1.0, 2)] {
            let t = |k: usize| 2e-3 * k as f64 + if k < ROWS / 3 { 0.0 } else { pause };
            let recording = read((0..ROWS).map(|k| (t(k), t(k))));
            assert_eq!(recording.segments.len(), segments, "{pause}: {:?}", recording.report.remarks());
            assert_eq!(recording.report.bridged.is_some(), segments == 1);
        }
    }

    #[test]
    fn readings_at_uneven_stamps_are_refilled() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut stamps = vec![0.0];
        (1..ROWS).for_each(|k| stamps.push(stamps[k - 1] + rng.random_range(0.008..0.014)));
        let recording = read(stamps.iter().map(|t| (*t, *t)));
        let h = recording.segments[0].sample_time;
        holds(&recording, h, 1.5e-4);
        assert!(recording.report.uneven.is_some_and(|uneven| uneven.resampled));
    }
}
