//! The optimum of the likelihood of a record, from a start on, with or without terms that the model may lack.
//!
//! Gauss and Newton's steps on motion and parameters together (a free state at every reading: multiple shooting), in which the noise is found
//! by the likelihood with the parameters integrated out, and terms enter as variance components of the triangle that the readings leave.

use crate::likelihood::{Components, Products, Solved, Split, Term, TermKind};
use crate::output_error::{Half, OutputErrorFault};
use crate::simulation::chain::Chain;
use crate::simulation::filter::{smooth, whiten};
use crate::simulation::noise::{Curvature, FirstOrder, Noise, most_likely};
use crate::simulation::problem::{Column, Point, Problem};
use crate::simulation::record::Reading;
use crate::simulation::terms::Library;
use crate::simulation::triangle::Triangle;
use tpm_numerics::{Cholesky, DMatrix, alarm, patience, root_mean_square};

/// The numbers of the iteration.
pub(super) struct Params {
    /// Most passes.
    pub(super) passes: usize,
    /// Passes in which a parameter moves by [`longest_step`](Self::longest_step) of itself at most, or by five deviations.
    pub(super) near: usize,
    pub(super) longest_step: f64,
    /// Settled when no parameter moves by more than this share of its deviation, and the cost by no more than this.
    pub(super) settled: f64,
    pub(super) settled_cost: f64,
    /// Most steps of the search for the noise in the first pass, and in later ones.
    pub(super) searched: [usize; 2],
}

/// Found on simulated machines: two passes settle a right model, twelve one that begins wrong by a factor of 300.
pub(super) const PARAMS: Params =
    Params { passes: 14, near: 8, longest_step: 0.6, settled: 0.15, settled_cost: 1.0, searched: [12, 6] };

/// Share of the force of a row that the noise of its force is taken for at first.
const FIRST_FORCE_NOISE: f64 = 0.03;
/// Share of that variance below which no noise of a force falls while all else still moves: from nothing at all no slope leads back.
const LEAST_LIFTED: f64 = 1e-4;
/// Share of a sensor's white noise, and samples, that its coloured noise is taken for at first.
const FIRST_COLOUR: (f64, f64) = (0.3, 10.0);
/// Least factor on the variance that a sensor states.
const LEAST_WHITE: f64 = 1e-4;
/// A named term makes at least this share of the force of its row; a delay this share of a sample.
const LEAST_SHARE: f64 = 0.003;
const LEAST_DELAY: f64 = 0.1;
/// Blocks, and instants of all of them, along which the noise is looked for: 3,000 readings tell a deviation to 1.3 %.
const SEARCHED: (usize, usize) = (4, 3_000);
/// Longest delay that is looked for, s.
const LONGEST_DELAY: f64 = 0.06;
/// Deviations of a parameter that a step may have at least.
const NEAR: f64 = 5.0;
/// Weight of directions that the data do not show, in units of the columns.
const HELD: f64 = 1e3;

/// What is asked of a fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct How {
    /// Whether terms may enter.
    pub(super) terms: bool,
    /// Share of a candidate's length that others must leave of it.
    pub(super) guard: f64,
    /// Whether the noise of the forces is looked for.
    pub(super) forces: bool,
}

impl How {
    /// The model alone.
    pub(super) const fn plain(guard: f64) -> Self {
        How { terms: false, guard, forces: true }
    }

    /// With terms that the model may lack.
    pub(super) const fn with_terms(guard: f64) -> Self {
        How { terms: true, guard, forces: true }
    }
}

/// A number that is estimated beside the parameters, however large it is.
#[derive(Clone, Debug)]
pub(super) struct Fixed {
    pub(super) term: Term,
    pub(super) value: f64,
    /// What it does to readings, for play.
    pub(super) directions: Vec<f64>,
}

/// A term that takes part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Active {
    pub(super) term: Term,
    pub(super) value: f64,
    /// Variance of its coefficient before the record, and after it.
    pub(super) prior: f64,
    pub(super) variance: f64,
    /// Share of its row's force.
    pub(super) share: f64,
}

