//! The noise of every row, found by restricted maximum likelihood (REML).
//!
//! Variance of a part of line l of row j:
//!
//! ```text
//! S_jl = floor_jl + B_jb + kappa_j P_jl
//! ```
//!
//! floor: noise of the sensors, carried by the derivatives of the row; it cannot be undercut, without it a row is fitted by nothing. B: noise
//! of the forces, one number for every band b. kappa P: noise in proportion to the force on the line, which takes a misfit that repeats
//! with the motion. Every step weighs the equations, solves them, and compares what is left of every band with what the noise would leave
//! of it, which is less than its variance by the leverages.

use crate::likelihood::lines::RowLines;
use tpm_numerics::singular::unit_columns;
use tpm_numerics::{Cholesky, DMatrix, DVector, Dyn, Iteration, gram as products};

/// Steps, and the largest change of the logarithm of a variance after which they end.
const STEPS: Iteration = Iteration { most: 25, settled: 0.03 };
/// Numbers of degrees of freedom by which a band leans on its neighbours: bands that the parameters saturate tell nothing themselves.
const LEANING: f64 = 8.0;
/// Least noise in proportion to the force: nothing is claimed to better than 1e-4 of the force on a line.
pub(super) const LEAST_PROPORTIONAL: f64 = 1e-8;
/// Noise in proportion to the force from which the steps begin: it grows where a misfit asks for it, while a large one would be kept alive by
/// the errors of the parameters that lines with little weight leave.
const FIRST_PROPORTIONAL: f64 = LEAST_PROPORTIONAL;
/// Noise of a band from which they begin, as a share of its force.
const FIRST_SHARE: f64 = 1e-2;
/// Least noise of a band, as a share of the row's largest power.
const LEAST_BAND: f64 = 1e-16;
/// What is added to the diagonal of scaled normal equations, so that columns that others span change no weight.
const RIDGE: f64 = 1e-10;

/// The noise of all rows.
#[derive(Clone, Debug)]
pub(super) struct Noise {
    /// Variance of a part of every line, row by row.
    pub(super) variance: Vec<Vec<f64>>,
    bands: Vec<Vec<f64>>,
    proportional: Vec<f64>,
}

/// Values of all columns that take part, zero for those that do not.
pub(super) type Values = Vec<f64>;

impl Noise {
    /// What is known before anything is fitted. Without a floor all lines of a row count alike.
    pub(super) fn first(rows: &[RowLines], with_floor: bool) -> Self {
        let mean = |row: &RowLines| row.power.iter().sum::<f64>() / row.lines().max(1) as f64;
        let peak = |row: &RowLines| row.power.iter().copied().fold(0.0, f64::max);
        let bands = rows.iter().map(|row| {
            let of = |b: usize| {
                let own = row.band.iter().zip(&row.power).filter(|(band, _)| **band == b).map(|(_, power)| power);
                let (sum, count) = own.fold((0.0, 0.0), |(sum, count), power| (sum + power, count + 1.0));
                if with_floor { FIRST_SHARE * sum / f64::max(count, 1.0) + 1e-9 * peak(row) } else { mean(row) }
            };
            (0..row.bands()).map(|b| f64::max(of(b), f64::MIN_POSITIVE)).collect()
        });
        let proportional = vec![if with_floor { FIRST_PROPORTIONAL } else { 0.0 }; rows.len()];
        let mut noise = Noise { variance: Vec::new(), bands: bands.collect(), proportional };
        noise.sum(rows);
        noise
    }

    fn sum(&mut self, rows: &[RowLines]) {
        let of = |(j, row): (usize, &RowLines)| {
            let line = |l: usize| row.floor[l] + self.bands[j][row.band[l]] + self.proportional[j] * row.power[l];
            (0..row.lines()).map(line).collect()
        };
        self.variance = rows.iter().enumerate().map(of).collect();
    }

