//! Estimates of a log or a campaign refined by simulating the model sample by sample.

use crate::excerpt::{Excerpt, accelerated};
use crate::log_report::HoldResiduals;
use crate::options::LogOptions;
use crate::refinement_report::{LongSimulation, MissingTerm, NotRefined, RateReport, RefinementReport};
use crate::term_words::{self, Words, lacking};
use crate::warning::Warning;
use std::ops::RangeInclusive;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{Label, Model};
use tpm_estimate::{
    Asked, Candidate, CandidateKind, Course, Differentiable, Estimate, Lacking, OutputError, OutputErrorFault,
    Question, Refine, ResidualOf, Settings, Simulation, Term, TermKind, reach_in,
};
use tpm_motion::Dynamics;
use tpm_numerics::{Matrix, alarm, tolerance};

/// Share of a parameter by which something that is missing must move it to be spoken of.
const LEAST_MOVE: f64 = 1e-3;

/// Most work of one linearisation of a record about a motion, in floating-point operations, that is done without being asked for. A fit
/// that does not settle at once takes some hundred linearisations: two and a half minutes at 2.5e8 operations.
const MOST_WORK: f64 = 1.5e8;
/// Delays, samples, that the other hold would explain.
pub(super) const HALF_A_SAMPLE: RangeInclusive<f64> = 0.25..=0.75;
/// Most coordinates of a machine of which the likelihood asks what the model lacks, and how its inputs are held; of more the lines of the rows
/// say it.
const MOST_ASKED: usize = 2;
/// Evaluations of the derivatives in one step of the integration.
const EVALUATIONS_PER_STEP: f64 = 4.0;

/// A refined estimate.
pub(super) struct Refined {
    pub(super) estimate: Estimate,
    /// Nothing where no refinement was asked for, or the model cannot be simulated with what is known.
    pub(super) report: Option<RefinementReport>,
    pub(super) warnings: Vec<Warning>,
    /// Whether it tells that the inputs do the other thing between samples.
    pub(super) tells_hold: bool,
}

impl Refined {
    /// An estimate that was not refined.
    pub(super) const fn none(estimate: Estimate) -> Self {
        Refined { estimate, report: None, warnings: Vec::new(), tells_hold: false }
    }
}

/// What a refinement begins with.
pub(super) struct Start<'a> {
    /// The estimate.
    pub(super) estimate: &'a Estimate,
    /// What is simulated.
    pub(super) excerpt: Excerpt<'a>,
    /// What is known of its motion beforehand.
    pub(super) course: Course,
    /// Step of every sensor; zero where its values lie on no grid.
    pub(super) steps: Vec<f64>,
    /// Samples of the whole record.
    pub(super) samples: usize,
    /// Time between samples, s.
    pub(super) sample_time: f64,
}

/// What holds for a record, and what is asked for.
#[derive(Clone, Copy)]
pub(super) struct Conditions<'a> {
    /// Constants of the model.
    pub(super) constants: &'a [f64],
    /// What the inputs do between samples.
    pub(super) hold: Hold,
    /// What lies between every recorded input and the machine.
    pub(super) actuators: &'a [Dynamics],
    pub(super) refine: Refine,
    pub(super) by: By,
}

/// What a refinement weighs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum By {
    /// Output error, whose inputs may have noise.
    OutputError,
    /// The likelihood of all ways to explain a record: noise of sensors and forces, terms, delays, play and limits.
    Likelihood {
        /// Whether it is asked which forces the model lacks: nobody has named any.
        forces: bool,
    },
}

impl<'a> Conditions<'a> {
    pub(super) fn of_log(options: &'a LogOptions) -> Self {
        let LogOptions { constants, reading, actuators, refine, .. } = options;
        Conditions { constants, hold: reading.hold, actuators, refine: *refine, by: By::OutputError }
    }
}

