//! Innovations of a linearised record, and its smoothed motion, by one Kalman filter.
//!
//! The deviation of the motion from the one about which the record is linearised obeys, from instant to instant,
//!
//! ```text
//! z_{k+1} = F_k z_k + C_k t + f_k + w_k ,     y = h' z + H t + v ,
//! ```
//!
//! where z holds the states, forces of the first order and coloured noise of the sensors, and t the columns. The filter carries how its
//! state depends on t beside it, so that every reading becomes one row `W t = nu` of unit variance. The covariance is kept as U D U'
//! (Bierman 1977; Thornton 1976), so that nothing is squared and subtracted. Invariant: a state is predicted over no more than one
//! transition, so that an unstable machine costs no digits.

use crate::simulation::chain::{Chain, Read};
use crate::simulation::noise::{FirstOrder, Noise};
use crate::simulation::triangle::Triangle;

/// The filter at an instant.
struct Filter<'a> {
    chain: &'a Chain,
    noise: &'a Noise,
    /// States in all, and where forces of the first order and the colours of the sensors begin.
    order: usize,
    drifts: usize,
    colours: usize,
    /// Upper triangle with ones on its diagonal, row-major, and the diagonal.
    upper: Vec<f64>,
    diagonal: Vec<f64>,
    /// Transition of all states.
    transition: Vec<f64>,
    gain: Vec<f64>,
    work: Vec<f64>,
    weights: Vec<f64>,
    weighted: Vec<f64>,
    /// Forcings that are new in a transition.
    new: Vec<usize>,
}

impl<'a> Filter<'a> {
    fn new(chain: &'a Chain, noise: &'a Noise) -> Self {
        let drifts = chain.order;
        let colours = drifts + noise.drift.as_ref().map_or(0, |own| own.variance.len());
        let order = colours + noise.colour.as_ref().map_or(0, |own| own.variance.len());
        Filter {
            chain,
            noise,
            order,
            drifts,
            colours,
            upper: vec![0.0; order * order],
            diagonal: vec![0.0; order],
            transition: vec![0.0; order * order],
            gain: vec![0.0; order],
            work: Vec::new(),
            weights: Vec::new(),
            weighted: Vec::new(),
            new: Vec::new(),
        }
    }

    /// Nothing is known of the states; noise of the first order is stationary.
    fn begin(&mut self) {
        self.upper.fill(0.0);
        (0..self.order).for_each(|i| self.upper[i * self.order + i] = 1.0);
        self.diagonal[..self.drifts].copy_from_slice(&self.chain.unknown);
        if let Some(drift) = &self.noise.drift {
            self.diagonal[self.drifts..self.colours].copy_from_slice(&drift.variance);
        }
        if let Some(colour) = &self.noise.colour {
            self.diagonal[self.colours..].copy_from_slice(&colour.variance);
        }
    }

    /// States that a reading reads.
    fn reads(&self, read: &Read) -> [Option<usize>; 2] {
        [Some(read.state), (self.order > self.colours).then(|| self.colours + read.sensor)]
    }

    /// Takes a reading in; leaves the gain and returns the variance of the innovation (Bierman).
    fn update(&mut self, read: &Read) -> f64 {
        let n = self.order;
        let reads = self.reads(read);
        let mut sum = read.variance * self.noise.white[read.sensor];
        for j in 0..n {
            let f: f64 = reads.iter().flatten().map(|&at| if at <= j { self.upper[at * n + j] } else { 0.0 }).sum();
            let v = f * self.diagonal[j];
            let before = sum;
            sum += f * v;
            self.gain[j] = v;
            if sum > 0.0 {
                self.diagonal[j] *= before / sum;
            }
            if f != 0.0 && before > 0.0 {
                let factor = -f / before;
                for i in 0..j {
                    let old = self.upper[i * n + j];
                    self.upper[i * n + j] = old + self.gain[i] * factor;
                    self.gain[i] += v * old;
                }
            } else {
                for i in 0..j {
                    self.gain[i] += v * self.upper[i * n + j];
                }
            }
        }
        self.gain.iter_mut().for_each(|gain| *gain /= sum);
        sum
    }