    /// The noise that leaves of the equations what they leave, with some of the columns, and the values of these. Lines above the
    /// `highest` frequency of a row do not count.
    pub(super) fn found(
        &self,
        rows: &[RowLines],
        columns: &[usize],
        right: usize,
        most: Option<usize>,
        highest: Option<&[f64]>,
    ) -> (Self, Values) {
        let mut noise = self.clone();
        let mut values = vec![0.0; right];
        for _ in 0..most.unwrap_or(STEPS.most) {
            let solved = Weighted::of(rows, &noise.variance, columns, right, highest);
            for (at, &column) in columns.iter().enumerate() {
                values[column] = solved.values[at];
            }
            let before = noise.variance.clone();
            for (j, row) in rows.iter().enumerate() {
                noise.update(j, row, &solved.squares[j], &solved.freedom[j]);
            }
            noise.sum(rows);
            let counts = |j: usize, l: usize| highest.is_none_or(|highest| rows[j].frequency[l] <= highest[j]);
            let change = |j: usize| {
                let own = noise.variance[j].iter().zip(&before[j]).enumerate();
                own.filter(|(l, _)| counts(j, *l)).map(|(_, (new, old))| (new / old).ln().abs()).fold(0.0, f64::max)
            };
            if (0..rows.len()).map(change).fold(0.0, f64::max) < STEPS.settled {
                break;
            }
        }
        (noise, values)
    }

    /// One step of a row, given the squares of what is left in units of the noise, and its degrees of freedom, by line.
    fn update(&mut self, j: usize, row: &RowLines, squares: &[f64], freedom: &[f64]) {
        let count = row.bands();
        let (mut left, mut expected) = (vec![0.0; count], vec![0.0; count]);
        // Degrees of freedom of a band, and as many of them as its own noise has a share in.
        let (mut all, mut own) = (vec![0.0; count], vec![0.0; count]);
        for l in 0..row.lines() {
            let (b, weight) = (row.band[l], 1.0 / self.variance[j][l]);
            left[b] += squares[l] * weight;
            expected[b] += freedom[l] * weight;
            all[b] += freedom[l];
            own[b] += (freedom[l] * weight * self.bands[j][b]).max(0.0);
        }
        let step = |b: usize| {
            let ratio = (left[b].max(f64::MIN_POSITIVE) / expected[b].max(f64::MIN_POSITIVE)).ln();
            self.bands[j][b].ln() + ratio.clamp(-20.0, 20.0) * all[b] / (all[b] + 1.0)
        };
        let logs: Vec<f64> = (0..count).map(step).collect();
        let peak = row.power.iter().copied().fold(0.0, f64::max);
        let least = (LEAST_BAND * peak).max(f64::MIN_POSITIVE);
        for b in 0..count {
            let mut log = logs[b];
            if count > 1 {
                let below = if b == 0 { 1 } else { b - 1 };
                let above = if b + 1 == count { b - 1 } else { b + 1 };
                let (wa, wc) = (own[below] + 0.5, own[above] + 0.5);
                let beside = (logs[below] * wa + logs[above] * wc) / (wa + wc);
                log = (own[b] * log + LEANING * beside) / (own[b] + LEANING);
            }
            self.bands[j][b] = log.exp().max(least);
        }
        if self.proportional[j] > 0.0 {
            let of = |by: &[f64]| -> f64 { (0..row.lines()).map(|l| row.power[l] * by[l] / self.variance[j][l]).sum() };
            let ratio = of(squares).max(f64::MIN_POSITIVE) / of(freedom).max(f64::MIN_POSITIVE);
            self.proportional[j] = (self.proportional[j] * ratio.clamp(1e-6, 1e6).sqrt()).max(LEAST_PROPORTIONAL);
        }
    }
}