/// Refines an estimate by simulating the model, where its derivatives are known, the inputs act as they are recorded, and the record
/// was not explained but for rounding. `restate` makes an estimate of other values and their covariance.
pub(super) fn refined(
    machine: Option<Differentiable<'_>>,
    mut start: Start<'_>,
    conditions: Conditions<'_>,
    settings: &Settings,
    restate: &dyn Fn(Vec<f64>, Matrix) -> Estimate,
) -> Refined {
    let estimate = start.estimate;
    let wanted = conditions.refine != Refine::None && estimate.residual > tolerance::EXPLAINED_FORCE;
    let Some(machine) = machine.filter(|_| wanted) else {
        return Refined::none(estimate.clone());
    };
    let period = match &start.course {
        Course::Periodic { samples_per_period, .. } => Some(*samples_per_period),
        _ => None,
    };
    let rate = (start.sample_time, conditions.hold, accelerated(machine.model));
    start.excerpt = start.excerpt.behind(conditions.actuators, machine.model.dims().coordinates, rate, period);
    let work = work(machine, &start, settings);
    if conditions.refine == Refine::Auto && work > MOST_WORK {
        let long = LongSimulation { work, most: MOST_WORK };
        let report = RefinementReport::left_out(&estimate.values, NotRefined::LongSimulation(long));
        let warnings = vec![Warning::LongSimulation(long)];
        return Refined { report: Some(report), warnings, ..Refined::none(estimate.clone()) };
    }
    let refine = match conditions.by {
        By::OutputError => refine,
        By::Likelihood { .. } => by_likelihood,
    };
    refine(machine, &start, conditions, settings, restate).unwrap_or_else(|fault| {
        let report = RefinementReport::refused(&estimate.values, &fault);
        let remark = |reason| match report.is_unsettled() {
            true => Warning::Unsettled { reason },
            false => Warning::NotRefined { reason },
        };
        let warnings = report.note.iter().cloned().map(remark).collect();
        Refined { report: Some(report), warnings, ..Refined::none(estimate.clone()) }
    })
}

/// The work of linearising a record about a motion, in floating-point operations: per sample the derivatives of the rows, and products
/// of the matrices of states and parameters.
fn work(machine: Differentiable<'_>, start: &Start<'_>, settings: &Settings) -> f64 {
    let model = machine.model;
    let dims = model.dims();
    let states: usize = (0..dims.coordinates).map(|c| model.coordinate_order(c)).sum();
    let unknowns = states + dims.parameters.saturating_sub(settings.frozen.len());
    let rows = machine.derivatives.workspace_len() + model.workspace_len();
    start.excerpt.samples() as f64 * (EVALUATIONS_PER_STEP * rows as f64 + (states * states * unknowns) as f64)
}

/// The parameters that are estimated, and the directions of them that the data do not show.
fn unknowns(estimate: &Estimate, parameters: usize, settings: &Settings) -> (Vec<usize>, Vec<Vec<f64>>) {
    let free: Vec<usize> =
        (0..parameters).filter(|j| settings.frozen.iter().all(|frozen| frozen.parameter != *j)).collect();
    let of_free = |direction: &Vec<f64>| free.iter().map(|&j| direction[j]).collect();
    let hidden = estimate.unobservable.iter().map(of_free).collect();
    (free, hidden)
}

/// The warning about a parameter that moves from one half of a record to the other by more than the deviation of the difference allows.
fn contradiction(label: Label<'_>, value: f64, moved: f64, deviation: f64) -> Option<Warning> {
    let tells = moved.abs() > alarm::HALVES_CONTRADICT * deviation && moved.abs() > LEAST_MOVE * value.abs();
    tells.then(|| Warning::Halves { parameter: label.name.to_string(), moved, deviation })
}

