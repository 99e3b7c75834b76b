//! A log identified with a model that has nonlinear parameters, by separable least squares.
//!
//! The intervals of the nonlinear parameters z are scanned in one band of the time domain, each point with the best other parameters theta
//! for it. From the best points z is improved by variable projection (Golub and Pereyra 1973, in the variant of Kaufman 1975): the least
//! squares of rows that are linear about the best theta for z give the next z. Then the log is identified as any other, with rows linear
//! about the last solution, until z has converged. The refinement at the end has theta and z together.

use crate::identification::Identification;
use crate::identify::identify_from;
use crate::log_fault::LogFault;
use crate::options::LogOptions;
use crate::record::estimated;
use crate::refinement_report::NotRefined;
use crate::warning::{Data, Warning};
use std::collections::BTreeMap;
use tpm_controller::model::{EvalError, Model};
use tpm_estimate::{Differentiable, Domain, Estimate, EstimateError, Frozen, OneBand, Refine, Settings, Status};
use tpm_interpret::{InterpretedDerivatives, Separable};
use tpm_log::Log;
use tpm_numerics::patience;

/// Points at which the interval of a single nonlinear parameter is scanned.
const ON_A_LINE: usize = 24;
/// Points per nonlinear parameter at which the intervals of several are scanned, and most points.
const IN_A_BOX: (usize, usize) = (40, 160);
/// Ratio of the ends of an interval above which it is scanned by the logarithm.
const WIDE: f64 = 5.0;
/// Points of the scan from which the search goes on.
const BEGINNINGS: usize = 3;
/// Most steps of the search in one band.
const MOST_STEPS: usize = 30;
/// Shortest step, as a share of a whole one, that is tried.
const SHORTEST: f64 = 0.05;
/// Most identifications about what was found.
const MOST_ROUNDS: usize = 12;
/// Share of its deviation by which a nonlinear parameter that stands still may move.
const STILL: f64 = 1e-3;
/// Share of its interval by which a parameter moves by rounding.
const ROUNDING: f64 = 1e-10;
/// Largest parameter, in units of the largest one from which identification began, at which it has run away.
const RUN_AWAY: f64 = 1e3;
/// Share of its deviation by which a nonlinear parameter may still move after [`MOST_ROUNDS`].
const UNSETTLED: f64 = 0.3;
/// A deviation above this share of the interval: the data do not show the parameter within it.
const NOT_SHOWN: f64 = 0.5;
/// What another minimum may leave, in units of what the best one does, to be spoken of.
const NEARLY_ALIKE: f64 = 1.05;
/// Deviations beyond which two minima are different.
const APART: f64 = 3.0;

/// Identifies a model with nonlinear parameters from the segments of one record.
///
/// # Errors
/// [`LogFault`].
pub(super) fn identify(
    model: &Separable,
    derivatives: &InterpretedDerivatives,
    segments: &[&Log],
    options: &LogOptions,
) -> Result<Identification, LogFault> {
    // Far from a solution, weights that follow the estimates make harmonics run away; the time domain holds every log.
    let mut options = LogOptions { domain: Some(options.domain.unwrap_or(Domain::Time)), ..options.clone() };
    // Directions that no motion shows are those of the linear parameters; the nonlinear ones stand behind them.
    options.estimation.hidden.iter_mut().for_each(|direction| direction.resize(model.dims().parameters, 0.0));
    let options = &options;
    let path = segments.first().map(|log| log.path.clone()).unwrap_or_default();
    let record = estimated(segments, model.dims().coordinates, options)?;
    let band = OneBand::new(&record).map_err(|source| LogFault::Estimate { path: path.clone(), source })?;
    let minima = Search { model, derivatives, band, options }.minima();
    let start = minima.first().map_or_else(|| model.point().to_vec(), |best| best.point.clone());
    let problem = Problem { model, derivatives, segments, options, path };
    let mut found = problem.settle(start)?;
    problem.report_minima(&mut found, &minima);
    Ok(found)
}

/// A point, and what the best other parameters leave there.
#[derive(Clone, Debug)]
struct Minimum {
    /// Theta, then z.
    point: Vec<f64>,
    left: f64,
}

/// The search of nonlinear parameters in one band.
struct Search<'a> {
    model: &'a Separable,
    derivatives: &'a InterpretedDerivatives,
    band: OneBand<'a>,
    options: &'a LogOptions,
}

