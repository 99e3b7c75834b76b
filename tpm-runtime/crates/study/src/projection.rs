//! Projection of the parameters of one model onto those of another with the same coordinates and inputs, by least
//! squares of the forces along a motion.
//!
//! Invariant: every input has the same weight, since its forces are divided by their root mean square over all motions,
//! and so has every motion. Wanted parameters that the motion does not show, or that the known ones leave undetermined,
//! have no value.

use num_complex::Complex;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use tpm_campaign::Stage;
use tpm_codegen::identified::PROJECTION_SCHEMA;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{EvalError, Model};
use tpm_estimate::named::EstimateReport;
use tpm_estimate::{CombinationReport, Estimate, Known, ParameterReport, Projector, ResidualOf, Status, no_result};
use tpm_experiment::ExperimentError;
use tpm_motion::trajectory::{HarmonicSeries, PatternError, Trajectory};
use tpm_numerics::fourier::analyse;
use tpm_numerics::singular::unit_columns;
use tpm_numerics::tail::chi_squared_upper;
use tpm_numerics::{DMatrix, DVector, root_mean_square, tolerance};
use tpm_physical::is_lumped;
use tpm_report::number;
use tpm_session::{
    DeclaredModel, ExperimentRequest, Identifiable as _, ModelFault, Session, SessionError, StoredResult,
};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::mechanics::unit::Unit;
use tpm_symbolic::number::rational::to_f64;
use tpm_symbolic::regressor::parameter_map::ParameterMap;

/// Number of samples in a period, in the middle of equal intervals.
const SAMPLES: usize = 1 << 12;

/// Direction of a projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Way {
    /// The parameters of the second model whose forces are nearest, in least squares, to those of the first.
    Onto,
    /// The parameters of the first model whose projection onto the second gives the parameters of the second.
    Back,
}

/// The motion along which forces are compared.
#[derive(Clone, Copy, Debug)]
pub enum ComparedMotion<'a> {
    /// A pattern by its name, or the first one when no name is given, of the first model, or of the second where the
    /// first has none. The values state its amplitudes and frequency.
    Pattern(Option<&'a str>),
    /// All stages of an experiment on one of the models. Its constants are used where the values state none.
    Stages(&'a Session),
}

/// The request of a projection.
#[derive(Clone, Debug)]
pub struct ProjectionRequest<'a> {
    /// The first model.
    pub from: &'a DeclaredModel,
    /// The second model.
    pub onto: &'a DeclaredModel,
    /// The direction of the projection.
    pub way: Way,
    /// Values by name: parameters and constants of both models, amplitudes and frequency. Values of wanted parameters
    /// are reported as priors beside the result.
    pub values: BTreeMap<String, f64>,
    /// A result of an identification that states the known parameters in place of the values.
    pub result: Option<&'a StoredResult>,
    /// The motion.
    pub motion: ComparedMotion<'a>,
}

