//! What a search found, and the files from which it can be played.

use super::criterion::Criterion;
use super::held;
use super::problem::Problem;
use super::search::{Found, Searched};
use super::settings::ExcitationSettings;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use tpm_controller::model::{EvalError, Model as _};
use tpm_experiment::{Experiment, ExperimentError, StageSection};
use tpm_interpret::Interpreted;
use tpm_motion::trajectory::{Line, Trajectory};
use tpm_numerics::{DMatrix, singular, tolerance};
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_session::{FreeNames, ModelFault, Session};

/// Name of the pattern that is written.
const PATTERN: &str = "excitation";
/// Samples in the period of the highest harmonic at which a motion is judged.
const JUDGED: usize = 50;
/// Points of a curve in a figure, and samples at which shares of limits are read off.
const DRAWN: usize = 1000;

/// Motions that show the base parameters well. It serialises as `tpm.excitation/1` does.
#[derive(Clone, Debug, Serialize)]
pub struct Excitation {
    /// What they were chosen for.
    pub criterion: Criterion,
    /// Fundamental frequency, rad/s.
    pub frequency: f64,
    /// Highest harmonic.
    pub harmonics: u32,
    /// Random motions that were tried.
    pub starts: usize,
    /// Those that could be brought within the limits.
    pub feasible: usize,
    /// Value of the criterion of the best of these before it was improved: the logarithm of an upper bound of the condition number, or the
    /// negative logarithm of the determinant for each base parameter.
    pub before: f64,
    /// The leading parameters of the base parameters.
    pub base: Vec<String>,
    /// Best first; all of them keep within the limits at every instant.
    pub motions: Vec<Proposed>,
    #[serde(skip)]
    demand: Demand,
}

/// One motion.
#[derive(Clone, Debug, Serialize)]
pub struct Proposed {
    /// Condition number of the stacked regressor in base parameters, in units of the model.
    pub condition: f64,
    /// Value of the criterion, as `before`.
    pub value: f64,
    /// What the motion uses of the limits, by coordinate and by input.
    pub used: Vec<Used>,
    /// The motion.
    #[serde(serialize_with = "written")]
    pub trajectory: Trajectory,
}

/// The largest magnitude of a quantity along a motion, beside its limit.
#[derive(Clone, Debug, Serialize)]
pub struct Used {
    /// `position`, `velocity`, `acceleration` or `input`.
    pub kind: &'static str,
    /// The coordinate or the input.
    pub name: String,
    /// Least and largest value.
    pub range: [f64; 2],
    /// Least and largest permitted value; of an input, the part of its limit that the experiment permits. Nothing without a limit.
    pub limit: Option<[f64; 2]>,
    /// Largest distance from the middle of the limits, as a share of that of the limits. Nothing without a limit.
    pub share: Option<f64>,
}

/// The series of a coordinate: mean, and harmonic, cosine and sine of every line.
#[derive(Serialize)]
struct Written {
    mean: f64,
    lines: Vec<(u32, f64, f64)>,
}

fn written<S: serde::Serializer>(motion: &Trajectory, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(motion.coordinates.iter().map(|series| Written {
        mean: series.mean,
        lines: series.lines.iter().map(|line| (line.harmonic, line.cos, line.sin)).collect(),
    }))
}

/// What predicts the inputs along a motion.
#[derive(Clone, Debug)]
struct Demand {
    parameters: Vec<f64>,
    constants: Vec<f64>,
    /// Inputs times rows.
    factors: Vec<f64>,
}

/// A motion and its inputs at one instant.
struct Instant {
    motion: Vec<f64>,
    inputs: Vec<f64>,
}

impl Demand {
    /// The motion with its inputs at equal steps of its period.
    fn along(&self, model: &Interpreted, motion: &Trajectory, samples: usize) -> Result<Vec<Instant>, EvalError> {
        let dims = model.dims();
        let (mut workspace, mut forces) = (vec![0.0; model.inverse_workspace_len()], vec![0.0; dims.rows]);
        let mut instants = Vec::with_capacity(samples);
        for n in 0..samples {
            let mut point = vec![0.0; dims.motion_len()];
            motion.motion_at(n, samples, 0.0, &mut point);
            model.inverse_dynamics(&point, &self.parameters, &self.constants, &mut workspace, &mut forces)?;
            let of = |factors: &[f64]| factors.iter().zip(&forces).map(|(factor, force)| factor * force).sum();
            let inputs = self.factors.chunks_exact(dims.rows).map(of).collect();
            instants.push(Instant { motion: point, inputs });
        }
        Ok(instants)
    }
}

