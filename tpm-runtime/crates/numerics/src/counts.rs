//! Readings that are counts: the grid on which they lie.

/// Tolerance on a grid: largest distance of a difference of two values from a whole number of steps, as a share of a
/// step.
const MOST_OFF_GRID: f64 = 1e-3;
/// Differences of fewer steps than this are counted before the step is known better than its rounding.
const FEW_STEPS: f64 = 5.0;
/// The same of values that a file rounds once more: it gives a step with two digits or more.
const MOST_ROUNDED: f64 = 0.05;

/// The step of the grid on which all values lie, provided that there are more values than grid points between the extremes; zero otherwise.
pub fn step(values: &[f64]) -> f64 {
    counted(values, grid(values))
}

/// The step of a grid, provided that there are more values than points of it between their extremes; zero otherwise.
pub fn counted(values: &[f64], grid: f64) -> f64 {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    if grid > 0.0 && (high - low) / grid < values.len() as f64 { grid } else { 0.0 }
}

/// The step of the grid on which all values lie, however fine it is; zero where they lie on none. Values that lie on no grid fit to one by
/// chance only where there are a few of them.
pub fn grid(values: &[f64]) -> f64 {
    let apart = || values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|difference| *difference > 0.0);
    let least = apart().fold(f64::INFINITY, f64::min);
    if !least.is_finite() {
        return 0.0;
    }
    let off = |difference: f64, step: f64| (difference / step - (difference / step).round()).abs();
    if apart().all(|difference| off(difference, least) < MOST_OFF_GRID) {
        return least;
    }
    // Counts that were converted to another unit are rounded once more by the digits of the file. The mean of many small differences has
    // lost that rounding, and is the step to which the large ones are held.
    let (mut sum, mut steps) = (0.0, 0.0);
    for difference in apart().filter(|difference| *difference < FEW_STEPS * least) {
        if off(difference, least) > 2.0 * MOST_ROUNDED {
            return 0.0;
        }
        sum += difference;
        steps += (difference / least).round();
    }
    let step = sum / steps;
    if apart().all(|difference| off(difference, step) < MOST_ROUNDED) { step } else { 0.0 }
}