/// Why a projection cannot be computed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProjectionError {
    /// The models have different inputs.
    #[error("the models do not have the same inputs: {from} has {}, {onto} has {}", .from_inputs.join(", "), .onto_inputs.join(", "))]
    Inputs {
        /// The first model.
        from: String,
        /// The second model.
        onto: String,
        /// Inputs of the first model.
        from_inputs: Vec<String>,
        /// Inputs of the second model.
        onto_inputs: Vec<String>,
    },
    /// A quantity has different units in the models.
    #[error("`{name}` is in {from} in one model and in {onto} in the other")]
    Units {
        /// The coordinate or input.
        name: String,
        /// Its unit in the first model.
        from: String,
        /// Its unit in the second model.
        onto: String,
    },
    /// The rows do not determine the inputs.
    #[error(
        "the rows of {model} do not give every input from the motion ({rows} rows, {inputs} inputs): forces can be compared where each \
         coordinate is driven; eliminate coordinates without an input"
    )]
    FreeRows {
        /// The model.
        model: String,
        /// Number of rows.
        rows: usize,
        /// Number of inputs.
        inputs: usize,
    },
    /// No model has a pattern.
    #[error("neither model has a pattern to move along")]
    NoPattern,
    /// The pattern does not exist.
    #[error(transparent)]
    Model(#[from] ModelFault),
    /// The pattern cannot be played.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// The experiment does not give a motion.
    #[error(transparent)]
    Experiment(#[from] Box<ExperimentError>),
    /// The motion does not prescribe a coordinate.
    #[error("the motion says nothing of the coordinate `{coordinate}` of {model}")]
    NoMotion {
        /// The coordinate.
        coordinate: String,
        /// The model.
        model: String,
    },
    /// Values are missing.
    #[error("there is no value of {}", .names.join(", "))]
    NoValue {
        /// What they belong to.
        names: Vec<String>,
    },
    /// A value is stated for a name that no model has.
    #[error(
        "`{name}` is no parameter or run-time constant of the models{} (these are {})",
        if *.stages { "; the experiment states the motion" } else { ", and no amplitude or frequency" },
        .known.join(", ")
    )]
    Unknown {
        /// The name.
        name: String,
        /// Whether the motion is that of an experiment.
        stages: bool,
        /// Names that are known.
        known: Vec<String>,
    },
    /// The result belongs to another model.
    #[error("the result is one of the model {found}, and the parameters of {expected} are the known ones")]
    OtherModel {
        /// Model of the result.
        found: String,
        /// Model of the known parameters.
        expected: String,
    },
    /// Known parameters are stated both as values and by a result.
    #[error("the result states the parameters of {model} already; leave out the values of {}", .names.join(", "))]
    Twice {
        /// Model of the known parameters.
        model: String,
        /// The parameters.
        names: Vec<String>,
    },
    /// The result has a parameter that the model does not have, or lacks one.
    #[error("the result is one of another version of the model {model}: the parameters {} are not in both", .names.join(", "))]
    OtherParameters {
        /// Name of the model.
        model: String,
        /// The parameters.
        names: Vec<String>,
    },
    /// The forces are not finite.
    #[error("the forces of {model} are not finite along the motion; choose smaller amplitudes")]
    NotFinite {
        /// The model.
        model: String,
    },
    /// A model refused an evaluation.
    #[error("the model cannot be evaluated: {0}")]
    Evaluation(#[from] EvalError),
}

/// A motion along which forces were compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MotionReport {
    /// Amplitudes, or the stage of the experiment.
    pub name: String,
    /// Fundamental frequency, rad/s.
    pub frequency: f64,
}

/// The largest harmonic of the unexplained force of an input.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MisfitHarmonic {
    /// The motion, from 1.
    pub motion: usize,
    /// Multiple of the motion's fundamental frequency.
    pub harmonic: usize,
    /// Amplitude, in the unit of the input.
    pub amplitude: f64,
}

/// The unexplained force of an input.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InputMisfit {
    /// Name of the input.
    pub input: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Root mean square of the force with the known parameters.
    pub force: f64,
    /// Root mean square of the unexplained force, unit of the input.
    pub unexplained: f64,
    /// Unexplained force as a share of the force; nothing for an input without a force, which has no weight.
    pub share: Option<f64>,
    /// The largest harmonic of the unexplained force; nothing where the unexplained force is rounding.
    pub harmonic: Option<MisfitHarmonic>,
}

/// Chi-squared test of whether the wanted parameters explain a larger number of known ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Consistency {
    /// Sum of squares of the residuals, in standard deviations of the known parameters.
    pub chi_squared: f64,
    /// Its degrees of freedom.
    pub degrees: usize,
    /// Probability of a sum at least as large by chance.
    pub chance: f64,
}