fn refine(
    machine: Differentiable<'_>,
    start: &Start<'_>,
    conditions: Conditions<'_>,
    settings: &Settings,
    restate: &dyn Fn(Vec<f64>, Matrix) -> Estimate,
) -> Result<Refined, OutputErrorFault> {
    let model = machine.model;
    let dims = model.dims();
    let Start { estimate, excerpt, .. } = start;
    let known = (start.course.clone(), start.steps.as_slice());
    let signals = excerpt.signals(dims.coordinates, start.sample_time, conditions.hold, known);
    let (free, hidden) = unknowns(estimate, dims.parameters, settings);
    let found = OutputError::fit(machine, conditions.constants, &signals, &estimate.values, &free, &hidden)?;
    let misfit = &found.misfit;
    let shift = &misfit.shift;
    // A parameter that drifts has gone on drifting where the log was left out.
    let reach = excerpt.middle.max(start.samples as f64 - excerpt.middle) / excerpt.half;
    let range: Vec<f64> = misfit.range.iter().map(|range| range * reach).collect();
    let mut covariance = vec![vec![0.0; dims.parameters]; dims.parameters];
    for (a, &i) in free.iter().enumerate() {
        for (b, &j) in free.iter().enumerate() {
            let own = match found.iterations {
                Some(_) => found.covariance(a, b).unwrap_or_default() * misfit.inflation,
                None => estimate.covariance[(i, j)],
            };
            covariance[i][j] = own + shift[a] * shift[b];
        }
        covariance[i][i] += range[a].powi(2) + misfit.bent[a].powi(2);
    }
    let covariance = Matrix::from_rows(&covariance).unwrap_or_else(|| estimate.covariance.clone());
    let report = RefinementReport {
        used: found.iterations.is_some(),
        note: found.iterations.is_none().then_some(NotRefined::WithoutTerm),
        steps: found.iterations.unwrap_or(0),
        sensor_noise: found.sensor_noise.clone(),
        input_noise: found.input_noise.clone(),
        rates: found.rates.iter().map(|rate| RateReport::of(model, rate)).collect(),
        residual: found.residual.clone(),
        missing: misfit.terms.iter().map(|term| missing(model, term)).collect(),
        ..RefinementReport::of(&estimate.values, excerpt)
    };
    // What moves nothing by more than this is too small to look for, however surely it is there.
    let matters = |moved: &dyn Fn(usize) -> f64| {
        free.iter().enumerate().any(|(a, &j)| moved(a).abs() > LEAST_MOVE * found.values[j].abs())
    };
    let lacking = matters(&|a| shift[a].hypot(range[a]));
    let wide = matters(&|a| (found.covariance(a, a).unwrap_or_default() * misfit.inflation).sqrt());
    let mut warnings: Vec<Warning> = report.note.iter().cloned().map(|reason| Warning::NotRefined { reason }).collect();
    let held = |hold: Hold| {
        let signals = excerpt.signals(dims.coordinates, start.sample_time, hold, (start.course.clone(), &start.steps));
        OutputError::fit(machine, conditions.constants, &signals, &found.values, &free, &hidden).ok()
    };
    let other_hold = other_hold(&found, conditions, start.sample_time, held);
    let tells_hold = other_hold.is_some();
    warnings.extend(other_hold);
    let (limits, others) = report.missing.split_at(usize::from(misfit.limited));
    warnings.extend(limits.iter().cloned().map(|term| Warning::Limited { term }));
    if lacking {
        warnings.extend(others.iter().cloned().map(|term| Warning::MissingTerm { term }));
    }
    if misfit.repeats && wide {
        warnings.push(Warning::Repeats { power: misfit.periodic, beside_terms: !others.is_empty() });
    }
    if let Some(frequency) = misfit.vibration.filter(|_| matters(&|a| misfit.bent[a])) {
        warnings.push(Warning::Vibration { frequency });
    }
    for ((a, half), &j) in misfit.halves.iter().enumerate().zip(&free) {
        let known = shift[a].powi(2) + range[a].powi(2) + misfit.bent[a].powi(2);
        // A half has twice the variance of the whole, so that the difference of two has four times as much.
        let deviation = (half.variance * misfit.scale * misfit.inflation + 4.0 * known).sqrt();
        warnings.extend(contradiction(model.parameter(j), found.values[j], half.moved, deviation));
    }
    let (share, settled) = (found.share, found.iterations.is_some());
    let mut restated = restate(found.values, covariance);
    if settled {
        (restated.residual, restated.residual_of) = (share, ResidualOf::Motion);
    }
    Ok(Refined { estimate: restated, report: Some(report), warnings, tells_hold })
}

