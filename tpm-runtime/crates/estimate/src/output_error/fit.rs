//! The fit of a record: noise, parameters and motion first, then what is left.

use crate::output_error::candidates::CandidateKind;
use crate::output_error::clipping::{self, Limit, Promising};
use crate::output_error::error::OutputErrorFault;
use crate::output_error::misfit::{self, Examined, Misfit};
use crate::output_error::noise::Noise;
use crate::output_error::problem::{Differentiable, Problem, Trajectory};
use crate::output_error::rates::{self, RateUse};
use crate::output_error::signals::Signals;
use crate::output_error::smoother::Smoothed;
use crate::output_error::solution::Solution;
use crate::output_error::state::State;
use std::ops::Range;
use tpm_numerics::{DMatrix, alarm, root_mean_square};

/// How often the distance between limits that are tried is halved about the most likely one.
const LIMIT_HALVINGS: usize = 6;
/// Limits of an input that are weighed on either side of the most likely one.
const LIMITS_PER_SIDE: i32 = 20;
/// How far the limits that are weighed reach from the most likely one, in deviations by the curvature there.
const LIMITS_REACH: f64 = 6.0;
/// Samples of a record by which limits are told from each other, and from none, before the whole of it is asked.
const LIMIT_SAMPLES: usize = 16_000;

/// Parameters that explain every sample of a record.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OutputError {
    /// Value of every parameter, in the model's units.
    pub values: Vec<f64>,
    /// Covariance of the free parameters from noise alone, in the order of `free`.
    covariance: DMatrix<f64>,
    /// Indices of the parameters that were estimated.
    pub free: Vec<usize>,
    /// Gauss-Newton steps that were made; nothing where they did not settle on parameters with the model as it is, so that the values
    /// are those from which they began.
    pub iterations: Option<usize>,
    /// Standard deviation of every sensor's noise as it was found, unit of the coordinate.
    pub sensor_noise: Vec<f64>,
    /// Standard deviation of the noise of every recorded input, unit of the input; zero where the record is taken as exact.
    pub input_noise: Vec<f64>,
    /// Correlation of each sensor's noise from one sample to the next.
    pub colour: Vec<f64>,
    /// What every measured rate is to the fit.
    pub rates: Vec<RateUse>,
    /// Root mean square of measured less simulated motion, unit of the coordinate.
    pub residual: Vec<f64>,
    /// What is not explained, as a share: the largest of that residual beside the motion, and of what the inputs are taken to have
    /// been beside what was recorded.
    pub share: f64,
    /// What the model leaves unexplained.
    pub misfit: Misfit,
}

impl OutputError {
    /// Covariance of two free parameters, by their places in `free`, from noise alone; nothing beyond them.
    #[must_use]
    pub fn covariance(&self, one: usize, other: usize) -> Option<f64> {
        self.covariance.get((one, other)).copied()
    }

