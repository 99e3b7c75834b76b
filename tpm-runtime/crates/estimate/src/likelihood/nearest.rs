//! The model that is nearest to the forces of a record, as it stands and with the terms that it lacks.
//!
//! Of a right model the lines' weights give the smallest deviations. Of one that lacks something they give values that are right beside the
//! missing terms, and that predict badly without them: what is nearest to the forces is least squares over the samples, every row weighed by
//! what it leaves. Behind the low pass of its row every sample counts, the times around reversals too. What such a model leaves elsewhere is
//! told by parts of the record that its values were not taken from; a term that does not lower this is no part of it.

use crate::error::EstimateError;
use crate::likelihood::library::{LEAST_SHARE, OnGrid, Term, TermKind};
use crate::likelihood::lines::{RowLines, Signals, View, row_lines};
use crate::likelihood::noise::{Noise, Scaled, triangle};
use crate::likelihood::pass::Pass;
use crate::likelihood::split::Split;
use std::f64::consts::PI;
use tpm_controller::model::moving;
use tpm_numerics::{DMatrix, DVector, Matrix, alarm};

/// Parts of a record of which each is left out once.
const BLOCKS: usize = 10;
/// What is left out beside such a part, in reaches of the low pass of the row: so far its samples are made of one another's.
const APART: f64 = 0.5;
/// Times that the rows are weighed by what they leave.
const WEIGHINGS: usize = 6;
/// Samples in an oscillation at the cut-off of a row's low pass.
const SAMPLES: f64 = 3.0;
/// Terms of a row stay when they lower what it leaves of the parts that were left out by so many deviations of the mean.
const LOWERS: f64 = 1.0;
/// Travels over which friction may build up again after a reversal, as parts of the range of the coordinate: steps of five, since travels that
/// differ by less make nearly the same force.
const TRAVELS: [u32; 3] = [3000, 600, 120];
/// A travel is longer than so many deviations of the sensor's noise: where a motion turned back is not known better.
const RESOLVED: f64 = 4.0;
/// With such friction a row leaves at most so much of what it left without it, on the parts that were left out: a state that has to be followed on
/// the controller is worth no less than a tenth.
const WORTH_A_STATE: f64 = 0.9;
/// Share of such friction that must not be made of what the row has already.
const SPANNED: f64 = 1e-3;
/// Times that the load is computed anew by the values that were found with its friction: those without it make up for that friction.
const REFERENCES: usize = 3;
/// The terms of a row are not believed when even with them more than this share of its force is left.
const MOST_LEFT: f64 = 0.7;
/// What is added to the diagonal of scaled normal equations.
const RIDGE: f64 = 1e-12;

/// The values with which a model is nearest to the forces of a record.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Nearest {
    /// Values of all parameters.
    pub values: Vec<f64>,
    /// Their covariance under the noise of the lines.
    pub covariance: Matrix,
    /// Terms that the model lacks and that are part of this one.
    pub terms: Vec<AddedTerm>,
    /// What is left of every row, as a share of its force.
    pub left: Vec<f64>,
    /// What is left of every row in parts of the record from which the values were not taken, as a share of its force.
    pub held_out: Vec<f64>,
}

/// How well a model that lacks something can predict the forces of a record.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Nearby {
    /// What the values of the estimate, which are right beside what is missing, leave of every row without it, as a share of its force.
    pub left: Vec<f64>,
    /// The model as it stands.
    pub stated: Nearest,
    /// The model with terms that it lacks; nothing where none make it better on parts of the record from which its values were not taken.
    pub completed: Option<Nearest>,
    /// By how much later than it is recorded every input acts in them, s; zero where it acts at once, or seems to act earlier.
    pub delays: Vec<f64>,
}

/// A term that a model lacks, as a part of one that has it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct AddedTerm {
    /// The term.
    pub term: Term,
    /// Its factor, in the units of row and term.
    pub value: f64,
    /// Numbers in it, in units of its coordinate and s: the rate at which Stribeck friction has fallen to 1/e; the travel over which friction
    /// builds up; the width over which play is rounded; the wave number of a ripple and the middle of its range.
    pub constants: Vec<f64>,
}