/// The estimate that the likelihood of all ways to explain a record hands out.
fn by_likelihood(
    machine: Differentiable<'_>,
    start: &Start<'_>,
    conditions: Conditions<'_>,
    settings: &Settings,
    restate: &dyn Fn(Vec<f64>, Matrix) -> Estimate,
) -> Result<Refined, OutputErrorFault> {
    let model = machine.model;
    let dims = model.dims();
    let Start { estimate, excerpt, .. } = start;
    let (free, hidden) = unknowns(estimate, dims.parameters, settings);
    let (typical_period, reach) = match &start.course {
        Course::Periodic { samples_per_period, .. } => (*samples_per_period, reach_in(*samples_per_period)),
        Course::Any { typical_period, reach, .. } => (*typical_period, *reach),
    };
    let record = |hold: Hold| excerpt.record(dims.coordinates, (start.sample_time, hold), (&start.steps, reach));
    let question = Question {
        machine,
        constants: conditions.constants,
        start: &estimate.values,
        free: &free,
        hidden: &hidden,
        typical_period: typical_period * start.sample_time,
        asked: match conditions.by {
            _ if dims.coordinates > MOST_ASKED => Asked::Nothing,
            By::Likelihood { forces: true } => Asked::All,
            _ => Asked::Channels,
        },
    };
    let found = Simulation::fit(&question, &record(conditions.hold))?;
    let report = RefinementReport {
        steps: found.passes,
        sensor_noise: found.sensor_noise.clone(),
        input_noise: vec![0.0; dims.inputs],
        force_left: found.force_left.clone(),
        outcome: Some(found.outcome()),
        ways: found.tried.clone(),
        rates: found.rates.iter().map(|rate| RateReport::of(model, rate)).collect(),
        residual: found.residual.clone(),
        missing: found.lacking.iter().map(|own| lacking(model, own)).collect(),
        ..RefinementReport::of(&estimate.values, excerpt)
    };
    let shifted = |own: &&Lacking| {
        own.term.kind == TermKind::Delay && HALF_A_SAMPLE.contains(&(own.value.abs() / start.sample_time))
    };
    let other_hold = || {
        // Where nothing lies between the inputs and the machine, the other hold is as likely beforehand.
        let better = conditions.hold.other();
        let question = Question { start: &found.values, asked: Asked::Nothing, ..question.clone() };
        let other = Simulation::fit(&question, &record(better)).ok()?;
        if other.cost >= found.cost - alarm::LIKELIHOOD_GAIN {
            return None;
        }
        Some(match found.lacking.iter().find(shifted) {
            Some(late) => {
                Warning::LateByHold { input: model.input(late.term.of).name.into(), late: late.value, better }
            }
            None => Warning::OtherHold {
                stated: conditions.hold,
                left: found.share,
                better,
                left_by_better: other.share,
                of: ResidualOf::Motion,
            },
        })
    };
    let tried = dims.coordinates <= MOST_ASKED && conditions.actuators.iter().all(Dynamics::is_ideal);
    let other_hold = tried.then(other_hold).flatten();
    let tells_hold = other_hold.is_some();
    let mut warnings: Vec<Warning> = other_hold.into_iter().collect();
    warnings.extend(report.missing.iter().cloned().map(|term| match term.of.kind {
        TermKind::Limit => Warning::Limited { term },
        _ => Warning::MissingTerm { term },
    }));
    for (half, &j) in found.halves.iter().zip(&free) {
        // The difference of two halves has four times the variance of the whole.
        let deviation = half.variance.max(4.0 * found.covariance[(j, j)]).sqrt();
        warnings.extend(contradiction(model.parameter(j), found.values[j], half.moved, deviation));
    }
    let share = found.share;
    let mut restated = restate(found.values, Matrix::of(found.covariance));
    (restated.residual, restated.residual_of) = (share, ResidualOf::Motion);
    Ok(Refined { estimate: restated, report: Some(report), warnings, tells_hold })
}

/// The other hold, where a simulation with it leaves clearly less. It is asked for where an input seems to act half a sample later or earlier
/// than it is recorded, which is what the wrong hold makes of it.
fn other_hold(
    found: &OutputError,
    conditions: Conditions<'_>,
    sample_time: f64,
    held: impl Fn(Hold) -> Option<OutputError>,
) -> Option<Warning> {
    let shifted = |term: &Candidate| {
        matches!(term.term, CandidateKind::Delay { .. }) && HALF_A_SAMPLE.contains(&(term.value.abs() / sample_time))
    };
    if !(found.misfit.terms.iter().any(shifted) && conditions.actuators.iter().all(Dynamics::is_ideal)) {
        return None;
    }
    let other = held(conditions.hold.other()).filter(|other| other.iterations.is_some())?;
    let residuals = HoldResiduals::of(conditions.hold, found.share, Some(other.share));
    Warning::other_hold(conditions.hold, residuals, ResidualOf::Motion)
}