impl Search<'_> {
    fn held(&self, j: usize) -> Option<f64> {
        self.options.estimation.frozen.iter().find(|frozen| frozen.parameter == j).map(|frozen| frozen.value)
    }

    fn estimate(&self, point: &[f64], settings: &Settings) -> Option<Estimate> {
        let about = self.model.at(point.to_vec()).ok()?;
        self.band.estimate(&about, Some(self.derivatives), &self.options.constants, settings).ok()
    }

    /// The best other parameters at nonlinear ones, from given other parameters on.
    fn profile(&self, z: &[f64]) -> Option<Minimum> {
        let linear = self.model.linear();
        let mut point = vec![0.0; linear];
        point.extend(z);
        let mut settings = self.settings(&point);
        settings.frozen.retain(|frozen| frozen.parameter < linear);
        settings.frozen.extend(z.iter().enumerate().map(|(i, &value)| Frozen { parameter: linear + i, value }));
        let found = self.estimate(&point, &settings)?;
        Some(Minimum { point: found.values, left: found.residual })
    }

    fn settings(&self, point: &[f64]) -> Settings {
        Settings { prior: point.to_vec(), hidden: Vec::new(), ..self.options.estimation.clone() }
    }

    /// The points at which the intervals are scanned.
    fn points(&self) -> Vec<Vec<f64>> {
        let linear = self.model.linear();
        let intervals: Vec<[f64; 2]> = self.model.intervals().collect();
        let free: Vec<usize> = (0..intervals.len()).filter(|i| self.held(linear + i).is_none()).collect();
        let count = match free.len() {
            0 => 1,
            1 => ON_A_LINE,
            several => (IN_A_BOX.0 * several).min(IN_A_BOX.1),
        };
        let at = |k: usize, i: usize| -> f64 {
            if let Some(value) = self.held(linear + i) {
                return value;
            }
            let share = match free.iter().position(|of| *of == i) {
                Some(place) if free.len() > 1 => radical_inverse(k + 1, PRIMES[place % PRIMES.len()]),
                _ => (k as f64 + 0.5) / count as f64,
            };
            let [from, to] = intervals[i];
            if from > 0.0 && to > WIDE * from { from * (to / from).powf(share) } else { from + share * (to - from) }
        };
        (0..count).map(|k| (0..intervals.len()).map(|i| at(k, i)).collect()).collect()
    }

    /// The minima that were found, the best first.
    fn minima(&self) -> Vec<Minimum> {
        let scanned: Vec<Minimum> = self.points().iter().filter_map(|z| self.profile(z)).collect();
        let line = scanned.len() == ON_A_LINE && self.model.intervals().count() == 1;
        let below = |k: usize, other: Option<usize>| {
            other.and_then(|other| scanned.get(other)).is_none_or(|other| scanned[k].left <= other.left)
        };
        let mut begun: Vec<&Minimum> = (0..scanned.len())
            .filter(|&k| !line || below(k, k.checked_sub(1)) && below(k, Some(k + 1)))
            .map(|k| &scanned[k])
            .collect();
        begun.sort_by(|a, b| a.left.total_cmp(&b.left));
        let mut minima: Vec<Minimum> =
            begun.into_iter().take(BEGINNINGS).map(|begun| self.descend(begun.clone())).collect();
        minima.sort_by(|a, b| a.left.total_cmp(&b.left));
        minima
    }

    /// The minimum to which the variable projection leads.
    fn descend(&self, begun: Minimum) -> Minimum {
        let linear = self.model.linear();
        let mut best = begun;
        for _ in 0..MOST_STEPS {
            if patience::is_over() {
                break;
            }
            let Some(found) = self.estimate(&best.point, &self.settings(&best.point)) else { break };
            let z = &best.point[linear..];
            let wanted = clipped(self.model, &found.values);
            let step: Vec<f64> = wanted[linear..].iter().zip(z).map(|(to, from)| to - from).collect();
            let mut share = 1.0;
            let mut next = None;
            while share > SHORTEST && next.is_none() {
                let tried: Vec<f64> = z.iter().zip(&step).map(|(from, step)| from + share * step).collect();
                next = self.profile(&tried).filter(|tried| tried.left < best.left);
                share *= 0.5;
            }
            let Some(next) = next else { break };
            best = next;
        }
        best
    }
}

/// Bases of the low-discrepancy points (Halton 1960).
const PRIMES: [usize; 8] = [2, 3, 5, 7, 11, 13, 17, 19];