    /// Fits the free parameters of a model to a record, from given values on.
    ///
    /// # Errors
    /// [`OutputErrorFault`].
    pub fn fit(
        machine: Differentiable<'_>,
        constants: &[f64],
        signals: &Signals<'_>,
        start: &[f64],
        free: &[usize],
        hidden: &[Vec<f64>],
    ) -> Result<Self, OutputErrorFault> {
        let (signals, rates, start) = rates::trusted(machine, constants, signals, start, free, hidden);
        let signals = &signals;
        let noise = signals.noise();
        let mut problem = Problem::new(machine, constants, signals, &noise, free, hidden)?;
        let begun = State::begun(&problem, signals, noise, &start);
        problem.steps = problem.needed_steps(&begun.trajectory, &begun.theta)?;
        let whole = fitted(&problem, signals, begun.clone());
        let exact = whole.as_ref().is_ok_and(|fitted| fitted.iterations.is_some() && fitted.state.noise.is_plain());
        let limited = if exact { None } else { most_likely_limit(&problem, signals, &begun, whole.as_ref().ok())? };
        let limited = limited.and_then(|state| fitted(&problem, signals, state).ok());
        let least = whole.as_ref().map_or(f64::INFINITY, |fitted| fitted.examined.cost);
        let Fitted { mut state, iterations, mut examined } = match limited {
            Some(limited) if limited.knows_its_limit() && limited.examined.cost < least - alarm::LIKELIHOOD_GAIN => {
                limited
            }
            _ => whole?,
        };
        over_limits(&problem, &mut state, &mut examined)?;
        let outputs = problem.sensors.len();
        let residual: Vec<f64> = (0..signals.coordinates.len())
            .map(|c| root_mean_square(examined.errors.iter().skip(c).step_by(outputs).copied()))
            .collect();
        let by_motion = residual.iter().zip(&signals.coordinates).map(|(left, signal)| left / spread(signal));
        let inputs = signals.inputs.len();
        let by_input = signals.inputs.iter().enumerate().map(|(i, input)| {
            let taken: Vec<f64> = state.trajectory.disturbed.iter().skip(i).step_by(inputs).copied().collect();
            spread(&taken) / spread(input)
        });
        let share = by_motion.chain(by_input).filter(|share| share.is_finite()).fold(0.0, f64::max);
        let scale = examined.misfit.scale;
        Ok(OutputError {
            share,
            values: state.theta,
            covariance: examined.covariance,
            free: free.to_vec(),
            iterations,
            sensor_noise: signals.sensor_noise(&problem.scale, scale),
            input_noise: state.noise.inputs.iter().map(|sigma| sigma * scale.sqrt()).collect(),
            colour: state.noise.colour.into_iter().take(signals.coordinates.len()).collect(),
            rates,
            residual,
            misfit: examined.misfit,
        })
    }
}

/// A state that has settled, or where it began when nothing but further terms let it settle, with what it leaves.
struct Fitted {
    state: State,
    iterations: Option<usize>,
    examined: Examined,
}

impl Fitted {
    /// Whether the record tells how large the limit of the input is.
    fn knows_its_limit(&self) -> bool {
        let at = self.examined.covariance.ncols() - 1;
        let deviation = self.examined.covariance[(at, at)].sqrt();
        self.state.limit.as_ref().is_some_and(|limit| alarm::LIMIT_SHOWN * deviation < limit.size)
    }
}

/// Settles a state and examines it.
fn fitted(problem: &Problem<'_>, signals: &Signals<'_>, begun: State) -> Result<Fitted, OutputErrorFault> {
    let mut state = begun.clone();
    let settled = if state.limit.is_some() {
        // Noise of the inputs would pass for a limit that is not yet right.
        state.settle(problem, signals, false).and_then(|_| state.settle(problem, signals, true))
    } else {
        state.settle(problem, signals, true)
    };
    if settled.is_err() {
        // Terms that are missing may be what keeps the parameters from settling; they are looked for where the fit began.
        state = State { noise: state.noise, ..begun };
    }
    let examined = misfit::examine(problem, signals, &state)?;
    match settled {
        Ok(iterations) => Ok(Fitted { state, iterations: Some(iterations), examined }),
        Err(_) if examined.settles => Ok(Fitted { state, iterations: None, examined }),
        Err(fault) => Err(fault),
    }
}