/// What the iteration changes.
#[derive(Clone)]
pub(super) struct State {
    pub(super) point: Point,
    pub(super) noise: Noise,
    pub(super) fixed: Vec<Fixed>,
    pub(super) active: Vec<Active>,
}

/// An optimum.
#[derive(Clone)]
pub(super) struct Reached {
    pub(super) state: State,
    /// Twice the negative logarithm of the likelihood, but for a constant that all optima of a record share.
    pub(super) cost: f64,
    /// Covariance of the free parameters, and behind them of the fixed numbers.
    pub(super) covariance: DMatrix<f64>,
    /// Whether the steps became small.
    pub(super) settled: bool,
    pub(super) passes: usize,
}

/// A record with everything that a fit needs.
pub(super) struct Fit<'a> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) library: &'a Library,
    /// Directions of the free parameters that the data do not show.
    pub(super) hidden: &'a [Vec<f64>],
}

/// A record linearised about a state, with the columns of candidates.
struct Look {
    chain: Chain,
    candidates: Vec<Term>,
    columns: Vec<Column>,
    /// Values of all columns as they stand.
    now: Vec<f64>,
    /// Columns before the candidates.
    fixed: usize,
}

/// Rows and what they say.
struct Weighed {
    solved: Solved,
    variance: Vec<f64>,
    cost: f64,
}