/// The digits of a number behind the point, in reverse order.
fn radical_inverse(mut number: usize, base: usize) -> f64 {
    let (mut value, mut place) = (0.0, 1.0 / base as f64);
    while number > 0 {
        value += (number % base) as f64 * place;
        number /= base;
        place /= base as f64;
    }
    value
}

/// A point with its nonlinear parameters within their intervals.
fn clipped(model: &Separable, point: &[f64]) -> Vec<f64> {
    let mut point = point.to_vec();
    for (value, [from, to]) in point[model.linear()..].iter_mut().zip(model.intervals()) {
        *value = value.clamp(from, to);
    }
    point
}

/// A log, and the model that is to explain it.
struct Problem<'a> {
    model: &'a Separable,
    derivatives: &'a InterpretedDerivatives,
    segments: &'a [&'a Log],
    options: &'a LogOptions,
    path: String,
}

/// What keeps nonlinear parameters from being estimated.
#[derive(Clone, Default)]
struct Kept {
    /// Parameters held at an end of their interval.
    ends: Vec<Frozen>,
    /// Parameters that the data do not show, held where they stand.
    hidden: Vec<Frozen>,
}

impl Problem<'_> {
    fn name(&self, j: usize) -> String {
        self.model.parameter(j).name.to_string()
    }

    fn at(&self, point: &[f64], kept: &Kept, refine: Refine) -> Result<Identification, LogFault> {
        let fault = |source: EvalError| LogFault::Estimate { path: self.path.clone(), source: source.into() };
        let about = self.model.at(point.to_vec()).map_err(fault)?;
        let machine = Differentiable { model: &about, derivatives: self.derivatives };
        let mut options = LogOptions { refine, ..self.options.clone() };
        options.estimation.frozen.extend(kept.ends.iter().chain(&kept.hidden));
        // What the log does not show stays where the rows are exact, unless a prior is stated.
        let stated = options.stated_prior();
        let prior = point.iter().enumerate().map(|(j, begun)| stated.get(j).copied().flatten().unwrap_or(*begun));
        options.estimation.prior = prior.collect();
        identify_from(&about, Some(machine), self.segments, &options)
    }

    fn free(&self, kept: &Kept) -> Vec<usize> {
        let held = |j: usize| {
            self.options.estimation.frozen.iter().chain(&kept.ends).chain(&kept.hidden).any(|own| own.parameter == j)
        };
        (self.model.linear()..self.model.dims().parameters).filter(|&j| !held(j)).collect()
    }

    /// Identifies about what was found until nonlinear parameters stand still, then refines.
    fn settle(&self, start: Vec<f64>) -> Result<Identification, LogFault> {
        let mut kept = Kept::default();
        let mut point = clipped(self.model, &start);
        for frozen in self.options.estimation.frozen.iter().filter(|frozen| frozen.parameter >= self.model.linear()) {
            point[frozen.parameter] = frozen.value;
        }
        // Every pass but the last holds one parameter more.
        loop {
            let (found, moved) = self.rounds(&mut point, &kept)?;
            if self.keep(&found, &mut point, &mut kept) {
                continue;
            }
            let mut refined = self.at(&point, &kept, self.options.refine)?;
            if self.keep(&refined, &mut point, &mut kept) {
                continue;
            }
            if let Some(j) = moved {
                let reason = NotRefined::Moving { parameter: self.name(j) };
                refined.warnings.push(Warning::Unsettled { reason });
            }
            self.report_kept(&mut refined, &kept);
            return Ok(refined);
        }
    }

    /// Identifies about what was found until nonlinear parameters stand still; gives one that does not.
    fn rounds(&self, point: &mut Vec<f64>, kept: &Kept) -> Result<(Identification, Option<usize>), LogFault> {
        let intervals: Vec<[f64; 2]> = self.model.intervals().collect();
        let free = self.free(kept);
        let largest =
            |point: &[f64]| point[..self.model.linear()].iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let begun = largest(point);
        let mut round = 0;
        loop {
            let found = self.at(point, kept, Refine::None)?;
            let nothing = || LogFault::Estimate { path: self.path.clone(), source: EstimateError::NoSignal };
            let estimate = found.estimate.as_ref().ok_or_else(nothing)?;
            let next = clipped(self.model, &estimate.values);
            if self.options.domain == Some(Domain::Harmonics) && begun > 0.0 && largest(&next) > RUN_AWAY * begun {
                let parameters = (self.model.linear()..self.model.dims().parameters).map(|j| self.name(j)).collect();
                return Err(LogFault::RunsAway { path: self.path.clone(), parameters });
            }
            let moved = |j: usize, share: f64| {
                let [from, to] = intervals[j - self.model.linear()];
                (next[j] - point[j]).abs() > (share * estimate.std[j]).max(ROUNDING * (to - from))
            };
            round += 1;
            let moving = free.iter().copied().find(|&j| moved(j, STILL));
            if moving.is_none() || round == MOST_ROUNDS || patience::is_over() {
                let unsettled = free.iter().copied().find(|&j| moved(j, UNSETTLED));
                *point = next;
                // The rows are linear about the last point but one, from which the values do not differ.
                return Ok((found, unsettled));
            }
            *point = next;
        }
    }

    /// Holds a parameter that the data do not show within its interval, or that they ask for beyond an end; says whether there is one.
    fn keep(&self, found: &Identification, point: &mut [f64], kept: &mut Kept) -> bool {
        let Some(estimate) = &found.estimate else { return false };
        let linear = self.model.linear();
        let intervals: Vec<[f64; 2]> = self.model.intervals().collect();
        let seen = |&j: &usize| estimate.status[j] != Status::Unobservable;
        let free: Vec<usize> = self.free(kept).into_iter().filter(seen).collect();
        let share = |j: usize| estimate.std[j] / (intervals[j - linear][1] - intervals[j - linear][0]);
        let widest = free.iter().copied().max_by(|&a, &b| share(a).total_cmp(&share(b)));
        if let Some(j) = widest.filter(|&j| share(j) > NOT_SHOWN) {
            kept.hidden.push(Frozen { parameter: j, value: point[j] });
            return true;
        }
        for j in free {
            let [from, to] = intervals[j - linear];
            let value = estimate.values[j];
            if !(from..=to).contains(&value) {
                point[j] = value.clamp(from, to);
                kept.ends.push(Frozen { parameter: j, value: point[j] });
                return true;
            }
        }
        false
    }

    /// Says of the parameters that were held why they were.
    fn report_kept(&self, found: &mut Identification, kept: &Kept) {
        let intervals: Vec<[f64; 2]> = self.model.intervals().collect();
        for held in &kept.ends {
            let j = held.parameter;
            let interval = intervals[j - self.model.linear()];
            let warning = Warning::EndOfInterval { parameter: self.name(j), end: held.value, interval };
            found.warnings.push(warning);
            found.parameters[j].status = Status::PoorlyDetermined;
            found.parameters[j].std = None;
        }
        for j in kept.hidden.iter().map(|held| held.parameter) {
            found.warnings.push(Warning::NotVisible { parameter: self.name(j), data: Data::Log });
            found.unobservable.push(BTreeMap::from([(self.name(j), "1".to_string())]));
            let report = &mut found.parameters[j];
            (report.value, report.std, report.status) = (None, None, Status::Unobservable);
            for (r, row) in found.covariance.iter_mut().enumerate() {
                for (c, entry) in row.iter_mut().enumerate() {
                    *entry = entry.filter(|_| r != j && c != j);
                }
            }
            if let Some(estimate) = &mut found.estimate {
                let mut direction = vec![0.0; estimate.values.len()];
                direction[j] = 1.0;
                estimate.unobservable.push(direction);
                estimate.std[j] = f64::INFINITY;
                estimate.status[j] = Status::Unobservable;
            }
        }
    }

    /// Says of other minima that explain the log nearly as well.
    fn report_minima(&self, found: &mut Identification, minima: &[Minimum]) {
        let (Some(best), Some(estimate)) = (minima.first(), found.estimate.clone()) else { return };
        for other in minima.iter().skip(1).filter(|other| other.left < NEARLY_ALIKE * best.left) {
            let differs = |&j: &usize| {
                estimate.status[j] != Status::Unobservable
                    && (other.point[j] - best.point[j]).abs() > APART * estimate.std[j].max(f64::MIN_POSITIVE)
                    && (other.point[j] - best.point[j]).abs() > 1e-6 * best.point[j].abs()
            };
            if let Some(j) = (self.model.linear()..estimate.values.len()).find(differs) {
                found.warnings.push(Warning::SeveralMinima {
                    parameter: self.name(j),
                    value: best.point[j],
                    other: other.point[j],
                    left: other.left / best.left,
                });
                return;
            }
        }
    }
}