/// Parameters of one model from those of another. It serialises as `tpm.projection/1`, which every reader of an
/// identification's result accepts.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Projection {
    /// Name and version of the file format.
    pub schema: &'static str,
    /// Name of the model to which the parameters belong.
    pub model: String,
    /// Name of the model whose parameters were known.
    pub of: String,
    /// Direction of the projection.
    pub way: Way,
    /// The motions.
    pub motions: Vec<MotionReport>,
    /// Number of samples of every motion.
    pub samples: usize,
    /// Change of the projected force when only every second sample is used, as a share of the force.
    pub sampling: f64,
    /// Unexplained forces by input: those of the first model that the second does not explain or, in the direction
    /// `back`, those of the second that the projection of the first does not explain.
    pub inputs: Vec<InputMisfit>,
    /// Root mean square of the unexplained force as a share of the force, with equal weights of the inputs.
    pub residual: f64,
    /// Whether the known parameters are exact; all standard deviations are then zero.
    pub exact: bool,
    /// The parameters; their standard deviations follow from those of the known parameters.
    pub parameters: Vec<ParameterReport>,
    /// Directions that the motion does not show, or that the known parameters leave undetermined: weight by parameter.
    pub unobservable: Vec<BTreeMap<String, String>>,
    /// Combinations of unobservable parameters that have a value.
    pub combinations: Vec<CombinationReport>,
    /// Covariance of the parameters; nothing where unobservable.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// Covariance of every combination with all parameters, nothing where unobservable, and then with all combinations.
    pub combination_covariance: Vec<Vec<Option<f64>>>,
    /// Number of independent combinations that have a value.
    pub rank: usize,
    /// Condition number of the solved equations, their columns normalised, over the determined directions.
    pub condition: Option<f64>,
    /// In the direction `back`, the share of the first model's force that the second leaves out, where the result was
    /// identified with other weights than the projection's. The expected values of the parameters then differ, by an
    /// amount that the standard deviations do not contain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other_weights: Option<f64>,
    /// Test of whether the model explains the known parameters; nothing where these are exact, or no more than the
    /// wanted ones.
    pub consistency: Option<Consistency>,
    /// Whether the parameters are lumped ones.
    #[serde(skip)]
    pub lumped: bool,
}

impl Projection {
    /// What is missing of the requested result; nothing when the result is complete.
    #[must_use]
    pub fn shortfall(&self) -> Option<String> {
        if let Some(left_out) = self.other_weights {
            return Some(format!(
                "{} leaves {} % of the force of {} out, and the result was not weighed as forces are here: its values move with the weights, \
                 by more than deviations tell",
                self.of,
                number(100.0 * left_out),
                self.model
            ));
        }
        if self.parameters.iter().any(|parameter| parameter.status == Status::Untrusted) {
            return Some(no_result(self.residual, ResidualOf::Force));
        }
        let count = self.parameters.len();
        (self.rank < count).then(|| {
            format!("{} of {count} parameters' combinations follow, and nothing along the other directions", self.rank)
        })
    }
}

/// A model with everything that is needed to evaluate its forces.
struct Side<'a> {
    declared: &'a DeclaredModel,
    map: ParameterMap,
    constants: Vec<f64>,
}

/// Forces along all motions: one row for every motion, sample and input in the order of the first model, one column for
/// every parameter.
struct Forces {
    columns: DMatrix<f64>,
    /// The forces that do not depend on a parameter.
    known: DVector<f64>,
}

impl<'a> Side<'a> {
    fn new(declared: &'a DeclaredModel, value: &dyn Fn(&str) -> Option<f64>) -> Self {
        let model = declared.evaluated();
        let constants = (0..model.dims().constants).map(|i| value(model.constant(i).name).unwrap_or(f64::NAN));
        Side { declared, map: ParameterMap::new(declared.prepared()), constants: constants.collect() }
    }