fn missing(model: &dyn Model<f64>, candidate: &Candidate) -> MissingTerm {
    let name = |label: Label<'_>| label.name.to_string();
    let q = |c: usize| name(model.coordinate(c));
    let (term, meaning): Words = match candidate.term {
        CandidateKind::Offset => term_words::offset(),
        CandidateKind::Power { coordinate, exponent } => term_words::power(&q(coordinate), exponent),
        CandidateKind::Product { coordinate, other } => {
            (format!("{}*{}", q(coordinate), q(other)), "a coupling of two coordinates".into())
        }
        CandidateKind::RatePower { coordinate, exponent } => term_words::rate_power(&q(coordinate), exponent),
        CandidateKind::Drag { coordinate } => term_words::drag(&q(coordinate)),
        CandidateKind::Friction { coordinate } => term_words::friction(&q(coordinate)),
        CandidateKind::Stribeck { coordinate } => term_words::stribeck(&q(coordinate)),
        CandidateKind::Drift { parameter } => {
            let name = name(model.parameter(parameter));
            let meaning = format!("{name} changes over the record (drift)");
            (format!("{name} * time"), meaning.into())
        }
        CandidateKind::Delay { input } => (
            term_words::late(&name(model.input(input))),
            format!("a delay or lag of one channel, {:.3} ms if it is the input's", 1e3 * candidate.value).into(),
        ),
        CandidateKind::Flexible { input } => (
            format!("second rate of {}", name(model.input(input))),
            "dynamics between input and sensor: a flexible mode, or a lag".into(),
        ),
        CandidateKind::Limit { input, limit } => (
            format!("{0} beyond {limit:.4}", name(model.input(input))),
            format!("clipping: the input is limited (saturation) at about {limit:.4}").into(),
        ),
        CandidateKind::Backlash { coordinate } => (
            format!("sign(dot({})) on its reading", q(coordinate)),
            "backlash or hysteresis between machine and sensor".into(),
        ),
    };
    let (of, other) = match candidate.term {
        CandidateKind::Product { coordinate, other } => (coordinate, Some(other)),
        CandidateKind::Offset => (candidate.row.unwrap_or(0), None),
        CandidateKind::Power { coordinate, .. }
        | CandidateKind::RatePower { coordinate, .. }
        | CandidateKind::Drag { coordinate }
        | CandidateKind::Friction { coordinate }
        | CandidateKind::Stribeck { coordinate }
        | CandidateKind::Backlash { coordinate } => (coordinate, None),
        CandidateKind::Drift { parameter } => (parameter, None),
        CandidateKind::Delay { input } | CandidateKind::Flexible { input } | CandidateKind::Limit { input, .. } => {
            (input, None)
        }
    };
    MissingTerm {
        of: Term { kind: kind(candidate.term), row: candidate.row, of, other },
        term,
        row: candidate.row.map(|row| name(model.row(row))),
        value: candidate.value,
        std: candidate.std,
        gain: candidate.gain,
        meaning: meaning.into_owned(),
    }
}

/// A candidate of a simulation among all kinds of terms.
const fn kind(candidate: CandidateKind) -> TermKind {
    match candidate {
        CandidateKind::Offset => TermKind::Offset,
        CandidateKind::Power { exponent, .. } => TermKind::Power(exponent),
        CandidateKind::Product { .. } => TermKind::Product,
        CandidateKind::RatePower { exponent, .. } => TermKind::RatePower(exponent),
        CandidateKind::Drag { .. } => TermKind::Drag,
        CandidateKind::Friction { .. } => TermKind::Friction,
        CandidateKind::Stribeck { .. } => TermKind::Stribeck,
        CandidateKind::Drift { .. } => TermKind::ParameterDrift,
        CandidateKind::Delay { .. } => TermKind::Delay,
        CandidateKind::Flexible { .. } => TermKind::Flexible,
        CandidateKind::Limit { .. } => TermKind::Limit,
        CandidateKind::Backlash { .. } => TermKind::Backlash,
    }
}
