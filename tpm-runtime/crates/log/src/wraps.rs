//! Readings that wrap around: an angle in [-pi, pi), a counter that rolls over.
//!
//! A reading with a range R shows y_k = x_k - n_k R with whole n_k. All of it lies within R, and where n_k changes it jumps by nearly the
//! whole range: |y_{k+1} - y_k| = R - |x_{k+1} - x_k|. The hypothesis of a range is kept if
//!
//! ```text
//! max y - min y <= R + q ,      |d_k| < R / 4 or | |d_k| - R | < R / 4 for all k ,      d_k = y_{k+1} - y_k ,
//! ```
//!
//! at least one jump is of the second kind, and each of these leaves a change that is like the changes beside it. The reading is then
//! followed over its wraps. A motion so fast that it moves by a quarter of the range in a sample cannot be told from a wrap, and is left.

use crate::error::LogError;
use crate::names::Signal;
use crate::report::Wrapped;

/// Largest change of an unwrapped reading over a sample, as a share of the range.
const MOST_CHANGE: f64 = 0.25;
/// Largest change that a wrap leaves, in multiples of the largest change over the samples beside it.
const MOST_BESIDE: f64 = 3.0;
/// Changes in the samples on each side that a change is compared with.
const BESIDE: usize = 4;
/// Share of a range that readings fill where an angle wraps often.
const FILLED: f64 = 0.95;
/// Fewest jumps by more than half of the range of a reading that wraps often.
const LEAST_JUMPS: usize = 5;
/// Fewest and most bits of a counter.
const COUNTER_BITS: std::ops::RangeInclusive<i32> = 8..=32;

/// The ranges that an angle of a unit wraps at; none for other units.
fn ranges_of(unit: &str) -> &'static [f64] {
    match unit {
        "rad" => &[std::f64::consts::TAU],
        "deg" => &[360.0],
        "rev" | "turn" => &[1.0],
        _ => &[],
    }
}

/// The least change between readings that are multiples of it; nothing for readings that are not rounded.
fn least_step(signal: &[f64]) -> Option<f64> {
    let changes = || signal.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|change| *change > 0.0);
    let least = changes().fold(f64::INFINITY, f64::min);
    let whole = |change: f64| (change / least - (change / least).round()).abs() < 1e-6 * (change / least).max(1.0);
    (least.is_finite() && changes().all(whole)).then_some(least)
}

/// The samples before which a reading of this range wraps; nothing where it does not wrap at this range, or may move as far.
fn at_range(signal: &[f64], range: f64, step: f64) -> Option<Vec<usize>> {
    let (low, high) = signal.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(*y), h.max(*y)));
    if high - low > range * (1.0 + 1e-6) + step {
        return None;
    }
    let near = |change: f64| change - range * (change / range).round();
    let change = |k: usize| signal[k] - signal[k - 1];
    let mut wraps = Vec::new();
    for k in 1..signal.len() {
        if near(change(k)).abs() >= MOST_CHANGE * range {
            return None;
        }
        if change(k).abs() > 0.5 * range {
            wraps.push(k);
        }
    }
    let like_its_neighbours = |&k: &usize| {
        let beside = (k.saturating_sub(BESIDE).max(1)..(k + BESIDE + 1).min(signal.len())).filter(|other| *other != k);
        let most = beside.map(|other| near(change(other)).abs()).fold(0.0, f64::max);
        near(change(k)).abs() <= MOST_BESIDE * most + 2.0 * step
    };
    (!wraps.is_empty() && wraps.iter().all(like_its_neighbours)).then_some(wraps)
}

/// The range at which a reading of a unit wraps around, with the samples before which it does; nothing where it does not.
fn wraps(signal: &[f64], unit: Option<&str>) -> Option<(f64, Vec<usize>)> {
    let step = least_step(signal);
    let of_unit = unit.map(ranges_of).unwrap_or_default().iter().copied();
    // A counter has no unit, or one that says nothing of its range.
    let of_counter = step.filter(|_| unit.is_none()).into_iter();
    let of_counter = of_counter.flat_map(|step| COUNTER_BITS.map(move |bits| step * 2.0_f64.powi(bits)));
    let mut ranges = of_unit.chain(of_counter);
    ranges.find_map(|range| at_range(signal, range, step.unwrap_or(0.0)).map(|wraps| (range, wraps)))
}

/// The range of an angle's unit that its readings fill, with a sample before which they jump by more than half of it, where some change by so
/// much, less whole ranges, that a wrap is not told from motion. Motion over less than a range that fills it by chance does not jump so.
fn untold(signal: &[f64], unit: Option<&str>) -> Option<(f64, usize)> {
    let (low, high) = signal.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(*y), h.max(*y)));
    let fills = |range: f64| high - low <= range * (1.0 + 1e-6) && high - low >= FILLED * range;
    let range = unit.map(ranges_of).unwrap_or_default().iter().copied().find(|range| fills(*range))?;
    let near = |k: usize| {
        let change = signal[k] - signal[k - 1];
        (change - range * (change / range).round()).abs()
    };
    let jumps: Vec<usize> =
        (1..signal.len()).filter(|&k| (signal[k] - signal[k - 1]).abs() > 0.5 * range).take(LEAST_JUMPS).collect();
    let far = (1..signal.len()).find(|&k| near(k) >= MOST_CHANGE * range)?;
    (jumps.len() == LEAST_JUMPS).then_some((range, far))
}