    fn model(&self) -> &'a dyn Model<f64> {
        self.declared.evaluated()
    }

    fn inputs(&self) -> Vec<String> {
        (0..self.model().dims().inputs).map(|i| self.model().input(i).name.to_string()).collect()
    }

    /// Values of the parameters in which the model is linear; not a number where a value is missing.
    fn columns(&self, value: &dyn Fn(&str) -> Option<f64>) -> Vec<f64> {
        let model = &self.declared.prepared().model;
        self.map.evaluate(|symbol: Symbol| match &model.quantity(symbol).kind {
            Kind::Constant { value: Some(value) } => to_f64(value),
            _ => value(self.map.name(symbol)).unwrap_or(f64::NAN),
        })
    }

    /// The trajectory of the model's own coordinates.
    fn own(&self, motion: &Motion) -> Result<Trajectory, ProjectionError> {
        let model = self.model();
        let own = (0..model.dims().coordinates).map(|c| {
            let name = model.coordinate(c).name;
            motion.coordinates.get(name).cloned().ok_or_else(|| ProjectionError::NoMotion {
                coordinate: name.to_string(),
                model: model.name().to_string(),
            })
        });
        Ok(Trajectory { frequency: motion.frequency, coordinates: own.collect::<Result<_, _>>()? })
    }

    /// The forces along motions; `inputs` states the order of the inputs.
    fn forces(&self, motions: &[Motion], inputs: &[String]) -> Result<Forces, ProjectionError> {
        let model = self.model();
        let dims = model.dims();
        let order: Vec<usize> =
            inputs.iter().filter_map(|input| self.inputs().iter().position(|own| own == input)).collect();
        let rows = motions.len() * SAMPLES * dims.inputs;
        let (mut columns, mut known) = (DMatrix::zeros(rows, dims.parameters), DVector::zeros(rows));
        let mut scratch = vec![0.0; model.workspace_len()];
        let mut motion = vec![0.0; dims.motion_len()];
        let mut regressor = vec![0.0; dims.regressor_len()];
        let mut terms = vec![0.0; dims.rows];
        let mut map = vec![0.0; dims.input_map_len()];
        let mut at = 0;
        for own in motions {
            let trajectory = self.own(own)?;
            for n in 0..SAMPLES {
                trajectory.motion_at(n, SAMPLES, 0.5, &mut motion);
                model.regressor(&motion, &self.constants, &mut scratch, &mut regressor)?;
                model.known(&motion, &self.constants, &mut scratch, &mut terms)?;
                model.input_map(&motion, &self.constants, &mut scratch, &mut map)?;
                let mut sides =
                    DMatrix::from_row_slice(dims.rows, dims.parameters, &regressor).insert_column(dims.parameters, 0.0);
                sides.column_mut(dims.parameters).copy_from_slice(&terms);
                let finite = |matrix: &DMatrix<f64>| matrix.iter().all(|value| value.is_finite());
                let map = DMatrix::from_row_slice(dims.rows, dims.inputs, &map);
                if !finite(&sides) || !finite(&map) {
                    return Err(ProjectionError::NotFinite { model: model.name().to_string() });
                }
                let solved = map.lu().solve_mut(&mut sides);
                if !solved || !finite(&sides) {
                    return Err(self.free_rows());
                }
                for &input in &order {
                    columns.row_mut(at).copy_from(&sides.row(input).columns(0, dims.parameters));
                    known[at] = sides[(input, dims.parameters)];
                    at += 1;
                }
            }
        }
        Ok(Forces { columns, known })
    }

    fn free_rows(&self) -> ProjectionError {
        let dims = self.model().dims();
        ProjectionError::FreeRows { model: self.model().name().to_string(), rows: dims.rows, inputs: dims.inputs }
    }

    /// The unit of a coordinate or input.
    fn unit(&self, name: &str) -> Option<&Unit> {
        let model = &self.declared.prepared().model;
        let coordinate = model.coordinates.iter().find(|coordinate| coordinate.name == name);
        let input = || model.inputs().find(|symbol| model.quantity(*symbol).name == name);
        coordinate
            .map(|coordinate| coordinate.unit.as_ref())
            .or_else(|| input().map(|symbol| model.quantity(symbol).unit.as_ref()))
            .flatten()
    }
}

/// A motion of coordinates by their names.
struct Motion {
    name: String,
    frequency: f64,
    coordinates: BTreeMap<String, HarmonicSeries>,
}