/// The state with the limit of an input that is most likely, of a long record by the part with the largest inputs; nothing where even that one
/// is less likely than what was fitted without a limit. The state need not be settled.
fn most_likely_limit(
    problem: &Problem<'_>,
    signals: &Signals<'_>,
    begun: &State,
    without: Option<&Fitted>,
) -> Result<Option<State>, OutputErrorFault> {
    let doubtful = without.is_none_or(|without| without.state.noise.inputs.iter().any(|sigma| *sigma > 0.0));
    let Promising { limits, fast } = clipping::promising(problem, signals, &begun.theta, doubtful)?;
    if limits.is_empty() {
        return Ok(None);
    }
    let samples = strongest(&problem.inputs, LIMIT_SAMPLES);
    let part = problem.part(samples.clone());
    let partly = begun.part(problem, samples.clone());
    let within = |(limit, theta): &(Limit, Vec<f64>)| (limit.part(samples.clone()), theta.clone());
    let tried: Vec<(Limit, Vec<f64>)> = limits.iter().map(within).collect();
    let state = match without {
        None => nearest_limit(&part, &partly, &tried)?,
        Some(without) => {
            let without = without.state.part(problem, samples);
            let mut starts = vec![(begun.theta.clone(), tried)];
            if fast {
                // Of such motion the parameters that were fitted without a limit are nearer than those of the regression.
                let limits = starts[0].1.iter().map(|(limit, _)| (limit.clone(), without.theta.clone())).collect();
                starts.push((without.theta.clone(), limits));
            }
            let mut least = cost(&part, &without, &without.noise)? - alarm::LIKELIHOOD_GAIN;
            let mut best = None;
            for (theta, limits) in starts {
                let begun = State { theta, ..partly.clone() };
                let Some(mut state) = nearest_limit(&part, &begun, &limits)? else { continue };
                if state.settle(&part, signals, false).is_err() {
                    continue;
                }
                // Coloured noise was found on the way to what was fitted without a limit.
                let own = cost(&part, &state, &state.noise)?.min(cost(&part, &state, &without.noise)?);
                if own < least {
                    (least, best) = (own, Some(state));
                }
            }
            best
        }
    };
    let Some(state) = state else { return Ok(None) };
    if part.samples() == problem.samples() {
        return Ok(Some(state));
    }
    let State { theta, limit: Some(found), .. } = state else { return Ok(None) };
    let Some((limit, _)) = limits.into_iter().find(|(limit, _)| limit.input == found.input) else { return Ok(None) };
    let limit = Limit { size: found.size, ..limit };
    let trajectory = Trajectory { applied: Some(limit.applied(&problem.inputs)), ..begun.trajectory.clone() };
    Ok(Some(State { trajectory, theta, limit: Some(limit), ..begun.clone() }))
}

/// The state with the most likely of limits that are tried along the measured motion, each with its parameters; nothing where none is likelier
/// than no limit along the same motion.
fn nearest_limit(
    problem: &Problem<'_>,
    begun: &State,
    tried: &[(Limit, Vec<f64>)],
) -> Result<Option<State>, OutputErrorFault> {
    let limited = |limit: Limit, theta: &[f64]| -> Result<(f64, State), OutputErrorFault> {
        let trajectory = Trajectory { applied: Some(limit.applied(&problem.inputs)), ..begun.trajectory.clone() };
        let state = State { trajectory, theta: theta.to_vec(), limit: Some(limit), ..begun.clone() };
        Ok((cost(problem, &state, &state.noise)?, state))
    };
    let mut best: Option<(f64, State, &Limit)> = None;
    for (limit, theta) in tried {
        let (cost, state) = limited(limit.clone(), theta)?;
        if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
            best = Some((cost, state, limit));
        }
    }
    let Some((mut least, mut state, limit)) = best else { return Ok(None) };
    // Limits were tried far apart, and the likelihood of the right one is sharp.
    let (mut size, mut factor) = (limit.size, clipping::ratio());
    for _ in 0..LIMIT_HALVINGS {
        factor = factor.sqrt();
        for nearer in [size * factor, size / factor] {
            let (cost, other) = limited(Limit { size: nearer, ..limit.clone() }, &state.theta)?;
            if cost < least {
                (size, least, state) = (nearer, cost, other);
            }
        }
    }
    let unlimited = cost(problem, begun, &begun.noise)?;
    Ok((least < unlimited - alarm::LIKELIHOOD_GAIN).then_some(state))
}