/// Normal equations whose columns are scaled to a length of one.
pub(super) struct Scaled {
    scale: Vec<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl Scaled {
    /// Those of a matrix of products, with something added to the scaled diagonal, so that columns which others span make them no worse.
    pub(super) fn of(gram: &DMatrix<f64>, ridge: f64) -> Option<Self> {
        let n = gram.nrows();
        let scale: Vec<f64> = (0..n).map(|i| if gram[(i, i)] > 0.0 { gram[(i, i)].sqrt() } else { 1.0 }).collect();
        let scaled = |i: usize, k: usize| gram[(i, k)] / (scale[i] * scale[k]) + if i == k { ridge } else { 0.0 };
        let factor = Cholesky::new(DMatrix::from_fn(n, n, scaled))?;
        Some(Scaled { scale, factor })
    }

    pub(super) fn solve(&self, target: &DVector<f64>) -> DVector<f64> {
        let found = self.factor.solve(&DVector::from_fn(target.len(), |i, _| target[i] / self.scale[i]));
        DVector::from_fn(target.len(), |i, _| found[i] / self.scale[i])
    }

    pub(super) fn inverse(&self) -> DMatrix<f64> {
        let inverse = self.factor.inverse();
        DMatrix::from_fn(inverse.nrows(), inverse.ncols(), |i, k| inverse[(i, k)] / (self.scale[i] * self.scale[k]))
    }
}

/// Weighted equations, solved by their normal equations, which is enough for weights.
struct Weighted {
    values: Vec<f64>,
    /// Squares of what is left of a line, both parts, in units of the noise, row by row.
    squares: Vec<Vec<f64>>,
    /// Their expectations: parts less leverages.
    freedom: Vec<Vec<f64>>,
}

impl Weighted {
    fn of(rows: &[RowLines], variance: &[Vec<f64>], columns: &[usize], right: usize, highest: Option<&[f64]>) -> Self {
        let n = columns.len();
        let parts: Vec<(Vec<usize>, DMatrix<f64>, DVector<f64>)> = rows
            .iter()
            .zip(variance)
            .enumerate()
            .map(|(j, (row, variance))| {
                let counts = |l: usize| highest.is_none_or(|highest| row.frequency[l] <= highest[j]);
                let weight = |(l, variance): (usize, &f64)| if counts(l) { 1.0 / variance.sqrt() } else { 0.0 };
                let mut weights: Vec<f64> = variance.iter().enumerate().map(weight).collect();
                weights.extend_from_within(..);
                let (at, matrix) = row.weighted(columns, &weights);
                let right = row.column(right).component_mul(&DVector::from_vec(weights));
                (at, matrix, right)
            })
            .collect();
        let mut gram = DMatrix::<f64>::zeros(n, n);
        let mut target = DVector::<f64>::zeros(n);
        for (at, matrix, right) in &parts {
            let (own, of_right) = (products(matrix), matrix.tr_mul(right));
            for (a, &i) in at.iter().enumerate() {
                target[i] += of_right[a];
                for (b, &k) in at.iter().enumerate() {
                    gram[(i, k)] += own[(a, b)];
                }
            }
        }
        let inverse = Scaled::of(&gram, RIDGE).map_or_else(|| DMatrix::zeros(n, n), |own| own.inverse());
        let values: DVector<f64> = &inverse * target;
        let (mut squares, mut freedom) = (Vec::new(), Vec::new());
        for ((at, matrix, right), row) in parts.iter().zip(rows) {
            let own = DVector::from_iterator(at.len(), at.iter().map(|&i| values[i]));
            let left = right - matrix * own;
            let part = DMatrix::from_fn(at.len(), at.len(), |a, b| inverse[(at[a], at[b])]);
            let through = matrix * part;
            let lines = row.lines();
            let leverage =
                |part: usize| through.row(part).iter().zip(matrix.row(part).iter()).map(|(a, b)| a * b).sum::<f64>();
            // What a column takes of a line it takes of those that the window correlates with it.
            let taken = |part: usize| row.correlation * leverage(part);
            let free = |part: usize| if row.is_void(part) { 0.0 } else { (1.0 - taken(part)).max(0.0) };
            squares.push((0..lines).map(|l| left[l].powi(2) + left[lines + l].powi(2)).collect());
            freedom.push((0..lines).map(|l| free(l) + free(lines + l)).collect());
        }
        Weighted { values: values.iter().copied().collect(), squares, freedom }
    }
}

/// Weighted equations condensed to a triangle, the given columns and the right-hand side last. Lines that a window correlates count as fewer.
pub(super) fn triangle(rows: &[RowLines], variance: &[Vec<f64>], columns: &[usize], right: usize) -> DMatrix<f64> {
    let n = columns.len();
    let all: Vec<usize> = columns.iter().copied().chain([right]).collect();
    let mut stacked = DMatrix::<f64>::zeros(0, n + 1);
    for (row, variance) in rows.iter().zip(variance) {
        let mut weights: Vec<f64> = variance.iter().map(|variance| 1.0 / (row.correlation * variance).sqrt()).collect();
        weights.extend_from_within(..);
        let (at, own) = row.weighted(&all, &weights);
        let own = if own.nrows() > own.ncols() { own.qr().unpack_r() } else { own };
        let above = stacked.nrows();
        stacked = stacked.resize_vertically(above + own.nrows(), 0.0);
        for (from, to) in at.iter().enumerate() {
            stacked.view_mut((above, *to), (own.nrows(), 1)).copy_from(&own.column(from));
        }
    }
    if stacked.nrows() < n + 1 {
        stacked = stacked.resize_vertically(n + 1, 0.0);
    }
    // Columns of one length lose no digits to each other.
    let (stacked, scale) = unit_columns(stacked);
    let mut triangle = stacked.qr().unpack_r();
    for (mut column, scale) in triangle.column_iter_mut().zip(&scale) {
        column *= *scale;
    }
    triangle
}