/// The experiment in a file as a session with the first of some models, each with its own file, that it fits.
///
/// # Errors
/// [`SessionError`] of the first model, when it fits none.
pub fn fitting_experiment(path: &Path, models: &[(&DeclaredModel, &Path)]) -> Result<Session, SessionError> {
    let request = ExperimentRequest { file: Some(path.to_path_buf()), ..ExperimentRequest::default() };
    let mut fault = None;
    for &(model, file) in models {
        let fitting = Session::open(model.clone(), file, &request).and_then(|session| {
            let machine = session.machine();
            session.experiment().setup(machine.plant(), machine.pattern(), Hold::Zoh)?;
            Ok(session)
        });
        match fitting {
            Ok(session) => return Ok(session),
            Err(own) => {
                fault.get_or_insert(own);
            }
        }
    }
    Err(fault.unwrap_or_else(|| ExperimentError::NoStage.into()))
}

/// Projects the parameters of one model onto those of another.
///
/// # Errors
/// [`ProjectionError`] when the models do not fit together, values are missing, or the motion cannot be played.
pub fn projection(request: &ProjectionRequest<'_>) -> Result<Projection, ProjectionError> {
    let stated = |name: &str| {
        let of_experiment = || match request.motion {
            ComparedMotion::Stages(session) => session.experiment().constants.get(name).copied(),
            ComparedMotion::Pattern(_) => None,
        };
        request.values.get(name).copied().or_else(of_experiment)
    };
    // Check that models, stated values and known parameters fit together.
    let (from, onto) = (Side::new(request.from, &stated), Side::new(request.onto, &stated));
    fit_together(&from, &onto)?;
    known_names(request)?;
    let (given, wanted) = match request.way {
        Way::Onto => (&from, &onto),
        Way::Back => (&onto, &from),
    };
    missing(request, given, &stated)?;
    // Evaluate the forces of both models along all motions.
    let motions = motions(request, &stated)?;
    let inputs = from.inputs();
    let (mut rich, mut simple) = (from.forces(&motions, &inputs)?, onto.forces(&motions, &inputs)?);
    let known = known(request, given, &stated)?;
    // The forces of the known parameters, from which the weights of the inputs follow.
    let of_given = if request.way == Way::Onto { &rich } else { &simple };
    let (_, lengths) = unit_columns(of_given.columns.clone());
    let settled = known.settled(&lengths);
    let force = &of_given.columns * &settled + &of_given.known;
    if force.iter().any(|value| !value.is_finite()) {
        return Err(ProjectionError::NotFinite { model: given.model().name().to_string() });
    }
    // Weight the rows, so that every input has the same mean square.
    let count = inputs.len();
    let rms: Vec<f64> = (0..count).map(|i| root_mean_square(force.iter().skip(i).step_by(count).copied())).collect();
    let rows = (motions.len() * SAMPLES) as f64;
    let weight = |row: usize| if rms[row % count] > 0.0 { 1.0 / (rms[row % count] * rows.sqrt()) } else { 0.0 };
    for forces in [&mut rich, &mut simple] {
        for row in 0..forces.known.len() {
            forces.columns.row_mut(row).scale_mut(weight(row));
            forces.known[row] *= weight(row);
        }
    }
    // Solve the least squares in the requested direction.
    let offset = &rich.known - &simple.known;
    let projector = Projector::new(&rich.columns, &simple.columns, &offset);
    let (estimate, left) = match request.way {
        Way::Onto => (projector.forward(&known), None),
        Way::Back => {
            let (estimate, chi_squared, degrees) = projector.backward(&known);
            let tested = !known.is_exact() && degrees > 0;
            (estimate, tested.then_some((chi_squared, degrees)))
        }
    };
    // Compute the forces that the solution leaves unexplained.
    let found = DVector::from_column_slice(&estimate.values);
    let (of_rich, nearest) = match request.way {
        Way::Onto => (known.settled(projector.projected_scale()), found),
        Way::Back => (found.clone(), projector.apply(&found)),
    };
    let missed = match request.way {
        Way::Onto => &rich.columns * &of_rich + &offset - &simple.columns * &nearest,
        Way::Back => &simple.columns * (known.settled(projector.scale()) - &nearest),
    };
    // Repeat the projection with every second sample to measure the error of sampling.
    let every_second = |forces: &DMatrix<f64>| {
        let rows: Vec<usize> = (0..forces.nrows()).filter(|row| (row / count) % 2 == 0).collect();
        forces.select_rows(&rows) * f64::sqrt(2.0)
    };
    let columns = DMatrix::from_columns(std::slice::from_ref(&offset));
    let half = Projector::new(
        &every_second(&rich.columns),
        &every_second(&simple.columns),
        &every_second(&columns).column(0).into_owned(),
    );
    let weighed = rms.iter().filter(|rms| **rms > 0.0).count();
    let share = |rows: &DVector<f64>| rows.norm() / (weighed.max(1) as f64).sqrt();
    let sampling = share(&(&simple.columns * (half.apply(&of_rich) - &nearest)));
    // Collect the report.
    let misfits = (0..count).map(|i| {
        let label = from.model().input(i);
        misfit(label.name, label.unit, i, count, rms[i], &missed, rows.sqrt())
    });
    let misfits: Vec<InputMisfit> = misfits.collect();
    let estimate = Estimate { residual: share(&missed), ..estimate };
    let prior = wanted.columns(&stated).into_iter().map(|value| value.is_finite().then_some(value));
    let prior: Vec<Option<f64>> = prior.collect();
    let mut report = EstimateReport::new(wanted.model(), &prior, Some(&estimate));
    let left_out = share(&(&rich.columns * &of_rich + &offset - &simple.columns * &nearest));
    let equal = request.result.is_none_or(StoredResult::weighed_equally) || known.is_exact();
    let other_weights = (request.way == Way::Back && !equal && left_out > tolerance::FORCE).then_some(left_out);
    for parameter in report.parameters.iter_mut() {
        parameter.status = parameter.status.in_result(other_weights.is_none());
    }
    Ok(Projection {
        schema: PROJECTION_SCHEMA,
        model: wanted.model().name().to_string(),
        of: given.model().name().to_string(),
        way: request.way,
        motions: motions.iter().map(|m| MotionReport { name: m.name.clone(), frequency: m.frequency }).collect(),
        samples: SAMPLES,
        sampling,
        inputs: misfits,
        residual: estimate.residual,
        exact: known.is_exact(),
        parameters: report.parameters,
        unobservable: report.unobservable,
        combinations: report.combinations,
        covariance: report.covariance,
        combination_covariance: report.combination_covariance,
        rank: estimate.rank,
        condition: estimate.condition.is_finite().then_some(estimate.condition),
        other_weights,
        consistency: left.map(|(chi_squared, degrees)| Consistency {
            chi_squared,
            degrees,
            chance: chi_squared_upper(chi_squared, degrees),
        }),
        lumped: is_lumped(wanted.declared.prepared()),
    })
}