/// So many samples, at most, where the inputs are largest, each beside its mean square.
pub(super) fn strongest(inputs: &[&[f64]], most: usize) -> Range<usize> {
    let samples = inputs.first().map_or(0, |input| input.len());
    let length = most.min(samples);
    let powers: Vec<f64> =
        inputs.iter().map(|input| root_mean_square(input.iter().copied()).powi(2).max(f64::MIN_POSITIVE)).collect();
    let at = |k: usize| inputs.iter().zip(&powers).map(|(input, power)| input[k].powi(2) / power).sum::<f64>();
    let mut sum: f64 = (0..length).map(at).sum();
    let (mut largest, mut from) = (sum, 0);
    for k in length..samples {
        sum += at(k) - at(k - length);
        if sum > largest {
            (largest, from) = (sum, k + 1 - length);
        }
    }
    from..from + length
}

/// What the record costs in likelihood about a state.
fn cost(problem: &Problem<'_>, state: &State, noise: &Noise) -> Result<f64, OutputErrorFault> {
    let columns = state.own(problem);
    let chain = problem.linearise_at(&state.trajectory, &state.theta, &columns, &vec![0.0; columns.len()])?;
    Ok(Smoothed::new(&chain, noise, chain.columns, false).least_cost())
}

/// A limit of an input, with what it costs in likelihood and how far it moves the parameters.
struct Weighed {
    size: f64,
    cost: f64,
    step: Vec<f64>,
}

/// Replaces parameters at the most likely limit of an input by their mean over all limits, each as likely as it makes the record, and their
/// covariance by that over all limits. Samples leave the limit one by one when it moves, so that the likelihood has corners, and
/// its curvature at the top does not tell how wide it is.
fn over_limits(problem: &Problem<'_>, state: &mut State, examined: &mut Examined) -> Result<(), OutputErrorFault> {
    let Some(found) = state.limit.clone() else { return Ok(()) };
    let p = problem.free.len();
    let deviation = examined.covariance[(p, p)].sqrt();
    let mut tried: Vec<Weighed> = Vec::new();
    for i in -LIMITS_PER_SIDE..=LIMITS_PER_SIDE {
        let size = found.size + f64::from(i) / f64::from(LIMITS_PER_SIDE) * LIMITS_REACH * deviation;
        if size <= 0.0 {
            continue;
        }
        let limit = Limit { size, ..found.clone() };
        let trajectory = Trajectory { applied: Some(limit.applied(&problem.inputs)), ..state.trajectory.clone() };
        let chain = problem.linearise_at(&trajectory, &state.theta, &[], &[])?;
        let smoothed = Smoothed::new(&chain, &state.noise, p, false);
        let solution = Solution::of_columns(&smoothed, p, &problem.hidden)?;
        tried.push(Weighed { size, cost: smoothed.least_cost(), step: solution.step });
        if i == 0 {
            examined.covariance = solution.covariance * examined.misfit.scale;
        }
    }
    let least = tried.iter().map(|tried| tried.cost).fold(f64::INFINITY, f64::min);
    let weight = |tried: &Weighed| (0.5 * (least - tried.cost)).exp();
    let total: f64 = tried.iter().map(weight).sum();
    let mean = |of: &dyn Fn(&Weighed) -> f64| tried.iter().map(|tried| weight(tried) * of(tried)).sum::<f64>() / total;
    let steps: Vec<f64> = (0..p).map(|j| mean(&|tried| tried.step[j])).collect();
    let size = mean(&|tried| tried.size);
    for a in 0..p {
        for b in 0..p {
            examined.covariance[(a, b)] += mean(&|tried| (tried.step[a] - steps[a]) * (tried.step[b] - steps[b]));
        }
    }
    let std = mean(&|tried| (tried.size - size).powi(2)).sqrt();
    for (&j, step) in problem.free.iter().zip(&steps) {
        state.theta[j] += step;
    }
    state.limit = Some(Limit { size, ..found });
    if let Some(term) = examined.misfit.terms.first_mut()
        && let CandidateKind::Limit { limit, .. } = &mut term.term
    {
        (*limit, term.std) = (size, std);
    }
    Ok(())
}

/// Standard deviation of a signal.
fn spread(signal: &[f64]) -> f64 {
    let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
    root_mean_square(signal.iter().map(|x| x - mean))
}
