//! The motions among which an excitation is sought.
//!
//! Invariant: coordinate c moves as `centre_c + reach_c (x_0 + sum over k = 2 ... K of x_k (cos k p - k^2 cos p) / k^2 + y_k (sin k p -
//! k sin p) / k)` with the phase p = w t, so that every x and y gives a motion that starts, and ends each period, without velocity and
//! acceleration. A point lists the numbers x_0, x_2, y_2, ..., x_K, y_K of one coordinate after the other.

use std::f64::consts::PI;
use tpm_motion::trajectory::{HarmonicSeries, Line, Trajectory};

/// A family of motions from rest to rest, and its samples over one period.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) coordinates: usize,
    /// Highest harmonic K.
    pub(super) harmonics: u32,
    /// Fundamental frequency, rad/s.
    pub(super) frequency: f64,
    /// Centre and reach of every coordinate.
    centres: Vec<(f64, f64)>,
    /// Value and derivatives of the functions that a coordinate's numbers multiply: by sample, order and number.
    basis: Vec<f64>,
    pub(super) samples: usize,
    orders: usize,
}

impl Series {
    /// A family with harmonics up to `harmonics`, at least 2; motions have `orders` derivatives, the position among them.
    pub(super) fn new(centres: Vec<(f64, f64)>, harmonics: u32, frequency: f64, samples: usize, orders: usize) -> Self {
        let functions = functions(harmonics);
        let mut basis = Vec::with_capacity(samples * orders * functions.len());
        for n in 0..samples {
            let phase = 2.0 * PI * n as f64 / samples as f64;
            for order in 0..orders {
                basis.extend(functions.iter().map(|function| function.derivative(phase, frequency, order)));
            }
        }
        Self { coordinates: centres.len(), harmonics, frequency, centres, basis, samples, orders }
    }

    /// How many numbers a coordinate has.
    pub(super) fn width(&self) -> usize {
        2 * self.harmonics as usize - 1
    }

    /// Length of a point.
    pub(super) fn len(&self) -> usize {
        self.coordinates * self.width()
    }

    /// Centre and reach of every coordinate.
    pub(super) fn centres(&self) -> &[(f64, f64)] {
        &self.centres
    }

    /// The series of one coordinate's numbers.
    pub(super) fn of_coordinate(&self, coordinate: usize, numbers: &[f64]) -> HarmonicSeries {
        let (centre, reach) = self.centres[coordinate];
        let mut first = Line { harmonic: 1, cos: 0.0, sin: 0.0 };
        let mut lines = vec![first];
        for (harmonic, pair) in (2..=self.harmonics).zip(numbers[1..].chunks_exact(2)) {
            let order = f64::from(harmonic);
            let (cos, sin) = (reach * pair[0] / (order * order), reach * pair[1] / order);
            first.cos -= order * order * cos;
            first.sin -= order * sin;
            lines.push(Line { harmonic, cos, sin });
        }
        lines[0] = first;
        HarmonicSeries { mean: centre + reach * numbers[0], lines }
    }

    /// The motion of a point at a sample of the period, laid out as models read it.
    pub(super) fn motion(&self, point: &[f64], sample: usize, out: &mut [f64]) {
        let width = self.width();
        for order in 0..self.orders {
            let start = (sample * self.orders + order) * width;
            let basis = &self.basis[start..start + width];
            for (c, (numbers, (centre, reach))) in point.chunks_exact(width).zip(&self.centres).enumerate() {
                let sum: f64 = numbers.iter().zip(basis).map(|(x, function)| x * function).sum();
                out[order * self.coordinates + c] = if order == 0 { centre + reach * sum } else { reach * sum };
            }
        }
    }

    /// Adds to the gradient in the point what a gradient in the motion at a sample gives.
    pub(super) fn pull_back(&self, of_motion: &[f64], sample: usize, gradient: &mut [f64]) {
        let width = self.width();
        for order in 0..self.orders {
            let start = (sample * self.orders + order) * width;
            let basis = &self.basis[start..start + width];
            for (c, (numbers, (_, reach))) in gradient.chunks_exact_mut(width).zip(&self.centres).enumerate() {
                let slope = reach * of_motion[order * self.coordinates + c];
                for (number, function) in numbers.iter_mut().zip(basis) {
                    *number += slope * function;
                }
            }
        }
    }