/// The unexplained force of an input. `missed` is weighted, so that the force of every input has the mean square one
/// over `root` squared.
fn misfit(
    input: &str,
    unit: Option<&str>,
    index: usize,
    count: usize,
    force: f64,
    missed: &DVector<f64>,
    root: f64,
) -> InputMisfit {
    let values: Vec<f64> = missed.iter().skip(index).step_by(count).map(|value| value * force * root).collect();
    let unexplained = root_mean_square(values.iter().copied());
    let largest = values.chunks_exact(SAMPLES).enumerate().flat_map(|(motion, values)| {
        let lines = analyse(values, 0, 1, SAMPLES / 2 - 1);
        let of = move |(harmonic, line): (usize, Complex<f64>)| MisfitHarmonic {
            motion: motion + 1,
            harmonic,
            amplitude: line.norm(),
        };
        lines.into_iter().enumerate().map(of)
    });
    let harmonic = largest.max_by(|a, b| a.amplitude.total_cmp(&b.amplitude));
    InputMisfit {
        input: input.to_string(),
        unit: unit.map(String::from),
        force,
        unexplained,
        share: (force > 0.0).then(|| unexplained / force),
        harmonic: harmonic.filter(|_| unexplained > tolerance::FORCE * force),
    }
}

/// Requires that two models have the same inputs, the same number of rows, and the same units of common quantities.
fn fit_together(from: &Side<'_>, onto: &Side<'_>) -> Result<(), ProjectionError> {
    let (from_inputs, onto_inputs) = (from.inputs(), onto.inputs());
    let set = |inputs: &[String]| inputs.iter().cloned().collect::<BTreeSet<String>>();
    if set(&from_inputs) != set(&onto_inputs) {
        let [from, onto] = [from, onto].map(|side| side.model().name().to_string());
        return Err(ProjectionError::Inputs { from, onto, from_inputs, onto_inputs });
    }
    for side in [from, onto] {
        let dims = side.model().dims();
        if dims.rows != dims.inputs {
            return Err(side.free_rows());
        }
    }
    let model = onto.model();
    let coordinates = (0..model.dims().coordinates).map(|c| model.coordinate(c).name.to_string());
    for name in coordinates.chain(onto_inputs) {
        if let (Some(one), Some(other)) = (from.unit(&name), onto.unit(&name))
            && one != other
        {
            return Err(ProjectionError::Units { name, from: one.to_string(), onto: other.to_string() });
        }
    }
    Ok(())
}