    /// Goes on to the next instant (Thornton's modified Gram-Schmidt); leaves the transition of all states.
    fn advance(&mut self, k: usize) {
        let (n, states) = (self.order, self.chain.order);
        let after = self.chain.time[k + 1] - self.chain.time[k];
        let first_force = self.chain.columns;
        self.transition.fill(0.0);
        for (i, row) in self.chain.transition(k).chunks_exact(states).enumerate() {
            self.transition[i * n..i * n + states].copy_from_slice(row);
        }
        for d in self.drifts..self.colours {
            for (i, value) in self.chain.forced(k, first_force + d - self.drifts).enumerate() {
                self.transition[i * n + d] = value;
            }
        }
        let kept = |own: &Option<FirstOrder>| own.as_ref().map_or(0.0, |own| own.kept(after));
        let (drift, colour) = (kept(&self.noise.drift), kept(&self.noise.colour));
        (self.drifts..self.colours).for_each(|d| self.transition[d * n + d] = drift);
        (self.colours..n).for_each(|e| self.transition[e * n + e] = colour);
        // What is new: forces of every row and switch, then what is added to noise of the first order.
        self.weights.clear();
        self.weights.extend_from_slice(&self.diagonal);
        self.new.clear();
        if self.noise.drift.is_none() {
            for (row, density) in self.noise.force.iter().enumerate().filter(|(_, density)| **density > 0.0) {
                self.new.push(first_force + row);
                self.weights.push(density / after);
            }
        }
        let first_switch = first_force + self.chain.rows;
        for (s, size) in self.chain.loose[k * self.chain.switches..(k + 1) * self.chain.switches].iter().enumerate() {
            if *size > 0.0 {
                self.new.push(first_switch + s);
                self.weights.push(size * size);
            }
        }
        let added = |own: &Option<FirstOrder>, share: f64, weights: &mut Vec<f64>| {
            let variances = own.iter().flat_map(|own| &own.variance);
            weights.extend(variances.map(|variance| variance * (1.0 - share * share)));
        };
        added(&self.noise.drift, drift, &mut self.weights);
        added(&self.noise.colour, colour, &mut self.weights);
        let width = self.weights.len();
        self.work.clear();
        self.work.resize(n * width, 0.0);
        for i in 0..n {
            let row = &mut self.work[i * width..(i + 1) * width];
            for l in 0..n {
                let factor = self.transition[i * n + l];
                if factor != 0.0 {
                    let own = &self.upper[l * n..(l + 1) * n];
                    for j in l..n {
                        row[j] += factor * own[j];
                    }
                }
            }
            if i >= states {
                row[n + self.new.len() + i - states] = 1.0;
            }
        }
        for (at, forcing) in self.new.iter().enumerate() {
            for (i, value) in self.chain.forced(k, *forcing).enumerate() {
                self.work[i * width + n + at] = value;
            }
        }
        // Rows are short and there are millions of them: indices cost less than iterators that are set up for each.
        self.weighted.resize(width, 0.0);
        for j in (0..n).rev() {
            let (above, from) = self.work.split_at_mut(j * width);
            let (own, weighted) = (&from[..width], &mut self.weighted[..width]);
            let mut size = 0.0;
            for c in 0..width {
                weighted[c] = own[c] * self.weights[c];
                size += own[c] * weighted[c];
            }
            self.diagonal[j] = size;
            self.upper[j * n + j] = 1.0;
            let inverse = if size > 0.0 { 1.0 / size } else { 0.0 };
            for i in 0..j {
                let row = &mut above[i * width..(i + 1) * width];
                let mut sum = 0.0;
                for c in 0..width {
                    sum += row[c] * weighted[c];
                }
                let factor = sum * inverse;
                self.upper[i * n + j] = factor;
                if factor != 0.0 {
                    for c in 0..width {
                        row[c] -= factor * own[c];
                    }
                }
            }
        }
    }