impl Fit<'_> {
    /// The noise from which a fit begins: forces of which little is known.
    pub(super) fn first_noise(&self) -> Noise {
        let sensors = &self.problem.record.sensors;
        let step = self.problem.instants.usual_step;
        Noise {
            white: vec![1.0; sensors.len()],
            least: sensors.iter().map(|own| if own.counted { 1.0 } else { LEAST_WHITE }).collect(),
            colour: None,
            force: self.library.forces.iter().map(|force| (FIRST_FORCE_NOISE * force).powi(2) * step).collect(),
            drift: None,
        }
    }

    fn look(&self, state: &State, candidates: Vec<Term>) -> Result<Look, OutputErrorFault> {
        let Fit { problem, library, .. } = self;
        let mut columns: Vec<Column> = Vec::with_capacity(state.fixed.len() + candidates.len());
        for own in &state.fixed {
            columns.push(match own.term.kind {
                TermKind::Backlash => Column::Reading(problem.sensor(own.term.of).unwrap_or(0), own.directions.clone()),
                TermKind::Limit => problem.edge(&state.point, own.term.of)?,
                _ => Column::Delay(own.term.of),
            });
        }
        columns.extend(library.columns(problem, &state.point, &candidates)?);
        let in_flow = |own: &Fixed| own.term.kind != TermKind::Backlash;
        let active = |term: &Term| state.active.iter().find(|own| own.term == *term).map_or(0.0, |own| own.value);
        let included: Vec<f64> = state
            .fixed
            .iter()
            .map(|own| if in_flow(own) { 0.0 } else { own.value })
            .chain(candidates.iter().map(active))
            .collect();
        let chain = problem.linearise(&state.point, &columns, &included)?;
        let parameters = problem.free.iter().map(|&j| state.point.theta[j]);
        let now = parameters.chain(state.fixed.iter().map(|own| own.value)).chain(candidates.iter().map(active));
        let now = now.collect();
        Ok(Look { chain, candidates, columns, now, fixed: problem.free.len() + state.fixed.len() })
    }

    /// The triangle of some columns, whose values are absolute, and the sum of the logarithms of the innovations' variances.
    fn triangle(
        &self,
        (look, chain): (&Look, &Chain),
        noise: &Noise,
        columns: &[usize],
        sizes: &[f64],
    ) -> (DMatrix<f64>, f64) {
        let whitened = whiten(chain, noise, columns);
        let [first, second] = whitened.halves;
        let mut triangle = first.with(&second);
        let width = columns.len() + 1;
        for direction in self.hidden {
            // A row without a right-hand side: along this direction nothing moves.
            let own = |j: usize| direction.get(j).copied().unwrap_or(0.0) * sizes.get(j).copied().unwrap_or(1.0);
            let norm = (0..self.problem.free.len()).map(|j| own(j).powi(2)).sum::<f64>().sqrt();
            let mut row = vec![0.0; width];
            (0..self.problem.free.len()).for_each(|j| row[j] = HELD * own(j) / norm.max(f64::MIN_POSITIVE));
            triangle.take(&row);
        }
        let mut square = triangle.square();
        for (at, &column) in columns.iter().enumerate() {
            let value = look.now[column];
            if value != 0.0 {
                let own = square.column(at) * value;
                let mut right = square.column_mut(width - 1);
                right += own;
            }
        }
        (square, whitened.logs)
    }

    /// The cost with given variances of the coefficients of some candidates.
    fn cost(
        &self,
        (look, chain): (&Look, &Chain),
        noise: &Noise,
        (taken, variance): (&[usize], &[f64]),
        sizes: &[f64],
    ) -> f64 {
        let columns: Vec<usize> = (0..look.fixed).chain(taken.iter().map(|i| look.fixed + i)).collect();
        let (square, logs) = self.triangle((look, chain), noise, &columns, sizes);
        let (flat, last, n) = (look.fixed, columns.len(), taken.len());
        let root = |i: usize| 2.0 * square[(i, i)].abs().max(f64::MIN_POSITIVE).ln();
        let factor = square.view((flat, flat), (n, n));
        let target = square.view((flat, last), (n, 1)).column(0).into_owned();
        let scaled = DMatrix::from_fn(n, n, |r, c| factor[(r, c)] * variance[c].sqrt());
        let Some(whole) = Cholesky::new(DMatrix::identity(n, n) + &scaled * scaled.transpose()) else {
            return f64::INFINITY;
        };
        let of_terms =
            whole.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>() + target.dot(&whole.solve(&target));
        let cost = logs + (0..flat).map(root).sum::<f64>() + square[(last, last)].powi(2) + of_terms;
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// The cost of a state as it stands, with the parameters of any size.
    ///
    /// # Errors
    /// [`OutputErrorFault`] when the model cannot be evaluated.
    pub(super) fn cost_at(&self, state: &State) -> Result<f64, OutputErrorFault> {
        let look = self.look(state, Vec::new())?;
        Ok(self.cost((&look, &look.chain), &state.noise, (&[], &[]), &[]))
    }

    /// Parameters and terms that a record shows about a point.
    fn weigh(&self, look: &Look, noise: &Noise, how: How, sizes: &[f64]) -> Result<Weighed, OutputErrorFault> {
        let count = look.candidates.len();
        let columns: Vec<usize> = (0..look.fixed + count).collect();
        let (square, logs) = self.triangle((look, &look.chain), noise, &columns, sizes);
        let width = square.ncols();
        let guards = vec![how.guard; count];
        let split = Split::new(&square.view((0, 0), (width - 1, width)).into_owned(), look.fixed, &guards);
        let threshold = alarm::squared_normal(alarm::MISSING_COMPONENT_RATE, self.library.terms.len());
        let products = Products::of(&split.candidates, &split.target, &guards);
        let found = Components::found(&products, threshold);
        let solved = split.solve(&found.variance).ok_or(OutputErrorFault::Singular)?;
        let roots: f64 = (0..look.fixed).map(|i| 2.0 * square[(i, i)].abs().max(f64::MIN_POSITIVE).ln()).sum();
        let left = square[(width - 1, width - 1)].powi(2) + split.target.norm_squared();
        Ok(Weighed { cost: logs + roots + left + found.value(), variance: found.variance, solved })
    }

    /// Goes to the optimum.
    ///
    /// # Errors
    /// [`OutputErrorFault`] when the model cannot be evaluated on the way, or the record does not show the parameters.
    pub(super) fn settle(&self, begun: State, how: How) -> Result<Reached, OutputErrorFault> {
        let mut state = begun;
        let (mut before, mut sizes) = (f64::INFINITY, Vec::<f64>::new());
        let mut curvature = Curvature::default();
        // Whether all candidates are asked for in the next pass; between, only those that take part are.
        let mut wide = true;
        // Whether the parameters still move.
        let mut far = false;
        // Whether the noise is looked for along the whole record, which it is once all else stands still.
        let mut whole = false;
        // The lowest place at which the terms that take part stood still, from which all candidates are asked for.
        let mut rest: Option<Reached> = None;
        for pass in 0..PARAMS.passes {
            if patience::is_over() {
                return Err(OutputErrorFault::Ended);
            }
            if far {
                state.noise.lift(&self.first_noise(), LEAST_LIFTED);
            }
            let look = self.look(&state, self.candidates(&state, how, wide))?;
            if sizes.is_empty() {
                let (square, _) =
                    self.triangle((&look, &look.chain), &state.noise, &(0..look.fixed).collect::<Vec<_>>(), &[]);
                sizes = (0..look.fixed).map(|j| square.column(j).norm()).collect();
            }
            state.noise = self.noise(&look, &state, (how, pass, whole), (&sizes, &mut curvature));
            let weighed = self.weigh(&look, &state.noise, how, &sizes)?;
            let terms_before: Vec<Term> = state.active.iter().map(|own| own.term).collect();
            let fixed_before = state.fixed.len();
            let moved = self.step(&mut state, &look, &weighed, pass)?;
            far = moved > 1.0;
            let still = moved < PARAMS.settled && (before - weighed.cost).abs() < PARAMS.settled_cost;
            before = weighed.cost;
            let same = state.fixed.len() == fixed_before
                && state.active.len() == terms_before.len()
                && state.active.iter().all(|own| terms_before.contains(&own.term));
            let reached = |state: &State| Reached {
                cost: weighed.cost,
                covariance: weighed.solved.covariance.clone(),
                settled: !far,
                passes: pass + 1,
                state: state.clone(),
            };
            if pass + 1 == PARAMS.passes && rest.is_none() {
                return Ok(reached(&state));
            }
            if still && pass > 0 && same {
                if whole && (wide || !how.terms) {
                    return Ok(reached(&state));
                }
                if whole {
                    // All candidates were asked for from a place like this before, and led back to it.
                    if rest.as_ref().is_some_and(|rest| weighed.cost > rest.cost - alarm::LIKELIHOOD_GAIN) {
                        break;
                    }
                    rest = Some(reached(&state));
                }
                // Once the terms that take part stand still, all are asked for once more.
                wide = whole;
                whole = true;
                continue;
            }
            (wide, whole) = (false, whole && !far);
        }
        rest.ok_or(OutputErrorFault::NotConverged { steps: PARAMS.passes })
    }

    /// The noise with which a record is most likely, as far as a pass looks for it: along blocks, and `whole` along all of it.
    fn noise(
        &self,
        look: &Look,
        state: &State,
        (how, pass, whole): (How, usize, bool),
        (sizes, curvature): (&[f64], &mut Curvature),
    ) -> Noise {
        let place = |own: &Active| look.candidates.iter().position(|term| *term == own.term);
        let taken: Vec<usize> = state.active.iter().filter_map(place).collect();
        let prior: Vec<f64> = state.active.iter().map(|own| own.prior).collect();
        let part = if whole { None } else { look.chain.blocks(SEARCHED.0, SEARCHED.1) };
        let chain = part.as_ref().unwrap_or(&look.chain);
        let cost = |noise: &Noise| self.cost((look, chain), noise, (&taken, &prior), sizes);
        let steps = PARAMS.searched[usize::from(pass > 0)];
        let (noise, least) = most_likely(state.noise.clone(), how.forces, steps, curvature, &cost);
        if pass > 0 || state.noise.colour.is_some() || !how.forces {
            return noise;
        }
        let mut other = Curvature::default();
        let (coloured, with) = most_likely(self.coloured(&state.noise), how.forces, steps, &mut other, &cost);
        if with < least - alarm::LIKELIHOOD_GAIN {
            *curvature = other;
            return coloured;
        }
        noise
    }

    /// The candidates of a pass.
    fn candidates(&self, state: &State, how: How, wide: bool) -> Vec<Term> {
        if !how.terms {
            return Vec::new();
        }
        let applied = |term: &Term| state.fixed.iter().any(|own| own.term == *term);
        let active = |term: &Term| state.active.iter().any(|own| own.term == *term);
        self.library.terms.iter().copied().filter(|term| !applied(term) && (wide || active(term))).collect()
    }

    /// What either half of the readings asks of the parameters, beside the terms that take part.
    ///
    /// # Errors
    /// [`OutputErrorFault`] when the model cannot be evaluated.
    pub(super) fn halves(&self, reached: &Reached) -> Result<Vec<Half>, OutputErrorFault> {
        let state = &reached.state;
        let look = self.look(state, state.active.iter().map(|own| own.term).collect())?;
        let columns: Vec<usize> = (0..look.now.len()).collect();
        let of = |triangle: Triangle| -> Option<Vec<(f64, f64)>> {
            let (width, square) = (columns.len() + 1, triangle.square());
            let split = Split::new(&square.view((0, 0), (width - 1, width)).into_owned(), width - 1, &[]);
            let solved = split.solve(&[])?;
            Some((0..self.problem.free.len()).map(|j| (solved.values[j], solved.covariance[(j, j)])).collect())
        };
        let [first, second] = whiten(&look.chain, &state.noise, &columns).halves;
        let (Some(first), Some(second)) = (of(first), of(second)) else { return Ok(Vec::new()) };
        let half = |((one, own), (other, beside)): (&(f64, f64), &(f64, f64))| Half {
            moved: other - one,
            variance: own + beside,
        };
        Ok(first.iter().zip(&second).map(half).collect())
    }

    /// A noise whose sensors have a colour, too.
    fn coloured(&self, noise: &Noise) -> Noise {
        let of = |(s, sensor): (usize, &Reading)| {
            let count = sensor.variance.len().max(1) as f64;
            FIRST_COLOUR.0 * noise.white[s] * sensor.variance.iter().sum::<f64>() / count
        };
        let variance = self.problem.record.sensors.iter().enumerate().map(of).collect();
        let time = FIRST_COLOUR.1 * self.problem.instants.usual_step;
        Noise { colour: Some(FirstOrder { variance, time }), ..noise.clone() }
    }

    /// Moves parameters, terms and motion; returns the largest move of a parameter in its deviations.
    fn step(&self, state: &mut State, look: &Look, weighed: &Weighed, pass: usize) -> Result<f64, OutputErrorFault> {
        let free = &self.problem.free;
        let Weighed { solved, variance, .. } = weighed;
        let mut steps = vec![0.0; look.now.len()];
        let mut largest = 0.0_f64;
        for (at, &j) in free.iter().enumerate() {
            let deviation = solved.covariance[(at, at)].max(0.0).sqrt();
            let wanted = solved.values[at] - look.now[at];
            let most = if pass < PARAMS.near {
                (PARAMS.longest_step * look.now[at].abs()).max(NEAR * deviation)
            } else {
                f64::INFINITY
            };
            steps[at] = wanted.clamp(-most, most);
            largest = largest.max(steps[at].abs() / deviation.max(f64::MIN_POSITIVE));
            state.point.theta[j] += steps[at];
        }
        for (i, own) in state.fixed.iter_mut().enumerate() {
            let at = free.len() + i;
            let wanted = solved.values[at] - look.now[at];
            let (low, high) = match own.term.kind {
                TermKind::Delay => (state.point.least_delay(self.problem), LONGEST_DELAY),
                TermKind::Limit => (0.5 * own.value, 2.0 * own.value),
                _ => (f64::NEG_INFINITY, f64::INFINITY),
            };
            let next = (own.value + wanted).clamp(low, high);
            steps[at] = next - own.value;
            own.value = next;
            match own.term.kind {
                TermKind::Delay => state.point.delays[own.term.of] = next,
                TermKind::Limit => state.point.limits[own.term.of] = next,
                _ => {}
            }
        }
        let usual = self.problem.instants.usual_step;
        let mut active = Vec::new();
        for (i, term) in look.candidates.iter().enumerate() {
            let at = look.fixed + i;
            let value = solved.missing[i];
            let wanted = if variance[i] > 0.0 { value } else { 0.0 };
            steps[at] = wanted - look.now[at];
            if variance[i] <= 0.0 {
                continue;
            }
            let own = Active {
                term: *term,
                value,
                prior: variance[i],
                variance: solved.of_terms[i],
                share: self.library.share(&look.columns[at - free.len()], value),
            };
            if term.kind == TermKind::Delay {
                if value.abs() > LEAST_DELAY * usual {
                    // From here on the input acts later, and by how much is a number like the parameters.
                    let least = state.point.least_delay(self.problem);
                    let next = (state.point.delays[term.of] + value).clamp(least, LONGEST_DELAY);
                    state.point.delays[term.of] = next;
                    state.fixed.push(Fixed { term: *term, value: next, directions: Vec::new() });
                } else {
                    steps[at] = 0.0 - look.now[at];
                }
                continue;
            }
            active.push(own);
        }
        state.active = active;
        let smoothed = smooth(&look.chain, &state.noise, &steps);
        if smoothed.states.iter().any(|value| !value.is_finite()) {
            return Err(OutputErrorFault::Unbounded);
        }
        state.point.states.iter_mut().zip(&smoothed.states).for_each(|(state, step)| *state += step);
        Ok(largest)
    }
}

