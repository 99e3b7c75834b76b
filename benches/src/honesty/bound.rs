//! The Cramer-Rao bound of a record by brute force: what the samples tell when parameters and starting state are unknown.
//!
//! The recorded inputs are known exactly and held between samples, and the sensors' noise is white. Derivatives are differences of
//! simulations, so that the bound shares nothing with those of `tpm design` and `tpm study`. A machine may be unstable along its
//! motion, as system A is at its faster setting; the record is therefore simulated block by block, and the states at the starts of
//! the blocks are unknowns that follow from each other.

/// Accelerations of a machine from parameters, positions, velocities and the input.
pub type Accelerations = fn(&[f64], &[f64], &[f64], f64) -> Vec<f64>;

/// A record of a machine whose motion is known.
#[derive(Clone, Copy, Debug)]
pub struct Held<'a> {
    /// The machine.
    pub accelerations: Accelerations,
    /// Positions, then velocities at the first sample of every block.
    pub states: &'a [Vec<f64>],
    /// Samples of a block.
    pub block: usize,
    /// The input at every sample.
    pub input: &'a [f64],
    /// Time between samples, s.
    pub sample_time: f64,
    /// Standard deviation of the white noise on every position.
    pub noise: f64,
}

/// Share of an unknown by which it is moved; the error of a central difference goes with its square.
const MOVED: f64 = 1e-5;

impl Held<'_> {
    /// Least standard deviations of the parameters; nothing where the record does not determine them.
    #[must_use]
    pub fn bounds(&self, theta: &[f64]) -> Option<Vec<f64>> {
        let (p, width) = (theta.len(), self.states.first()?.len());
        let unknowns = p + width * self.states.len();
        // Information matrix, bordered by the equations that lead from block to block: the covariance of the unknowns is the corner
        // of the inverse.
        let size = unknowns + width * (self.states.len() - 1);
        let mut bordered = vec![vec![0.0; size]; size];
        for (b, (state, input)) in self.states.iter().zip(self.input.chunks(self.block)).enumerate() {
            let at = [theta, state].concat();
            let place = |j: usize| if j < p { j } else { j + b * width };
            let columns: Vec<(Vec<f64>, Vec<f64>)> = (0..at.len()).map(|j| self.derivative(&at, j, p, input)).collect();
            for (i, (own, _)) in columns.iter().enumerate() {
                for (j, (other, _)) in columns.iter().enumerate() {
                    bordered[place(i)][place(j)] += own.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
                }
            }
            if b + 1 == self.states.len() {
                break;
            }
            for component in 0..width {
                let equation = unknowns + b * width + component;
                let next = p + (b + 1) * width + component;
                let mut border = |column: usize, value: f64| {
                    bordered[equation][column] = value;
                    bordered[column][equation] = value;
                };
                border(next, 1.0);
                columns.iter().enumerate().for_each(|(j, (_, end))| border(place(j), -end[component]));
            }
        }
        // Every unknown in units of what the samples of its own tell of it.
        let scale: Vec<f64> = (0..size).map(|i| if i < unknowns { bordered[i][i].sqrt() } else { 1.0 }).collect();
        for (i, row) in bordered.iter_mut().enumerate() {
            row.iter_mut().zip(&scale).for_each(|(entry, own)| *entry /= own * scale[i]);
        }
        let variances = corner(bordered, p)?;
        Some(variances.iter().zip(&scale).map(|(variance, scale)| variance.sqrt() / scale).collect())
    }

    /// Derivatives of the positions in a block, in units of their noise, and of the state behind it, by one of the unknowns: `p`
    /// parameters, then the state at the start of the block.
    fn derivative(&self, at: &[f64], j: usize, p: usize, input: &[f64]) -> (Vec<f64>, Vec<f64>) {
        // A velocity at rest is zero but for rounding.
        let step = MOVED * if at[j].abs() < MOVED { 1.0 } else { at[j].abs() };
        let moved = |by: f64| {
            let mut at = at.to_vec();
            at[j] += by;
            self.simulate(&at[..p], &at[p..], input)
        };
        let ((after, after_end), (before, before_end)) = (moved(step), moved(-step));
        let difference = |after: &[f64], before: &[f64], unit: f64| -> Vec<f64> {
            after.iter().zip(before).map(|(a, b)| (a - b) / (2.0 * step * unit)).collect()
        };
        (difference(&after, &before, self.noise), difference(&after_end, &before_end, 1.0))
    }

    /// Positions of the machine at all samples, coordinate by coordinate within a sample, and the state behind them.
    fn simulate(&self, theta: &[f64], start: &[f64], input: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let n = start.len() / 2;
        let h = self.sample_time;
        let mut state = start.to_vec();
        let mut positions = Vec::with_capacity(n * input.len());
        for &u in input {
            positions.extend_from_slice(&state[..n]);
            let rate =
                |state: &[f64]| [&state[n..], &(self.accelerations)(theta, &state[..n], &state[n..], u)].concat();
            let along = |rate: &[f64], h: f64| -> Vec<f64> { state.iter().zip(rate).map(|(s, r)| s + h * r).collect() };
            let a = rate(&state);
            let b = rate(&along(&a, 0.5 * h));
            let c = rate(&along(&b, 0.5 * h));
            let d = rate(&along(&c, h));
            let mean: Vec<f64> = (0..2 * n).map(|i| (a[i] + 2.0 * (b[i] + c[i]) + d[i]) / 6.0).collect();
            state = along(&mean, h);
        }
        (positions, state)
    }
}