    /// The covariance.
    fn covariance(&self) -> Vec<f64> {
        let n = self.order;
        let mut whole = vec![0.0; n * n];
        for i in 0..n {
            for j in i..n {
                let sum: f64 = (j..n).map(|l| self.upper[i * n + l] * self.diagonal[l] * self.upper[j * n + l]).sum();
                whole[i * n + j] = sum;
                whole[j * n + i] = sum;
            }
        }
        whole
    }
}

/// What a record says of its columns.
pub(super) struct Whitened {
    /// Triangle of the rows of the readings in the columns, the right-hand side behind them, of either half of the readings.
    pub(super) halves: [Triangle; 2],
    /// Sum of the logarithms of the innovations' variances.
    pub(super) logs: f64,
}

/// Passes over a linearised record with some of its columns.
pub(super) fn whiten(chain: &Chain, noise: &Noise, columns: &[usize]) -> Whitened {
    let width = columns.len() + 1;
    let mut filter = Filter::new(chain, noise);
    let n = filter.order;
    // How the states depend on the columns, and behind these their deviation.
    let mut depend = vec![0.0; n * width];
    let mut next = vec![0.0; n * width];
    let mut seen = vec![0.0; width];
    let mut row = vec![0.0; width];
    let mut halves = [Triangle::new(width), Triangle::new(width)];
    let middle = chain.reads.len() / 2;
    let mut logs = 0.0;
    for k in 0..chain.instants() {
        if chain.begins[k] {
            filter.begin();
            depend.fill(0.0);
        }
        for (number, read) in chain.reads_at(k) {
            seen.fill(0.0);
            for at in filter.reads(read).into_iter().flatten() {
                seen.iter_mut().zip(&depend[at * width..(at + 1) * width]).for_each(|(seen, own)| *seen += own);
            }
            if !chain.read_columns.is_empty() {
                for (seen, &column) in seen.iter_mut().zip(columns) {
                    *seen += chain.read_column(number, column);
                }
            }
            let variance = filter.update(read);
            logs += variance.ln();
            let scale = 1.0 / variance.sqrt();
            let innovation = read.error - seen[width - 1];
            row.iter_mut().zip(&seen).for_each(|(row, seen)| *row = scale * seen);
            row[width - 1] = scale * innovation;
            halves[usize::from(number >= middle)].take(&row);
            seen[width - 1] = -innovation;
            for (own, gain) in depend.chunks_exact_mut(width).zip(&filter.gain) {
                if *gain != 0.0 {
                    own.iter_mut().zip(&seen).for_each(|(own, seen)| *own -= gain * seen);
                }
            }
        }
        if k + 1 == chain.instants() || chain.begins[k + 1] {
            continue;
        }
        filter.advance(k);
        next.fill(0.0);
        for i in 0..n {
            let to = &mut next[i * width..(i + 1) * width];
            for l in 0..n {
                let factor = filter.transition[i * n + l];
                if factor != 0.0 {
                    let from = &depend[l * width..(l + 1) * width];
                    for c in 0..width {
                        to[c] += factor * from[c];
                    }
                }
            }
        }
        let all = chain.width();
        let forcing = &chain.forcing[k * chain.order * all..(k + 1) * chain.order * all];
        for ((to, forcing), defect) in next.chunks_exact_mut(width).zip(forcing.chunks_exact(all)).zip(chain.defect(k))
        {
            for (to, &column) in to.iter_mut().zip(columns) {
                *to += forcing[column];
            }
            to[width - 1] += defect;
        }
        std::mem::swap(&mut depend, &mut next);
    }
    Whitened { halves, logs }
}

/// The motion that all readings together say, when the columns move by given steps.
pub(super) struct Smoothed {
    /// Deviation of every state, instant by instant.
    pub(super) states: Vec<f64>,
    /// Least deviation of every state, predicted from the readings before an instant.
    pub(super) least_deviation: Vec<f64>,
}