/// The model whose pattern is played: the first one that has a pattern.
fn patterned<'a>(request: &ProjectionRequest<'a>) -> Result<&'a DeclaredModel, ProjectionError> {
    let both = [request.from, request.onto];
    let found = both.into_iter().find(|declared| !declared.prepared().model.patterns.is_empty());
    found.ok_or(ProjectionError::NoPattern)
}

/// Requires that every stated value has a name of one of the models.
fn known_names(request: &ProjectionRequest<'_>) -> Result<(), ProjectionError> {
    let mut known: Vec<String> = Vec::new();
    for model in [request.from, request.onto].map(|declared| &declared.prepared().model) {
        let symbols = model.parameters().chain(model.run_time_constants());
        known.extend(symbols.map(|symbol| model.quantity(symbol).name.to_string()));
    }
    let stages = matches!(request.motion, ComparedMotion::Stages(_));
    if let ComparedMotion::Pattern(name) = request.motion {
        let declared = patterned(request)?;
        let pattern = declared.pattern(name)?;
        let symbols = pattern.amplitudes.iter().copied().chain([pattern.frequency]);
        known.extend(symbols.map(|symbol| declared.prepared().model.quantity(symbol).name.to_string()));
    }
    match request.values.keys().find(|name| !known.contains(name)) {
        Some(name) => {
            let known = known.into_iter().collect::<BTreeSet<_>>().into_iter().collect();
            Err(ProjectionError::Unknown { name: name.clone(), stages, known })
        }
        None => Ok(()),
    }
}

/// Requires that all needed values are stated.
fn missing(
    request: &ProjectionRequest<'_>,
    given: &Side<'_>,
    stated: &dyn Fn(&str) -> Option<f64>,
) -> Result<(), ProjectionError> {
    let mut names: Vec<String> = Vec::new();
    if request.result.is_none() {
        names.extend(given.map.parameters().iter().map(|&symbol| given.map.name(symbol).to_string()));
    }
    for declared in [request.from, request.onto] {
        let model = declared.evaluated();
        names.extend((0..model.dims().constants).map(|i| model.constant(i).name.to_string()));
    }
    if let ComparedMotion::Pattern(name) = request.motion {
        let declared = patterned(request)?;
        let (model, pattern) = (&declared.prepared().model, declared.pattern(name)?);
        let symbols = pattern.amplitudes.iter().copied().chain([pattern.frequency]);
        names.extend(symbols.map(|symbol| model.quantity(symbol).name.to_string()));
    }
    let mut seen = BTreeSet::new();
    names.retain(|name| stated(name).is_none() && seen.insert(name.clone()));
    if names.is_empty() { Ok(()) } else { Err(ProjectionError::NoValue { names }) }
}