/// Products of the columns of a row with each other, the right-hand side last.
struct Block {
    /// Of all samples of a part of the record.
    whole: DMatrix<f64>,
    /// Of those that nothing outside the part takes part in.
    inner: DMatrix<f64>,
}

/// A row in parts of the record.
struct RowBlocks {
    /// Places of its columns among those that are asked for.
    at: Vec<usize>,
    blocks: Vec<Block>,
    sum: DMatrix<f64>,
    samples: f64,
}

impl RowBlocks {
    /// Sum of squares of what values leave of it, given its products.
    fn left(&self, products: &DMatrix<f64>, values: &DVector<f64>) -> f64 {
        let own = self.with_one(values);
        (products * &own).dot(&own).max(0.0)
    }

    /// What the products are multiplied by: the values, and minus one for the right-hand side.
    fn with_one(&self, values: &DVector<f64>) -> DVector<f64> {
        let own = self.at.iter().map(|&at| values[at]);
        DVector::from_iterator(self.at.len() + 1, own.chain([-1.0]))
    }

    fn force(&self, products: &DMatrix<f64>) -> f64 {
        products[(self.at.len(), self.at.len())]
    }
}

/// Least squares over rows; columns that do not take part stay zero.
fn solve(rows: &[RowBlocks], weights: &[f64], without: Option<usize>, takes_part: &[bool]) -> Option<DVector<f64>> {
    let places: Vec<usize> = (0..takes_part.len()).filter(|&at| takes_part[at]).collect();
    let mut within = vec![None; takes_part.len()];
    places.iter().enumerate().for_each(|(own, &at)| within[at] = Some(own));
    let n = places.len();
    let (mut gram, mut target) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
    for (row, weight) in rows.iter().zip(weights) {
        let last = row.at.len();
        let products = without.map_or_else(|| row.sum.clone(), |b| &row.sum - &row.blocks[b].whole);
        for (a, i) in row.at.iter().enumerate().filter_map(|(a, &at)| Some((a, within[at]?))) {
            target[i] += weight * products[(a, last)];
            for (b, k) in row.at.iter().enumerate().filter_map(|(b, &at)| Some((b, within[at]?))) {
                gram[(i, k)] += weight * products[(a, b)];
            }
        }
    }
    let found = Scaled::of(&gram, RIDGE)?.solve(&target);
    let mut values = DVector::zeros(takes_part.len());
    places.iter().enumerate().for_each(|(i, &at)| values[at] = found[i]);
    Some(values)
}

/// What least squares gives.
struct Fitted {
    values: DVector<f64>,
    /// Weight of every row.
    weights: Vec<f64>,
    /// Sum of squares of what is left of the parts that were left out, by row and part.
    held_out: Vec<Vec<f64>>,
}

/// Least squares over rows whose weights are what they leave themselves.
fn fitted(rows: &[RowBlocks], takes_part: &[bool]) -> Option<Fitted> {
    let mut weights: Vec<f64> = rows.iter().map(|row| 1.0 / row.force(&row.sum).max(f64::MIN_POSITIVE)).collect();
    let mut values = solve(rows, &weights, None, takes_part)?;
    for _ in 0..WEIGHINGS {
        let of = |row: &RowBlocks| {
            row.samples / row.left(&row.sum, &values).max(1e-12 * row.force(&row.sum)).max(f64::MIN_POSITIVE)
        };
        weights = rows.iter().map(of).collect();
        values = solve(rows, &weights, None, takes_part)?;
    }
    let mut held_out = vec![Vec::with_capacity(BLOCKS); rows.len()];
    for b in 0..BLOCKS {
        let without = solve(rows, &weights, Some(b), takes_part)?;
        rows.iter().zip(&mut held_out).for_each(|(row, own)| own.push(row.left(&row.blocks[b].inner, &without)));
    }
    Some(Fitted { values, weights, held_out })
}

/// Which of some candidates the lines of a row show most beside other columns; nothing where they show none.
fn shown_beside(
    (lines, noise): (&[RowLines], &Noise),
    [own, asked]: [Vec<usize>; 2],
    right: usize,
    threshold: f64,
) -> Option<usize> {
    let all: Vec<usize> = own.iter().chain(&asked).copied().collect();
    let split = Split::new(&triangle(lines, &noise.variance, &all, right), own.len(), &vec![SPANNED; asked.len()]);
    let gain = |i: usize| {
        let column = split.candidates.column(i);
        (i, column.dot(&split.target).powi(2) / column.norm_squared().max(f64::MIN_POSITIVE))
    };
    let gains = (0..asked.len()).map(gain).filter(|(_, gain)| *gain > threshold);
    gains.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
}

