//! States and parameters of a linearised machine together, by square-root information smoothing.
//!
//! The corrections d_k of the states and t of the parameters obey, sample by sample,
//!
//! ```text
//! d_{k+1} = A_k d_k + C_k t + B_k w_k + f_k ,      y_k - H x_k = H d_k + v_k ,
//! ```
//!
//! with white w_k (noise of the inputs, forces of which nothing is known) and v_k (noise of the sensors) of known size and no prior
//! on d_0 and t. Every d_k is eliminated in turn by orthogonal reflections (Bierman, Factorization Methods for Discrete Sequential
//! Estimation, 1977); what is left are rows in t alone, one per reading: its innovations, uncorrelated and of unit variance where
//! the model is right. Invariant: nothing is squared, and a machine that is unstable by itself costs no digits, because states are
//! never predicted over more than one sample.
//!
//! Sensor noise of a colour is a state of its own, `n_{k+1} = phi n_k + e_k`.

use crate::output_error::chain::Chain;
use crate::output_error::noise::Noise;
use crate::output_error::reflect::triangularise;

/// Rows in the parameters that are gathered before they are reduced.
const ROWS_GATHERED: usize = 48;
/// Standard deviation of what is exact, beside that of a reading.
const EXACT_STATE_DEVIATION: f64 = 1e-8;

/// What the record says of the parameters, and of the states.
#[derive(Clone, Debug)]
pub(super) struct Smoothed {
    /// Upper triangle of the information about the columns, with the right-hand side as the last column and the root of the sum of
    /// squares that is left as the last entry; row-major, `columns + 1` wide.
    pub(super) root: Vec<f64>,
    /// Rows of the readings in the columns, with the right-hand side last.
    pub(super) innovations: Vec<f64>,
    /// Sample and coordinate of every such row.
    pub(super) places: Vec<(u32, u32)>,
    /// Twice the negative logarithm of the likelihood but for the squares that are left and a constant.
    pub(super) determinant: f64,
    /// The rows that give every disturbance and state from the next state and the columns; empty unless they were asked for.
    kept: Vec<f64>,
    /// Where the rows of every sample begin, and how many disturbances they have.
    blocks: Vec<(usize, usize)>,
    width: usize,
    order: usize,
}