/// The result of a search.
pub(super) fn excitation(
    session: &Session,
    problem: &Problem<'_>,
    parameters: Vec<f64>,
    settings: &ExcitationSettings,
    searched: Searched,
) -> Result<Excitation, EvalError> {
    let model = session.machine().plant();
    let samples = JUDGED * settings.harmonics as usize;
    let demand = Demand { parameters, constants: problem.constants.to_vec(), factors: problem.factors.clone() };
    let mut motions = Vec::with_capacity(searched.found.len());
    for Found { motion, value } in searched.found {
        let condition = judged(problem, &motion, samples)?;
        let used = used(model, problem, &demand, &motion)?;
        motions.push(Proposed { condition, value, used, trajectory: motion });
    }
    Ok(Excitation {
        criterion: settings.criterion,
        frequency: motions.first().map_or(0.0, |best| best.trajectory.frequency),
        harmonics: settings.harmonics,
        starts: searched.tried,
        feasible: searched.feasible,
        before: searched.at_first,
        base: problem.rows.leading().iter().map(|&column| model.parameter(column).name.to_string()).collect(),
        motions,
        demand,
    })
}

/// Condition number of the stacked regressor at equal steps of a motion.
fn judged(problem: &Problem<'_>, motion: &Trajectory, samples: usize) -> Result<f64, EvalError> {
    let dims = problem.rows.dims();
    let mut at = problem.rows.memory();
    let mut point = vec![0.0; dims.motion_len()];
    let mut stacked = Vec::with_capacity(samples * at.regressor.len());
    for n in 0..samples {
        motion.motion_at(n, samples, 0.0, &mut point);
        problem.rows.evaluate(&point, problem.constants, &mut at)?;
        stacked.extend_from_slice(&at.regressor);
    }
    let stacked = DMatrix::from_row_slice(samples * dims.rows, problem.base.len(), &stacked);
    Ok(singular::condition(&stacked, tolerance::RANK))
}

/// What a motion uses of the limits.
fn used(
    model: &Interpreted,
    problem: &Problem<'_>,
    demand: &Demand,
    motion: &Trajectory,
) -> Result<Vec<Used>, EvalError> {
    let (dims, instants) = (model.dims(), demand.along(model, motion, DRAWN)?);
    let range = |of: &dyn Fn(&Instant) -> f64| {
        let values = instants.iter().map(of);
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
    };
    let mut all = Vec::new();
    for (order, kind) in ["position", "velocity", "acceleration"].into_iter().enumerate() {
        for (c, limits) in problem.limits.iter().enumerate() {
            let (centre, reach) = limits.of_orders()[order];
            let bound = held::bound(&motion.coordinates[c], motion.frequency, order, centre);
            let range = range(&|instant| instant.motion[order * dims.coordinates + c]);
            let (limit, share) = (
                reach.is_finite().then_some([centre - reach, centre + reach]),
                reach.is_finite().then_some(bound / reach),
            );
            all.push(Used { kind, name: model.coordinate(c).name.to_string(), range, limit, share });
        }
    }
    for (input, limit) in problem.efforts.iter().enumerate() {
        let range = range(&|instant| instant.inputs[input]);
        let share = limit.is_finite().then(|| range[0].abs().max(range[1].abs()) / limit);
        let limit = limit.is_finite().then_some([-limit, *limit]);
        all.push(Used { kind: "input", name: model.input(input).name.to_string(), range, limit, share });
    }
    Ok(all)
}

/// The files from which a motion is played.
#[derive(Clone, Debug)]
pub struct Files {
    /// The model with the motion as a further pattern.
    pub model: String,
    /// The experiment with the motion as its stage.
    pub experiment: String,
    /// One period for a controller: time, positions, velocities, accelerations, predicted inputs.
    pub samples: String,
}