impl Pass<'_> {
    /// The model as it stands, nearest to the forces; and, where some of the given terms make it better, the model with them. `fixed` are the
    /// columns that are estimated, `terms` those of terms that the model lacks; a row without an input is linear about the given values. `load`
    /// are parameters whose forces are the load of the drives. Nothing where the equations cannot be solved.
    pub(super) fn nearest(
        &mut self,
        (fixed, terms): (&[usize], &[usize]),
        (values, missing): (&[f64], &[f64]),
        (noise, load): (&Noise, &[usize]),
    ) -> Result<Option<Nearby>, EstimateError> {
        let p = self.rows.model.dims().parameters;
        let building = self.take_presliding();
        let columns: Vec<usize> = fixed.iter().chain(terms).chain(&building).copied().collect();
        let all = |pass: &Self| -> Result<Vec<RowBlocks>, EstimateError> {
            (0..pass.rows.model.dims().rows).map(|row| pass.blocks(row, &columns, missing)).collect()
        };
        let mut rows = all(self)?;
        let mut takes_part: Vec<bool> = (0..columns.len()).map(|at| at < fixed.len()).collect();
        let Some(plain) = fitted(&rows, &takes_part) else { return Ok(None) };
        let stated = self.of_fitted(&rows, (&columns, fixed.len()), &plain, noise);
        let own = |(at, &column): (usize, &usize)| match (column < p, at < fixed.len()) {
            (true, _) => values[column],
            (false, true) => missing[column - p],
            (false, false) => 0.0,
        };
        let own = DVector::from_iterator(columns.len(), columns.iter().enumerate().map(own));
        let left = rows.iter().map(|row| share(row.left(&row.sum, &own), row.force(&row.sum))).collect();
        takes_part[..fixed.len() + terms.len()].fill(true);
        let mut reference = stated.values.clone();
        for _ in 0..REFERENCES {
            if !self.take_loads(terms, load, &reference) {
                break;
            }
            rows = all(self)?;
            let Some(found) = fitted(&rows, &takes_part) else { break };
            reference = self.values_of(&columns, &found);
        }
        // The row whose terms do most harm loses them first.
        let tested = rows.iter().all(|row| row.blocks.iter().any(|block| row.force(&block.inner) > 0.0));
        let completed = loop {
            if !tested || takes_part[fixed.len()..].iter().all(|takes| !takes) {
                break None;
            }
            let Some(found) = fitted(&rows, &takes_part) else { break None };
            let harm = |row: usize| {
                let has = |at: &&usize| **at >= fixed.len() && takes_part[**at];
                let any = rows[row].at.iter().any(|at| has(&at));
                any.then(|| {
                    let less = plain.held_out[row].iter().zip(&found.held_out[row]).map(|(plain, with)| plain - with);
                    let (mean, deviation) = mean_and_deviation(&less.collect::<Vec<f64>>());
                    let inner = rows[row].blocks.iter().map(|block| rows[row].force(&block.inner)).sum();
                    let hopeless = share(found.held_out[row].iter().sum(), inner) > MOST_LEFT;
                    let hopeless = if hopeless { f64::INFINITY } else { 0.0 };
                    (LOWERS * deviation - mean) / rows[row].force(&rows[row].sum).max(f64::MIN_POSITIVE) + hopeless
                })
            };
            let worst = (0..rows.len()).filter_map(|row| Some((row, harm(row)?))).max_by(|a, b| a.1.total_cmp(&b.1));
            match worst.filter(|(_, harm)| *harm > 0.0) {
                None => break Some(found),
                Some((row, _)) => {
                    rows[row].at.iter().filter(|&&at| at >= fixed.len()).for_each(|&at| takes_part[at] = false)
                }
            }
        };
        let from = completed.as_ref().unwrap_or(&plain);
        let built = if tested { self.built_up_beside((&rows, &columns), takes_part, from, missing)? } else { None };
        let completed = built.or(completed).map(|found| self.of_fitted(&rows, (&columns, fixed.len()), &found, noise));
        let delays = self.look.inputs.iter().map(|own| own.delay.max(0.0)).collect();
        Ok(Some(Nearby { left, stated, completed, delays }))
    }

    /// Takes friction that builds up after reversals among the terms, with its columns, and says which they are: that of every coordinate of
    /// second order whose row has an input, where the model has none.
    fn take_presliding(&mut self) -> Vec<usize> {
        let model = self.rows.model;
        let p = model.dims().parameters;
        let has = |c: usize| (0..model.dims().coordinates).any(|z| model.presliding(z).is_some_and(|own| own.of == c));
        let asked = |c: &usize| model.coordinate_order(*c) == 2 && self.scales.driven(*c) && !has(*c);
        let rows = moving(model).min(model.dims().rows);
        let terms: Vec<Term> = (0..rows)
            .filter(asked)
            .flat_map(|c| {
                TRAVELS.map(|parts| Term { kind: TermKind::Presliding(parts), row: Some(c), of: c, other: None })
            })
            .filter(|term| self.scales.constants(*term)[0] > RESOLVED * self.paths.measured[term.of].spectrum.noise)
            .collect();
        let first = self.terms.len();
        let mut from = 0.0;
        for (stretch, (path, along)) in self.paths.paths.iter().zip(&self.along).enumerate() {
            let seen = OnGrid { path, along, from };
            self.columns[stretch].extend(terms.iter().map(|term| self.scales.columns(*term, &seen)));
            from += path.points as f64 * path.apart;
        }
        self.terms.extend(&terms);
        self.sizes.extend(terms.iter().map(|_| 1.0));
        (p + first..p + self.terms.len()).collect()
    }

    /// What is fitted with friction that builds up after reversals; nothing where it makes no row better. `takes_part` says which columns are fitted
    /// without it, which gives `from`.
    fn built_up_beside(
        &self,
        (rows, columns): (&[RowBlocks], &[usize]),
        mut takes_part: Vec<bool>,
        from: &Fitted,
        missing: &[f64],
    ) -> Result<Option<Fitted>, EstimateError> {
        let p = self.rows.model.dims().parameters;
        let builds_up = |at: &usize| {
            let term = columns[*at].checked_sub(p).map(|i| self.terms[i]);
            term.is_some_and(|term| matches!(term.kind, TermKind::Presliding(_)))
        };
        let threshold = alarm::squared_normal(alarm::MISSING_TERM_RATE, (0..columns.len()).filter(builds_up).count());
        let mut found: Option<Fitted> = None;
        for (number, row) in rows.iter().enumerate() {
            let mut own: Vec<usize> = row.at.iter().copied().filter(|at| takes_part[*at]).collect();
            let mut asked: Vec<usize> = row.at.iter().copied().filter(builds_up).collect();
            let all: Vec<usize> = own.iter().chain(&asked).map(|&at| columns[at]).collect();
            let whole = if asked.is_empty() { None } else { self.whole_time(number, &all, missing)? };
            let Some((lines, noise)) = whole else { continue };
            let force: f64 = row.blocks.iter().map(|block| row.force(&block.inner)).sum();
            let places = |of: &[usize]| of.iter().map(|&at| columns[at]).collect::<Vec<usize>>();
            while let Some(best) =
                shown_beside((&lines, &noise), [places(&own), places(&asked)], self.right(), threshold)
            {
                let at = asked.remove(best);
                takes_part[at] = true;
                let before = &found.as_ref().unwrap_or(from).held_out[number];
                let better = fitted(rows, &takes_part).filter(|with| {
                    let less: Vec<f64> =
                        before.iter().zip(&with.held_out[number]).map(|(own, with)| own - with).collect();
                    let (mean, deviation) = mean_and_deviation(&less);
                    let still = share(with.held_out[number].iter().sum(), before.iter().sum());
                    let makes = share(less.len() as f64 * mean, force);
                    mean > LOWERS * deviation && makes > LEAST_SHARE && still < WORTH_A_STATE
                });
                takes_part[at] = better.is_some();
                if better.is_some() {
                    own.push(at);
                    found = better;
                }
            }
        }
        Ok(found)
    }

    /// The lines of a row over the whole time, reversals among it, and their noise with all of some columns in.
    fn whole_time(
        &self,
        row: usize,
        columns: &[usize],
        missing: &[f64],
    ) -> Result<Option<([RowLines; 1], Noise)>, EstimateError> {
        let right = self.right();
        let (signals, _) = self.signals(row, missing)?;
        let view = View { coordinate: None, ..self.views[row] };
        let Some(mut lines) = row_lines(&self.paths.paths, view, &signals) else { return Ok(None) };
        lines.take_power(lines.column(right));
        let lines = [lines];
        let noise = Noise::first(&lines, true).found(&lines, columns, right, None, None).0;
        Ok(Some((lines, noise)))
    }

    /// Replaces the columns of load friction by those of the load that these values of the parameters make: made of the recorded force, such a
    /// column would explain that force by itself. Says whether there are any.
    fn take_loads(&mut self, terms: &[usize], load: &[usize], values: &[f64]) -> bool {
        let p = self.rows.model.dims().parameters;
        let own = terms.iter().map(|column| column - p).filter(|&i| self.terms[i].kind == TermKind::LoadFriction);
        let own: Vec<usize> = own.collect();
        let mut from = 0.0;
        for (stretch, (path, along)) in self.paths.paths.iter().zip(&self.along).enumerate() {
            for &i in &own {
                let (term, size) = (self.terms[i], self.sizes[i]);
                let mut own = self.scales.load_friction(term, &OnGrid { path, along, from }, (load, values));
                own.iter_mut().flat_map(|(_, column)| column).for_each(|x| *x /= size);
                self.columns[stretch][i] = own;
            }
            from += path.points as f64 * path.apart;
        }
        !own.is_empty()
    }

    /// A row in parts of the record, with these columns.
    fn blocks(&self, row: usize, columns: &[usize], missing: &[f64]) -> Result<RowBlocks, EstimateError> {
        let (signals, _) = self.signals(row, missing)?;
        let view = self.views[row];
        let right = self.right();
        let at: Vec<usize> = (0..columns.len())
            .filter(|&at| signals.iter().any(|own: &Signals| own.iter().any(|(number, _)| *number == columns[at])))
            .collect();
        let n = at.len() + 1;
        let wave = 2.0 * PI / view.low_pass.cut_off;
        let parts: Vec<(DMatrix<f64>, f64)> = (self.paths.paths.iter().zip(&signals))
            .map(|(path, signals)| {
                let shares = view.shares(path);
                let step = ((wave / (SAMPLES * path.apart)) as usize).max(1);
                let places: Vec<usize> = path.valid(view.lost).step_by(step).collect();
                let mut matrix = DMatrix::zeros(places.len(), n);
                for (number, signal) in signals {
                    let own =
                        if *number == right { Some(n - 1) } else { at.iter().position(|&at| columns[at] == *number) };
                    let Some(own) = own else { continue };
                    let passed = View::passed(path, &shares, signal);
                    places.iter().enumerate().for_each(|(k, &place)| matrix[(k, own)] = passed[place]);
                }
                (matrix, step as f64 * path.apart)
            })
            .collect();
        let samples: usize = parts.iter().map(|(matrix, _)| matrix.nrows()).sum();
        let mut blocks: Vec<Block> =
            (0..BLOCKS).map(|_| Block { whole: DMatrix::zeros(n, n), inner: DMatrix::zeros(n, n) }).collect();
        let mut first = 0;
        for (matrix, apart) in &parts {
            let beside = (APART * view.low_pass.reach() / apart).ceil() as usize;
            for (b, block) in blocks.iter_mut().enumerate() {
                let (from, to) = (b * samples / BLOCKS, (b + 1) * samples / BLOCKS);
                let (from, to) =
                    (from.saturating_sub(first).min(matrix.nrows()), to.saturating_sub(first).min(matrix.nrows()));
                let products = |from: usize, to: usize| {
                    if from >= to {
                        return DMatrix::zeros(n, n);
                    }
                    let own = matrix.rows(from, to - from);
                    own.tr_mul(&own)
                };
                block.whole += products(from, to);
                block.inner += products(from + beside, to.saturating_sub(beside));
            }
            first += matrix.nrows();
        }
        let sum = blocks.iter().fold(DMatrix::zeros(n, n), |sum, block| sum + &block.whole);
        Ok(RowBlocks { at, blocks, sum, samples: samples as f64 })
    }

    /// Values of all parameters.
    fn values_of(&self, columns: &[usize], found: &Fitted) -> Vec<f64> {
        let mut values = self.theta.clone();
        for (&column, value) in columns.iter().zip(found.values.iter()) {
            if let Some(own) = values.get_mut(column) {
                *own = *value;
            }
        }
        values
    }

    /// What was fitted, in the units of the model; its covariance is that of these weights under the noise of the lines.
    fn of_fitted(
        &self,
        rows: &[RowBlocks],
        (columns, fixed): (&[usize], usize),
        found: &Fitted,
        noise: &Noise,
    ) -> Nearest {
        let p = self.rows.model.dims().parameters;
        let added = columns.iter().zip(found.values.iter()).skip(fixed).filter(|(_, value)| **value != 0.0);
        let terms = added.map(|(column, value)| {
            let (term, size) = (self.terms[column - p], self.sizes[column - p]);
            AddedTerm { term, value: *value / size, constants: self.scales.constants(term) }
        });
        let left = rows.iter().map(|row| share(row.left(&row.sum, &found.values), row.force(&row.sum))).collect();
        let held_out = (rows.iter().zip(&found.held_out))
            .map(|(row, own)| share(own.iter().sum(), row.blocks.iter().map(|block| row.force(&block.inner)).sum()))
            .collect();
        // What the lines do not have, since they leave reversals out, is no part of their noise either.
        let on_lines = |column: usize| column < p || !matches!(self.terms[column - p].kind, TermKind::Presliding(_));
        let taken: Vec<usize> = columns
            .iter()
            .zip(found.values.iter())
            .filter(|(column, value)| **value != 0.0 && on_lines(**column))
            .map(|(column, _)| *column)
            .collect();
        let own = self.covariance_of(&taken, &found.weights, noise);
        let mut covariance = DMatrix::zeros(p, p);
        for (a, &i) in taken.iter().enumerate().filter(|(_, column)| **column < p) {
            for (b, &j) in taken.iter().enumerate().filter(|(_, column)| **column < p) {
                covariance[(i, j)] = own[(a, b)];
            }
        }
        Nearest {
            values: self.values_of(columns, found),
            covariance: Matrix::of(covariance),
            terms: terms.collect(),
            left,
            held_out,
        }
    }

    /// Covariance of least squares over columns with one weight for every row, under the noise of the lines.
    fn covariance_of(&self, columns: &[usize], weights: &[f64], noise: &Noise) -> DMatrix<f64> {
        let n = columns.len();
        let (mut whole, mut middle) = (DMatrix::<f64>::zeros(n, n), DMatrix::<f64>::zeros(n, n));
        for ((row, variance), weight) in self.lines.iter().zip(&noise.variance).zip(weights) {
            let mut by_noise: Vec<f64> =
                variance.iter().map(|variance| weight * (row.correlation * variance).sqrt()).collect();
            by_noise.extend_from_within(..);
            let (at, plain) = row.weighted(columns, &vec![weight.sqrt(); by_noise.len()]);
            let (_, noisy) = row.weighted(columns, &by_noise);
            let (plain, noisy) = (plain.tr_mul(&plain), noisy.tr_mul(&noisy));
            for (a, &i) in at.iter().enumerate() {
                for (b, &k) in at.iter().enumerate() {
                    whole[(i, k)] += plain[(a, b)];
                    middle[(i, k)] += noisy[(a, b)];
                }
            }
        }
        let Some(inverse) = Scaled::of(&whole, RIDGE).map(|own| own.inverse()) else { return DMatrix::zeros(n, n) };
        &inverse * middle * &inverse
    }
}

/// What is left of a force, as a share of it, given sums of squares.
fn share(left: f64, force: f64) -> f64 {
    if force > 0.0 { (left / force).max(0.0).sqrt() } else { 0.0 }
}

/// Mean of values, and the deviation of this mean.
fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let spread = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (spread / n).sqrt())
}