/// Smooths a linearised record (Bryson and Frazier), whose columns move by `steps`.
pub(super) fn smooth(chain: &Chain, noise: &Noise, steps: &[f64]) -> Smoothed {
    let mut filter = Filter::new(chain, noise);
    let (n, instants) = (filter.order, chain.instants());
    let moved = |values: &dyn Fn(usize) -> f64| -> f64 {
        steps.iter().enumerate().filter(|(_, step)| **step != 0.0).map(|(j, step)| step * values(j)).sum()
    };
    let mut deviation = vec![0.0; n];
    let mut predicted = Vec::with_capacity(instants * n);
    let mut covariances = Vec::with_capacity(instants * n * n);
    let mut transitions = vec![0.0; instants * n * n];
    let mut gains = Vec::with_capacity(chain.reads.len() * n);
    let mut innovations = Vec::with_capacity(chain.reads.len());
    for k in 0..instants {
        if chain.begins[k] {
            filter.begin();
            deviation.fill(0.0);
        }
        predicted.extend_from_slice(&deviation);
        covariances.extend(filter.covariance());
        for (number, read) in chain.reads_at(k) {
            let seen: f64 = filter.reads(read).iter().flatten().map(|&at| deviation[at]).sum();
            let added = if chain.read_columns.is_empty() { 0.0 } else { moved(&|j| chain.read_column(number, j)) };
            let variance = filter.update(read);
            let innovation = read.error - seen - added;
            deviation.iter_mut().zip(&filter.gain).for_each(|(own, gain)| *own += gain * innovation);
            gains.extend_from_slice(&filter.gain);
            innovations.push((innovation, variance));
        }
        if k + 1 == instants || chain.begins[k + 1] {
            continue;
        }
        filter.advance(k);
        transitions[k * n * n..(k + 1) * n * n].copy_from_slice(&filter.transition);
        let mut next = vec![0.0; n];
        for (to, row) in next.iter_mut().zip(filter.transition.chunks_exact(n)) {
            *to = row.iter().zip(&deviation).map(|(a, d)| a * d).sum();
        }
        let all = chain.width();
        let forcing = &chain.forcing[k * chain.order * all..(k + 1) * chain.order * all];
        for ((to, forcing), defect) in next.iter_mut().zip(forcing.chunks_exact(all)).zip(chain.defect(k)) {
            *to += defect + moved(&|j| forcing[j]);
        }
        deviation = next;
    }
    // Backward: what later readings say, as the gradient of their likelihood.
    let mut states = vec![0.0; instants * chain.order];
    let mut later = vec![0.0; n];
    for k in (0..instants).rev() {
        let reads: Vec<(usize, &Read)> = chain.reads_at(k).collect();
        for (number, read) in reads.into_iter().rev() {
            let (innovation, variance) = innovations[number];
            let gain = &gains[number * n..(number + 1) * n];
            let sum = gain.iter().zip(&later).map(|(gain, later)| gain * later).sum::<f64>() + innovation / variance;
            filter.reads(read).iter().flatten().for_each(|&at| later[at] -= sum);
        }
        let covariance = &covariances[k * n * n..(k + 1) * n * n];
        for (i, state) in states[k * chain.order..(k + 1) * chain.order].iter_mut().enumerate() {
            let row = &covariance[i * n..(i + 1) * n];
            *state = predicted[k * n + i] - row.iter().zip(&later).map(|(p, later)| p * later).sum::<f64>();
        }
        if k == 0 {
            break;
        }
        if chain.begins[k] {
            later.fill(0.0);
            continue;
        }
        let transition = &transitions[(k - 1) * n * n..k * n * n];
        let mut before = vec![0.0; n];
        for (row, later) in transition.chunks_exact(n).zip(&later) {
            before.iter_mut().zip(row).for_each(|(to, a)| *to += a * later);
        }
        later = before;
    }
    let own = |i: usize| covariances.iter().skip(i * (n + 1)).step_by(n * n).copied();
    let least_deviation = (0..chain.order).map(|i| own(i).fold(f64::INFINITY, f64::min).max(0.0).sqrt()).collect();
    Smoothed { states, least_deviation }
}

