//! Bounds on the size of a run, so that a request in a file is checked before memory is allocated for it.

/// The most samples of a run: eighty megabytes for every channel, or nearly three hours at a kilohertz.
pub(crate) const MOST_SAMPLES: f64 = 1e7;

/// The most random points inside the box of parameters at which the stability of a loop is checked.
pub const MOST_POINTS: usize = 100_000;

/// The most steps of the simulated machine between two samples.
pub const MOST_SUB_STEPS: usize = 10_000;

/// Whether a run of `settling` periods and then `measured` seconds, but at least four periods, has at most ten million
/// samples. The frequency is in rad/s, the sample time in s.
pub fn has_few_samples(settling: usize, measured: f64, frequency: f64, sample_time: f64) -> bool {
    let period = 2.0 * std::f64::consts::PI / frequency;
    let measured = (measured / period).ceil().max(4.0);
    (settling as f64 + measured) * (period / sample_time).ceil() <= MOST_SAMPLES
}

#[cfg(test)]
mod tests {
    use super::has_few_samples;

    #[test]
    fn samples_are_counted_before_they_are_made() {
        assert!(has_few_samples(3, 10.0, 6.0, 1e-3));
        assert!(!has_few_samples(3, 1e300, 6.0, 1e-3));
        assert!(!has_few_samples(usize::MAX, 10.0, 6.0, 1e-3));
        assert!(!has_few_samples(3, 10.0, 6.0, 1e-300));
        assert!(!has_few_samples(3, 10.0, 1e-300, 1e-3));
    }
}