impl Reached {
    /// Terms that stand out, the clearest first, with their value, deviation and the square of their standardised size.
    pub(super) fn named(&self, fit: &Fit<'_>) -> Vec<(Term, f64, f64, f64)> {
        let usual = fit.problem.instants.usual_step;
        let free = fit.problem.free.len();
        let mut named: Vec<(Term, f64, f64, f64)> = Vec::new();
        for (i, own) in self.state.fixed.iter().enumerate() {
            let variance = self.covariance[(free + i, free + i)].max(0.0);
            let told = own.term.kind != TermKind::Delay || own.value.abs() > LEAST_DELAY * usual;
            let shown = own.value * own.value / variance.max(f64::MIN_POSITIVE);
            if told {
                named.push((own.term, own.value, variance.sqrt(), shown));
            }
        }
        let threshold = alarm::squared_normal(alarm::MISSING_COMPONENT_RATE, fit.library.terms.len());
        for own in &self.state.active {
            let shown = own.value * own.value / own.variance.max(f64::MIN_POSITIVE);
            if shown > threshold && own.share > LEAST_SHARE {
                named.push((own.term, own.value, own.variance.max(0.0).sqrt(), shown));
            }
        }
        named.sort_by(|a, b| b.3.total_cmp(&a.3));
        named
    }

    /// Force of every row that the noise of forces makes, root mean square as a share of the row's force.
    pub(super) fn force_left(&self, fit: &Fit<'_>) -> Result<Vec<f64>, OutputErrorFault> {
        let look = fit.look(&self.state, self.state.active.iter().map(|own| own.term).collect())?;
        let chain = &look.chain;
        let of = |row: usize| {
            let forces = (0..chain.instants().saturating_sub(1)).filter(|&k| !chain.begins[k + 1]).filter_map(|k| {
                let loose = &chain.loose[k * chain.switches..(k + 1) * chain.switches];
                if loose.iter().any(|size| *size > 0.0) {
                    return None;
                }
                let (mut with, mut own) = (0.0, 0.0);
                for (defect, force) in chain.defect(k).iter().zip(chain.forced(k, chain.columns + row)) {
                    with += defect * force;
                    own += force * force;
                }
                (own > 0.0).then(|| with / own)
            });
            root_mean_square(forces) / fit.library.forces[row].max(f64::MIN_POSITIVE)
        };
        Ok((0..chain.rows).map(of).collect())
    }
}