/// Follows the readings of a signal over their wraps, and says so; nothing where they do not wrap. `lines` are those of the file, which messages
/// call `path`.
///
/// # Errors
/// [`LogError::WrapUntold`] where wraps are not told from motion.
pub(super) fn followed(
    path: &str,
    signal: &Signal,
    readings: &mut [f64],
    lines: &[u64],
) -> Result<Option<Wrapped>, LogError> {
    let unit = signal.unit.as_deref();
    if let Some((range, places)) = wraps(readings, unit) {
        unwrap(readings, range, &places);
        let line = lines[places[0]];
        return Ok(Some(Wrapped { signal: signal.name.clone(), range, count: places.len(), line }));
    }
    let Some((range, k)) = untold(readings, unit) else { return Ok(None) };
    let change = readings[k] - readings[k - 1];
    let change = (change - range * (change / range).round()).abs();
    Err(LogError::WrapUntold { path: path.into(), line: lines[k], signal: signal.name.clone(), range, change })
}

/// Follows a reading over its wraps.
fn unwrap(signal: &mut [f64], range: f64, wraps: &[usize]) {
    let mut turns = 0.0;
    let mut next = wraps.iter().copied().peekable();
    let mut before = signal.first().copied().unwrap_or(0.0);
    for (k, y) in signal.iter_mut().enumerate() {
        let own = *y;
        if next.next_if_eq(&k).is_some() {
            turns -= ((own - before) / range).round();
        }
        before = own;
        *y = own + turns * range;
    }
}

#[cfg(test)]
mod tests {
    use super::{untold, unwrap, wraps};
    use std::f64::consts::{PI, TAU};

    fn motion(k: usize) -> f64 {
        let t = 0.01 * k as f64;
        9.0 * (0.7 * t).sin() + 0.4 * t
    }

    #[test]
    fn angles_and_counters_are_followed_over_their_wraps() {
        let wrap = |x: f64, from: f64, range: f64| x - ((x - from) / range).floor() * range;
        let counts = |x: f64| (x / TAU * 4096.0).round();
        type Reading<'a> = &'a dyn Fn(f64) -> f64;
        let readings: [(Option<&str>, Reading<'_>, Reading<'_>, f64); 5] = [
            (Some("rad"), &|x| x, &|x| wrap(x, -PI, TAU), TAU),
            (Some("rad"), &|x| counts(x) * TAU / 4096.0, &|x| wrap(counts(x), 0.0, 4096.0) * TAU / 4096.0, TAU),
            (Some("deg"), &|x| x.to_degrees(), &|x| wrap(x.to_degrees(), 0.0, 360.0), 360.0),
            (Some("rev"), &|x| x / TAU, &|x| wrap(x / TAU, 0.0, 1.0), 1.0),
            (None, &|x| counts(x), &|x| wrap(counts(x), 0.0, 4096.0), 4096.0),
        ];
        for (at, (unit, whole, wrapped, range)) in readings.iter().enumerate() {
            let mut signal: Vec<f64> = (0..4_000).map(|k| wrapped(motion(k))).collect();
            let (found, places) = wraps(&signal, *unit).unwrap_or_else(|| panic!("reading {at}"));
            assert!((found / range - 1.0).abs() < 1e-9 && places.len() > 10, "reading {at}: {found}, {}", places.len());
            unwrap(&mut signal, found, &places);
            let offset = signal[0] - whole(motion(0));
            for (k, y) in signal.iter().enumerate() {
                assert!((y - offset - whole(motion(k))).abs() < 1e-6 * range, "reading {at}, sample {k}: {y}");
            }
        }
    }

    #[test]
    fn motions_joins_and_fast_turns_are_no_wraps() {
        let all = |f: &dyn Fn(usize) -> f64| -> Vec<f64> { (0..2_000).map(f).collect() };
        // A motion over several turns, another recording that begins nearly a turn away, steps of a valve of unknown unit, a turn so
        // fast that it moves by a third of the range in a sample.
        assert_eq!(wraps(&all(&motion), Some("rad")), None);
        let joined =
            all(&|k| if k < 1_000 { 0.1 * (0.01 * k as f64).sin() } else { 5.9 + 0.1 * (0.01 * k as f64).cos() });
        assert_eq!(wraps(&joined, Some("rad")), None);
        assert_eq!(wraps(&all(&|k| if k % 200 < 100 { 0.0 } else { 6.0 }), Some("m")), None);
        assert_eq!(wraps(&all(&|k| (2.1 * k as f64).rem_euclid(TAU)), Some("rad")), None);
        // The last of them is one that cannot be told; the others are motions.
        let turning = all(&|k| (2.1 * k as f64).rem_euclid(TAU));
        assert!(matches!(untold(&turning, Some("rad")), Some((range, _)) if range == TAU));
        assert_eq!(untold(&all(&motion), Some("rad")), None);
        assert_eq!(untold(&joined, Some("rad")), None);
        assert_eq!(untold(&all(&|k| (PI * (1.0 - 1e-3)) * (0.9 * k as f64).sin()), Some("m")), None);
        assert_eq!(wraps(&[], Some("rad")), None);
        assert_eq!(wraps(&[1.0; 20], Some("rad")), None);
    }
}