impl Smoothed {
    /// Passes over a linearised record with its first `p` columns; `keep` keeps what the states need.
    pub(super) fn new(chain: &Chain, noise: &Noise, p: usize, keep: bool) -> Self {
        let coloured = noise.colour.iter().any(|colour| colour.abs() > 0.0);
        let (n, outputs) = (chain.order, chain.outputs.len());
        let order = if coloured { n + outputs } else { n };
        let mut this = Smoothed {
            root: Vec::new(),
            innovations: Vec::with_capacity(chain.samples * outputs * (p + 1)),
            places: Vec::with_capacity(chain.samples * outputs),
            determinant: 0.0,
            kept: if keep { Vec::with_capacity(chain.samples * order * (2 * order + p + 1)) } else { Vec::new() },
            blocks: Vec::new(),
            width: p + 1,
            order,
        };
        let exact =
            |derivative: usize, scale: f64| EXACT_STATE_DEVIATION * scale / chain.duration().powi(derivative as i32);
        let typical: Vec<f64> = (0..outputs).map(|c| noise.typical(c, outputs)).collect();
        let mut gathered: Vec<f64> = Vec::with_capacity((ROWS_GATHERED + p + 1) * (p + 1));
        let (mut work, mut factors): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let mut disturbed: Vec<(usize, f64)> = Vec::new();
        // Rows in the present state and the columns.
        let width = order + p + 1;
        let mut present = vec![0.0; order * width];
        for k in 0..chain.samples {
            if k > 0 && !chain.breaks[k - 1] {
                disturbed.clear();
                disturbed.extend(chain.disturbances(k - 1, noise));
                let own = if coloured { outputs } else { 0 };
                let extra = disturbed.len() + own;
                let full = extra + 2 * order + p + 1;
                let rows = extra + 2 * order;
                work.clear();
                work.resize(rows * full, 0.0);
                // The heaviest rows stand first, so that reflections lose nothing of the light ones.
                for i in 0..order {
                    let row = &mut work[i * full..(i + 1) * full];
                    if i < n {
                        let (coordinate, derivative) = chain.states[i];
                        let weight = 1.0 / exact(derivative, chain.scale[coordinate]);
                        for (w, &(column, size)) in disturbed.iter().enumerate() {
                            row[w] = -weight * size * chain.forcing(k - 1, i)[column];
                        }
                        for (j, a) in chain.transition(k - 1, i).iter().enumerate() {
                            row[extra + j] = -weight * a;
                        }
                        row[extra + order + i] = weight;
                        for (j, c) in chain.forcing(k - 1, i)[..p].iter().enumerate() {
                            row[extra + 2 * order + j] = -weight * c;
                        }
                        row[full - 1] = weight * chain.defect(k - 1)[i];
                        this.determinant -= 2.0 * weight.ln();
                    } else {
                        let c = i - n;
                        let (colour, deviation) = (noise.colour[c], chain.scale[c]);
                        let weight = 1.0 / exact(0, deviation);
                        let sigma = typical[c];
                        row[disturbed.len() + c] = -weight * sigma * (1.0 - colour * colour).sqrt();
                        row[extra + i] = -weight * colour;
                        row[extra + order + i] = weight;
                        this.determinant -= 2.0 * weight.ln();
                    }
                }
                for w in 0..extra {
                    let row = &mut work[(order + w) * full..(order + w + 1) * full];
                    row[w] = 1.0;
                    // The motion may already be linearised about a disturbance; what it is as a whole has the stated size.
                    if let Some(&(column, size)) = disturbed.get(w) {
                        row[full - 1] = -chain.disturbance(k - 1, column) / size;
                    }
                }
                for (i, row) in present.chunks_exact(width).enumerate() {
                    let to = &mut work[(order + extra + i) * full..(order + extra + i + 1) * full];
                    to[extra..extra + order].copy_from_slice(&row[..order]);
                    to[extra + 2 * order..].copy_from_slice(&row[order..]);
                }
                triangularise(&mut work, &mut factors, full, extra + order);
                this.determinant += 2.0 * (0..extra + order).map(|i| work[i * full + i].abs().ln()).sum::<f64>();
                if keep {
                    this.blocks.push((this.kept.len(), extra));
                    this.kept.extend_from_slice(&work[..(extra + order) * full]);
                }
                for (i, row) in present.chunks_exact_mut(width).enumerate() {
                    let from = (extra + order + i) * full;
                    row.copy_from_slice(&work[from + extra + order..from + full]);
                }
            } else {
                if k > 0 {
                    this.finish_segment(&mut present, width, keep);
                }
                present.fill(0.0);
                if coloured {
                    // The noise is stationary from the first sample on.
                    for (c, sigma) in typical.iter().enumerate() {
                        present[(n + c) * width + n + c] = 1.0 / sigma;
                        this.determinant += 2.0 * sigma.ln();
                    }
                }
            }
            work.clear();
            work.extend_from_slice(&present);
            let mut read = 0;
            for (c, &state) in chain.outputs.iter().enumerate() {
                let sigma = noise.readings[k * outputs + c];
                if !sigma.is_finite() {
                    continue;
                }
                let sigma = if coloured { EXACT_STATE_DEVIATION.sqrt() * sigma } else { sigma };
                let at = work.len();
                work.resize(at + width, 0.0);
                let row = &mut work[at..];
                row[state] = 1.0 / sigma;
                if coloured {
                    row[n + c] = 1.0 / sigma;
                }
                for (j, value) in chain.readings(k, c)[..p].iter().enumerate() {
                    row[order + j] = value / sigma;
                }
                row[width - 1] = chain.error(k, c) / sigma;
                this.determinant += 2.0 * sigma.ln();
                this.places.push((k as u32, c as u32));
                read += 1;
            }
            triangularise(&mut work, &mut factors, width, order);
            present.copy_from_slice(&work[..order * width]);
            for row in work[order * width..].chunks_exact(width).take(read) {
                this.innovations.extend_from_slice(&row[order..]);
                gathered.extend_from_slice(&row[order..]);
            }
            if gathered.len() >= ROWS_GATHERED * (p + 1) {
                this.reduce(&mut gathered);
            }
        }
        this.finish_segment(&mut present, width, keep);
        this.reduce(&mut gathered);
        this.root = gathered;
        this.root.resize((p + 1) * (p + 1), 0.0);
        this
    }