/// Why the files of a motion cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilesError {
    /// The experiment has a value that its file cannot hold.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The inputs cannot be predicted.
    #[error(transparent)]
    Evaluation(#[from] EvalError),
    /// The model with the motion as a pattern is no model.
    #[error("the motion cannot stand in the model as a pattern: {0}")]
    Model(#[from] ModelFault),
}

impl Excitation {
    /// The files from which one of the motions is played.
    ///
    /// # Errors
    /// [`FilesError`].
    pub fn files(&self, session: &Session, motion: &Trajectory) -> Result<Files, FilesError> {
        let (declared, machine) = (session.model(), session.machine());
        let plant = machine.plant();
        let mut names = FreeNames::of(declared);
        let (pattern, frequency) = (names.free(PATTERN), names.free("w"));
        let (mut constants, mut lines) = (String::new(), String::new());
        // Amplitudes of one, a unit each, so that the coefficients have the coordinate's unit.
        let mut amplitudes: BTreeMap<Option<String>, String> = BTreeMap::new();
        for (c, series) in motion.coordinates.iter().enumerate() {
            let label = plant.coordinate(c);
            let (name, unit) = (label.name, label.unit.map(ToString::to_string));
            let size = amplitudes.entry(unit.clone()).or_insert_with(|| names.free("size"));
            let terms: String = series.lines.iter().map(|line| term(line, &frequency)).collect();
            let centre = match &unit {
                Some(unit) if unit != "rad" => {
                    let own = names.free(&format!("centre_of_{name}"));
                    let _ = writeln!(constants, "    constant {own} = {} [{unit}];", series.mean);
                    own
                }
                _ => series.mean.to_string(),
            };
            let _ = writeln!(
                lines,
                "        {name} = {centre} + {size}*({});",
                terms.strip_prefix(" + ").unwrap_or(&terms).trim_start()
            );
        }
        let declared_amplitudes: Vec<String> = amplitudes
            .iter()
            .map(|(unit, name)| unit.as_ref().map_or_else(|| name.clone(), |unit| format!("{name} [{unit}]")))
            .collect();
        let text = format!(
            "\n{constants}    pattern {pattern} {{\n        amplitude {};\n        frequency {frequency} [rad/s];\n{lines}    }}\n",
            declared_amplitudes.join(", ")
        );
        let model = declared.with_statements("the model with the motion", &text)?.text().text().to_string();
        let sizes = amplitudes.values().map(|name| (name.clone(), 1.0));
        let values = sizes.chain([(frequency.clone(), motion.frequency)]).collect();
        let mut experiment: Experiment = session.experiment().clone();
        experiment.pattern = Some(pattern);
        experiment.schedule.multiples.clear();
        experiment.schedule.gains.clear();
        experiment.schedule.stages = vec![StageSection { values, ..StageSection::default() }];
        let samples = self.samples(session, motion)?;
        Ok(Files { model, experiment: experiment.text()?, samples })
    }

    /// One period, sample by sample.
    fn samples(&self, session: &Session, motion: &Trajectory) -> Result<String, EvalError> {
        let (plant, time) = (session.machine().plant(), session.experiment().control.sample_time);
        let dims = plant.dims();
        let of = |wrap: fn(&str) -> String| (0..dims.coordinates).map(move |c| wrap(plant.coordinate(c).name));
        let head: Vec<String> = std::iter::once("t".to_string())
            .chain(of(str::to_string))
            .chain(of(|name| format!("dot({name})")))
            .chain(of(|name| format!("ddot({name})")))
            .chain((0..dims.inputs).map(|input| plant.input(input).name.to_string()))
            .collect();
        let mut text = head.join(",") + "\n";
        let count = (2.0 * std::f64::consts::PI / (motion.frequency * time)).round() as usize;
        for (n, instant) in self.demand.along(plant, motion, count)?.into_iter().enumerate() {
            let _ = write!(text, "{}", number(n as f64 * time));
            for value in instant.motion.iter().chain(&instant.inputs) {
                let _ = write!(text, ",{}", number(*value));
            }
            text.push('\n');
        }
        Ok(text)
    }

    /// Positions, velocities, accelerations and inputs over one period, each from -1 to 1 between its limits, or over its own range
    /// without limits.
    ///
    /// # Errors
    /// [`EvalError`] when the inputs cannot be predicted.
    pub fn figure(&self, session: &Session, proposed: &Proposed) -> Result<Figure, EvalError> {
        let plant = session.machine().plant();
        let motion = &proposed.trajectory;
        let instants = self.demand.along(plant, motion, DRAWN)?;
        let period = 2.0 * std::f64::consts::PI / motion.frequency;
        let count = plant.dims().coordinates;
        let panel = |kind: &str, label: &str, place: &dyn Fn(&Instant, usize) -> f64| {
            let own: Vec<&Used> = proposed.used.iter().filter(|used| used.kind == kind).collect();
            let limited = own.iter().all(|used| used.limit.is_some());
            let traces = own.iter().enumerate().map(|(which, used)| {
                let [low, high] = used.limit.filter(|_| limited).unwrap_or(used.range);
                let (middle, reach) = (f64::midpoint(low, high), 0.5 * (high - low).max(f64::MIN_POSITIVE));
                let point = |(n, instant): (usize, &Instant)| {
                    (n as f64 / DRAWN as f64 * period, (place(instant, which) - middle) / reach)
                };
                Trace::new(&used.name, which, Curve::Line(instants.iter().enumerate().map(point).collect()))
            });
            let of = if limited { "of its limit" } else { "of its range" };
            Panel {
                x: Axis::linear("time [s]").from_to(0.0, period),
                y: Axis::linear(&format!("{label}, share {of}")),
                traces: traces.collect(),
            }
        };
        let panels = vec![
            panel("position", "position", &|instant, c| instant.motion[c]),
            panel("velocity", "velocity", &|instant, c| instant.motion[count + c]),
            panel("acceleration", "acceleration", &|instant, c| instant.motion[2 * count + c]),
            panel("input", "input", &|instant, input| instant.inputs[input]),
        ];
        Ok(Figure::new(&format!("{}: excitation", plant.name()), panels))
    }
}

/// The terms of a harmonic, each with its sign; nothing for zero.
fn term(line: &Line, frequency: &str) -> String {
    let angle = if line.harmonic == 1 { String::new() } else { format!("{}*", line.harmonic) };
    let of = |factor: f64, function: &str| match factor {
        0.0 => String::new(),
        factor => {
            let sign = if factor < 0.0 { '-' } else { '+' };
            format!(" {sign} {}*{function}({angle}{frequency}*t)", factor.abs())
        }
    };
    of(line.cos, "cos") + &of(line.sin, "sin")
}

/// A number with nine digits, which are more than a drive resolves.
fn number(value: f64) -> String {
    let text = format!("{value:.9}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".to_string() } else { short.to_string() }
}