/// The motions along which forces are compared.
fn motions(
    request: &ProjectionRequest<'_>,
    stated: &dyn Fn(&str) -> Option<f64>,
) -> Result<Vec<Motion>, ProjectionError> {
    match request.motion {
        ComparedMotion::Pattern(name) => {
            let declared = patterned(request)?;
            let (prepared, pattern) = (declared.prepared(), declared.pattern(name)?);
            let reference =
                tpm_interpret::pattern::of_rows(pattern, &prepared.model, &prepared.form, stated).map_err(|fault| {
                    match fault {
                        PatternError::NoValue { name } => ProjectionError::NoValue { names: vec![name] },
                        other => other.into(),
                    }
                })?;
            let names: Vec<String> = reference.amplitudes.iter().chain([&reference.frequency]).cloned().collect();
            let values: Vec<f64> = names.iter().filter_map(|name| stated(name)).collect();
            let amplitudes = &values[..reference.amplitudes.len()];
            let trajectory = reference.trajectory(amplitudes, values[amplitudes.len()]);
            let name = names.iter().zip(&values).map(|(name, value)| format!("{name} = {value}"));
            let name = name.collect::<Vec<_>>().join(", ");
            Ok(vec![named(name, declared.evaluated(), &reference.open(), trajectory)])
        }
        ComparedMotion::Stages(session) => {
            let machine = session.machine();
            let setup = session.experiment().setup(machine.plant(), machine.pattern(), Hold::Zoh).map_err(Box::new)?;
            if setup.procedure.stages.is_empty() {
                return Err(ProjectionError::Experiment(Box::new(ExperimentError::NoStage)));
            }
            let of = |(number, stage): (usize, &Stage)| {
                let pattern = machine.pattern();
                let open = stage.pattern(pattern).open();
                named(format!("stage {}", number + 1), machine.plant(), &open, stage.trajectory(pattern, 1.0))
            };
            Ok(setup.procedure.stages.iter().enumerate().map(of).collect())
        }
    }
}

/// A motion with the names of its coordinates, without those that are open.
fn named(name: String, model: &dyn Model<f64>, open: &[usize], trajectory: Trajectory) -> Motion {
    let moved = trajectory.coordinates.into_iter().enumerate().filter(|(c, _)| !open.contains(c));
    let coordinates = moved.map(|(c, series)| (model.coordinate(c).name.to_string(), series)).collect();
    Motion { name, frequency: trajectory.frequency, coordinates }
}

/// Values and covariance of the known parameters.
fn known(
    request: &ProjectionRequest<'_>,
    given: &Side<'_>,
    stated: &dyn Fn(&str) -> Option<f64>,
) -> Result<Known, ProjectionError> {
    let Some(result) = request.result else { return Ok(Known::exact(given.columns(stated))) };
    let model = given.model();
    if result.model() != model.name() {
        let (found, expected) = (result.model().to_string(), model.name().to_string());
        return Err(ProjectionError::OtherModel { found, expected });
    }
    let names: Vec<String> = (0..model.dims().parameters).map(|j| model.parameter(j).name.to_string()).collect();
    let of_result: Vec<&str> = result.names().collect();
    let lacking = names.iter().map(String::as_str).filter(|name| !of_result.contains(name));
    let strange = of_result.iter().copied().filter(|name| !names.iter().any(|own| own == name));
    let apart: Vec<String> = lacking.chain(strange).map(String::from).collect();
    if !apart.is_empty() {
        return Err(ProjectionError::OtherParameters { model: model.name().to_string(), names: apart });
    }
    let wanted = if request.way == Way::Onto { request.onto } else { request.from };
    let has = |declared: &DeclaredModel, name: &str| {
        let model = &declared.prepared().model;
        model.parameters().any(|symbol| model.quantity(symbol).name == name)
    };
    let twice = request.values.keys().filter(|name| has(given.declared, name) && !has(wanted, name));
    let twice: Vec<String> = twice.cloned().collect();
    if !twice.is_empty() {
        return Err(ProjectionError::Twice { model: model.name().to_string(), names: twice });
    }
    let (weights, values, covariance) = result.entries();
    let weight = |r: usize, c: usize| weights[r].get(&names[c]).copied().unwrap_or(0.0);
    Ok(Known {
        weights: DMatrix::from_fn(weights.len(), names.len(), weight),
        values: DVector::from_vec(values),
        covariance: covariance.dense().clone(),
    })
}