    fn finish_segment(&mut self, present: &mut [f64], width: usize, keep: bool) {
        for i in 0..self.order {
            self.determinant += 2.0 * present[i * width + i].abs().max(f64::MIN_POSITIVE).ln();
        }
        if keep {
            // The last state of a segment depends on no later one.
            self.blocks.push((self.kept.len(), 0));
            for row in present.chunks_exact(width) {
                self.kept.extend_from_slice(&row[..self.order]);
                self.kept.extend(std::iter::repeat_n(0.0, self.order));
                self.kept.extend_from_slice(&row[self.order..]);
            }
        }
    }

    /// Variance of the innovations, in units of what was stated.
    pub(super) fn scale(&self) -> f64 {
        self.least_squares() / self.places.len().max(1) as f64
    }

    /// Twice the negative logarithm of the likelihood, but for a constant, where `left` squares are left and the variance of the noise,
    /// in units of what was stated, is what these say but no less than `least`.
    pub(super) fn cost(&self, left: f64, least: f64) -> f64 {
        let readings = self.places.len().max(1) as f64;
        let scale = (left / readings).max(least).max(f64::MIN_POSITIVE);
        let cost = readings * scale.ln() + left / scale + self.determinant;
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// The cost with all columns at their best values, whatever the variance of the noise.
    pub(super) fn least_cost(&self) -> f64 {
        self.cost(self.least_squares(), 0.0)
    }

    /// The squares that all columns leave.
    pub(super) fn least_squares(&self) -> f64 {
        self.root.last().map_or(0.0, |left| left * left)
    }

    /// Number of columns and one for the right-hand side.
    pub(super) const fn width(&self) -> usize {
        self.width
    }

    /// Entry of the triangle of information; the right-hand side is its last column.
    pub(super) fn entry(&self, row: usize, column: usize) -> f64 {
        if column >= row { self.root[row * self.width + column] } else { 0.0 }
    }

    /// The innovations that values of the columns leave.
    pub(super) fn remaining(&self, values: &[f64]) -> Vec<f64> {
        let left = |row: &[f64]| {
            row[self.width - 1] - row.iter().zip(values).map(|(factor, value)| factor * value).sum::<f64>()
        };
        self.innovations.chunks_exact(self.width).map(left).collect()
    }

    fn reduce(&self, gathered: &mut Vec<f64>) {
        triangularise(gathered, &mut Vec::new(), self.width, self.width);
        gathered.truncate(self.width * self.width);
    }

    /// Corrections of all states and of all inputs, sample by sample, that belong to corrections of the columns. Sensor noise of a
    /// colour is left out.
    pub(super) fn corrections(&self, chain: &Chain, noise: &Noise, columns: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
        let (n, order) = (chain.order, self.order);
        let mut states = vec![0.0; chain.samples * n];
        let mut inputs = vec![0.0; chain.samples * chain.inputs];
        let mut next = vec![0.0; order];
        let mut now: Vec<f64> = Vec::new();
        for k in (0..chain.samples).rev() {
            let &(from, extra) = self.blocks.get(k)?;
            let full = extra + 2 * order + self.width;
            let rows = self.kept.get(from..from + (extra + order) * full)?;
            let unknown = extra + order;
            now.clear();
            now.resize(unknown, 0.0);
            for i in (0..unknown).rev() {
                let row = &rows[i * full..(i + 1) * full];
                let mut value = row[full - 1];
                for j in i + 1..unknown {
                    value -= row[j] * now[j];
                }
                for (factor, next) in row[unknown..unknown + order].iter().zip(&next) {
                    value -= factor * next;
                }
                for (factor, column) in row[unknown + order..full - 1].iter().zip(columns) {
                    value -= factor * column;
                }
                // A state that nothing shows stays where it is.
                now[i] = if row[i].abs() > 0.0 { value / row[i] } else { 0.0 };
            }
            if extra > 0 {
                for (w, (column, size)) in chain.disturbances(k, noise).enumerate() {
                    if column < chain.columns + chain.inputs {
                        inputs[k * chain.inputs + column - chain.columns] = now[w] * size;
                    }
                }
            }
            states[k * n..(k + 1) * n].copy_from_slice(&now[extra..extra + n]);
            next.copy_from_slice(&now[extra..]);
        }
        states.iter().chain(&inputs).all(|value| value.is_finite()).then_some((states, inputs))
    }
}