#[cfg(test)]
mod tests {
    use super::{smooth, whiten};
    use crate::simulation::chain::{Chain, Read};
    use crate::simulation::noise::{FirstOrder, Noise};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use tpm_numerics::{Cholesky, DMatrix, DVector};

    /// A record of two states with two columns, forces and coloured sensors, in two blocks.
    fn chain(draw: &mut impl FnMut() -> f64) -> Chain {
        let (order, columns, rows, instants) = (2, 2, 1, 9);
        let mut chain = Chain { order, columns, rows, unknown: vec![4.0, 9.0], ..Chain::default() };
        for k in 0..instants {
            chain.time.push(0.1 * f64::from(k) + if k > 4 { 1.0 } else { 0.02 * f64::from(k % 2) });
            chain.begins.push(k == 0 || k == 5);
            chain.first_read.push(chain.reads.len());
            for sensor in 0..if k == 3 { 0 } else { 1 + usize::from(k % 3 == 0) } {
                chain.reads.push(Read { sensor, state: sensor, error: draw(), variance: 0.5 + draw().abs() });
            }
        }
        chain.first_read.push(chain.reads.len());
        chain.read_columns = (0..chain.reads.len() * columns).map(|_| 0.3 * draw()).collect();
        for _ in 1..instants {
            chain.transition.extend((0..4).map(|i| if i % 3 == 0 { 1.0 } else { 0.0 } + 0.3 * draw()));
            chain.forcing.extend((0..order * (columns + rows)).map(|_| draw()));
            chain.defect.extend((0..order).map(|_| draw()));
        }
        chain
    }

    /// Readings less their mean, their dependence on the columns, their covariance, that of the states with them, and mean and dependence of
    /// the states.
    type WrittenOut = (DVector<f64>, DMatrix<f64>, DMatrix<f64>, DMatrix<f64>, DVector<f64>, DMatrix<f64>);