    /// The series of a point with coefficients of `digits` decimals, so that what is written is what was judged; the conditions at rest
    /// hold on the decimals.
    pub(super) fn rounded(&self, point: &[f64], digits: i32) -> Trajectory {
        let unit = 10_f64.powi(digits);
        let whole = |value: f64| (value * unit).round();
        let coordinate = |(c, numbers): (usize, &[f64])| {
            let HarmonicSeries { mean, mut lines } = self.of_coordinate(c, numbers);
            let mut first = (0.0, 0.0);
            for line in &mut lines[1..] {
                let order = f64::from(line.harmonic);
                let (cos, sin) = (whole(line.cos), whole(line.sin));
                first = (first.0 - order * order * cos, first.1 - order * sin);
                (line.cos, line.sin) = (cos / unit, sin / unit);
            }
            (lines[0].cos, lines[0].sin) = (first.0 / unit, first.1 / unit);
            lines.retain(|line| line.cos != 0.0 || line.sin != 0.0);
            HarmonicSeries { mean: whole(mean) / unit, lines }
        };
        let coordinates = point.chunks_exact(self.width()).enumerate().map(coordinate).collect();
        Trajectory { frequency: self.frequency, coordinates }
    }
}

/// The functions that the numbers of a coordinate multiply.
fn functions(harmonics: u32) -> Vec<HarmonicSeries> {
    let mut functions = vec![HarmonicSeries { mean: 1.0, lines: Vec::new() }];
    for harmonic in 2..=harmonics {
        let order = f64::from(harmonic);
        let of = |first: Line, own: Line| HarmonicSeries { mean: 0.0, lines: vec![first, own] };
        functions.push(of(
            Line { harmonic: 1, cos: -1.0, sin: 0.0 },
            Line { harmonic, cos: 1.0 / (order * order), sin: 0.0 },
        ));
        functions.push(of(Line { harmonic: 1, cos: 0.0, sin: -1.0 }, Line { harmonic, cos: 0.0, sin: 1.0 / order }));
    }
    functions
}

/// The largest factor by which a series of harmonics up to `harmonics` exceeds its largest magnitude at `samples` equal steps of a
/// period (Ehlich and Zeller 1964).
pub(super) fn excess(harmonics: u32, samples: usize) -> f64 {
    1.0 / (PI * f64::from(harmonics) / samples as f64).cos()
}

#[cfg(test)]
mod tests {
    use super::{Series, excess};

    fn series() -> Series {
        Series::new(vec![(0.5, 2.0), (-1.0, 0.3)], 4, 1.7, 24, 3)
    }

    fn point() -> Vec<f64> {
        (0..14).map(|i| (1.3 * f64::from(i * i)).sin()).collect()
    }

    #[test]
    fn motions_are_those_of_the_series_and_start_at_rest() {
        let (series, point) = (series(), point());
        let written = series.rounded(&point, 9);
        let (mut found, mut expected) = ([0.0; 6], [0.0; 6]);
        for sample in 0..series.samples {
            series.motion(&point, sample, &mut found);
            written.motion_at(sample, series.samples, 0.0, &mut expected);
            assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {expected:?}");
        }
        written.motion_at(0, series.samples, 0.0, &mut expected);
        assert!(expected[2..].iter().all(|rate| rate.abs() < 1e-12), "{expected:?}");
        // With three decimals as well.
        series.rounded(&point, 3).motion_at(0, series.samples, 0.0, &mut expected);
        assert!(expected[2..].iter().all(|rate| rate.abs() < 1e-12), "{expected:?}");
    }

    #[test]
    fn gradients_are_transposed_motions() {
        let (series, point) = (series(), point());
        let weights = [0.3, -1.0, 2.0, 0.7, -0.2, 1.1];
        let sum = |point: &[f64]| {
            let mut motion = [0.0; 6];
            series.motion(point, 5, &mut motion);
            motion.iter().zip(&weights).map(|(m, w)| m * w).sum::<f64>()
        };
        let mut gradient = vec![0.0; series.len()];
        series.pull_back(&weights, 5, &mut gradient);
        for (at, slope) in gradient.iter().enumerate() {
            let mut moved = point.clone();
            moved[at] += 1.0;
            assert!((sum(&moved) - sum(&point) - slope).abs() < 1e-11);
        }
    }

    #[test]
    fn no_series_exceeds_its_samples_by_more() {
        // cos K p between its peaks is the worst case.
        let worst = 1.0 / excess(5, 40);
        let shift = std::f64::consts::PI / 40.0;
        let most = (0..40).map(|n| (5.0 * (2.0 * std::f64::consts::PI * f64::from(n) / 40.0 + shift)).cos().abs());
        assert!((most.fold(0.0, f64::max) - worst).abs() < 1e-12);
    }
}