/// The first entries on the diagonal of a matrix's inverse; nothing where the matrix is singular.
fn corner(mut matrix: Vec<Vec<f64>>, entries: usize) -> Option<Vec<f64>> {
    let n = matrix.len();
    for (i, row) in matrix.iter_mut().enumerate() {
        row.extend((0..entries).map(|j| f64::from(u8::from(i == j))));
    }
    for pivot in 0..n {
        let largest = (pivot..n).max_by(|&a, &b| matrix[a][pivot].abs().total_cmp(&matrix[b][pivot].abs()))?;
        matrix.swap(pivot, largest);
        let own = matrix[pivot].clone();
        if own[pivot].is_nan() || own[pivot].abs() < f64::EPSILON {
            return None;
        }
        for row in &mut matrix[pivot + 1..] {
            let factor = row[pivot] / own[pivot];
            if factor != 0.0 {
                row[pivot..].iter_mut().zip(&own[pivot..]).for_each(|(entry, own)| *entry -= factor * own);
            }
        }
    }
    for pivot in (0..n).rev() {
        let (above, rest) = matrix.split_at_mut(pivot);
        let own = &mut rest[0];
        let value = own[pivot];
        own[n..].iter_mut().for_each(|entry| *entry /= value);
        for row in above {
            let factor = row[pivot];
            row[n..].iter_mut().zip(&own[n..]).for_each(|(entry, own)| *entry -= factor * own);
        }
    }
    Some((0..entries).map(|j| matrix[j][n + j]).collect())
}

#[cfg(test)]
mod tests {
    use super::{Held, corner};

    #[test]
    fn the_corner_of_an_inverse() {
        let matrix = vec![vec![0.0, 2.0, 0.0], vec![2.0, 3.0, 1.0], vec![0.0, 1.0, 2.0]];
        // Determinant -8, by cofactors.
        let expected = [5.0 / -8.0, 0.0, -4.0 / -8.0];
        for (entry, expected) in corner(matrix, 3).expect("regular").iter().zip(expected) {
            assert!((entry - expected).abs() < 1e-15, "{entry} {expected}");
        }
        assert!(corner(vec![vec![1.0, 1.0], vec![1.0, 1.0]], 1).is_none());
    }

    #[test]
    fn a_constant_force_on_a_free_mass_is_bounded_as_theory_says() {
        // x = u t^2/(2 m) + start + velocity t: regression on a parabola. With N samples over the time T the part of t^2 that is no
        // straight line has the variance T^4/180, so that the curvature u/m has the deviation 2 sigma sqrt(180/N)/T^2.
        let (m, u, sigma, n) = (2.0, 3.0, 1e-3, 4000);
        let duration: f64 = 4.0;
        let curvature = 2.0 * sigma * (180.0 / n as f64).sqrt() / duration.powi(2);
        let expected = curvature * m * m / u;
        for blocks in [1, 5] {
            let state = |t: f64| vec![0.1 + 0.2 * t + 0.5 * u / m * t * t, 0.2 + u / m * t];
            let states: Vec<Vec<f64>> =
                (0..blocks).map(|b| state(f64::from(b) * duration / f64::from(blocks))).collect();
            let held = Held {
                accelerations: |theta, _, _, u| vec![u / theta[0]],
                states: &states,
                block: n / states.len(),
                input: &vec![u; n],
                sample_time: 1e-3,
                noise: sigma,
            };
            let bound = held.bounds(&[m]).expect("all shows")[0];
            assert!((bound / expected - 1.0).abs() < 1e-3, "{blocks}: {bound:e} {expected:e}");
        }
    }
}