    /// All readings and states as one normal vector, written out: the readings' mean, their dependence on the columns, covariance, and the
    /// states' covariance with them.
    fn written_out(chain: &Chain, noise: &Noise) -> WrittenOut {
        let (n, colours) = (chain.order, noise.colour.as_ref().map_or(0, |own| own.variance.len()));
        let drifts = noise.drift.as_ref().map_or(0, |own| own.variance.len());
        let order = n + drifts + colours;
        let instants = chain.instants();
        let all = order * instants;
        let mut mean = DVector::zeros(all);
        let mut by = DMatrix::zeros(all, chain.columns);
        let mut covariance = DMatrix::<f64>::zeros(all, all);
        let stationary: Vec<f64> = chain
            .unknown
            .iter()
            .copied()
            .chain(noise.drift.iter().flat_map(|own| own.variance.clone()))
            .chain(noise.colour.iter().flat_map(|own| own.variance.clone()))
            .collect();
        for k in 0..instants {
            if chain.begins[k] {
                (0..order).for_each(|i| covariance[(k * order + i, k * order + i)] = stationary[i]);
                continue;
            }
            let after = chain.time[k] - chain.time[k - 1];
            let mut f = DMatrix::zeros(order, order);
            f.view_mut((0, 0), (n, n)).copy_from(&DMatrix::from_row_slice(n, n, chain.transition(k - 1)));
            let mut q = DMatrix::zeros(order, order);
            let force = DVector::from_iterator(n, chain.forced(k - 1, chain.columns));
            if drifts == 0 {
                q.view_mut((0, 0), (n, n)).copy_from(&(&force * force.transpose() * (noise.force[0] / after)));
            } else {
                f.view_mut((0, n), (n, 1)).copy_from(&force);
            }
            for i in n..order {
                let own = if i < n + drifts { noise.drift.as_ref() } else { noise.colour.as_ref() };
                let kept = own.map_or(0.0, |own| own.kept(after));
                f[(i, i)] = kept;
                q[(i, i)] = stationary[i] * (1.0 - kept * kept);
            }
            let before = mean.rows((k - 1) * order, order).into_owned();
            let mut next = &f * before;
            (0..n).for_each(|i| next[i] += chain.defect(k - 1)[i]);
            mean.rows_mut(k * order, order).copy_from(&next);
            let mut moved = &f * by.rows((k - 1) * order, order);
            for j in 0..chain.columns {
                chain.forced(k - 1, j).enumerate().for_each(|(i, value)| moved[(i, j)] += value);
            }
            by.rows_mut(k * order, order).copy_from(&moved);
            let cross = &f * covariance.view(((k - 1) * order, 0), (order, k * order));
            covariance.view_mut((k * order, 0), (order, k * order)).copy_from(&cross);
            covariance.view_mut((0, k * order), (k * order, order)).copy_from(&cross.transpose());
            let own = &f * covariance.view(((k - 1) * order, (k - 1) * order), (order, order)) * f.transpose() + q;
            covariance.view_mut((k * order, k * order), (order, order)).copy_from(&own);
        }
        let reads = chain.reads.len();
        let mut select = DMatrix::zeros(reads, all);
        let mut errors = DVector::zeros(reads);
        let mut white = DMatrix::zeros(reads, reads);
        let mut added = DMatrix::zeros(reads, chain.columns);
        for k in 0..instants {
            for (number, read) in chain.reads_at(k) {
                select[(number, k * order + read.state)] = 1.0;
                if colours > 0 {
                    select[(number, k * order + n + drifts + read.sensor)] = 1.0;
                }
                errors[number] = read.error;
                white[(number, number)] = read.variance * noise.white[read.sensor];
                (0..chain.columns).for_each(|j| added[(number, j)] = chain.read_column(number, j));
            }
        }
        let of_readings = &select * &covariance * select.transpose() + white;
        let with = &covariance * select.transpose();
        (errors - &select * &mean, &select * &by + added, of_readings, with, mean, by)
    }

    #[test]
    fn innovations_and_motion_are_those_of_the_whole_normal_vector() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let chain = chain(&mut draw);
        let plain = Noise { white: vec![1.0, 0.5], least: vec![0.0; 2], colour: None, force: vec![0.7], drift: None };
        let first = |variance: Vec<f64>| Some(FirstOrder { variance, time: 0.3 });
        let coloured = Noise { colour: first(vec![0.4, 0.9]), ..plain.clone() };
        let drifting = Noise { drift: first(vec![1.3]), ..coloured.clone() };
        for noise in [plain, coloured, drifting] {
            let (left, by, covariance, with, mean, states_by) = written_out(&chain, &noise);
            let whole = Cholesky::new(covariance).expect("positive definite");
            let found = whiten(&chain, &noise, &[0, 1]);
            let logs: f64 = whole.l().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            assert!((found.logs - logs).abs() < 1e-9, "{} {logs}", found.logs);
            let [first, second] = found.halves;
            let triangle = first.with(&second).square();
            let rows = DMatrix::from_fn(left.len(), 3, |i, j| if j < 2 { by[(i, j)] } else { left[i] });
            let products = rows.transpose() * whole.solve(&rows);
            let own = triangle.transpose() * &triangle;
            assert!((&products - &own).amax() < 1e-9 * products.amax(), "{products} {own}");
            let steps = [0.3, -0.8];
            let smoothed = smooth(&chain, &noise, &steps);
            let moved = DVector::from_column_slice(&steps);
            let expected = &mean + &states_by * &moved + &with * whole.solve(&(&left - &by * &moved));
            let order = expected.len() / chain.instants();
            for k in 0..chain.instants() {
                for i in 0..chain.order {
                    let (a, b) = (smoothed.states[k * chain.order + i], expected[k * order + i]);
                    assert!((a - b).abs() < 1e-9, "{k} {i}: {a} {b}");
                }
            }
        }
    }
}
