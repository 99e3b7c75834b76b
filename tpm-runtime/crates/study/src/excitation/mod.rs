//! Excitation of mechanisms: motions under limits that show the base parameters well.
//!
//! Every coordinate moves as a finite Fourier series from rest to rest. The limits are those of the experiment; the inputs may use its share
//! of theirs, as predicted with the estimates that the experiment has.

mod criterion;
mod descent;
mod held;
mod motion;
mod problem;
mod search;
mod series;
mod settings;
#[cfg(test)]
mod tests;

pub use criterion::Criterion;
pub use motion::{Excitation, Files, FilesError, Proposed, Used};
pub use settings::{ExcitationError, ExcitationSettings, HARMONICS, STARTS};

use crate::design::estimates;
use problem::{MotionLimits, Problem};
use search::{Families, Searched, search};
use std::f64::consts::PI;
use tpm_campaign::Setup;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{EvalError, Model};
use tpm_experiment::ExperimentError;
use tpm_interpret::BaseRows;
use tpm_numerics::DMatrix;
use tpm_session::Session;

/// Seeks motions that show the base parameters of a mechanism well, within the limits of the session's experiment. `progress` sees how much of
/// the work is done, of how much, and says whether to go on; what was found by then is the result.
///
/// # Errors
/// [`ExcitationError`].
pub fn excitation(
    session: &Session,
    settings: &ExcitationSettings,
    progress: &(dyn Fn(usize, usize) -> bool + Sync),
) -> Result<Excitation, ExcitationError> {
    let (declared, machine, experiment) = (session.model(), session.machine(), session.experiment());
    let (model, prepared) = (machine.plant(), declared.prepared());
    if !prepared.model.eliminations.is_empty() {
        return Err(ExcitationError::Rows(
            "a mechanism with eliminated coordinates cannot be excited by series of its joints",
        ));
    }
    if !machine.pattern().open().is_empty() {
        return Err(ExcitationError::Rows(
            "every joint must have a motion of its own in the pattern, since every joint is driven",
        ));
    }
    let setup = experiment.setup(model, machine.pattern(), Hold::Zoh)?;
    let parameters = estimates(&setup, &experiment.bench(model)?);
    let rows = BaseRows::new(&prepared.model, &prepared.form, declared.parsed().mechanism.as_ref())?;
    let frequency = frequency(&setup, settings)?;
    let dims = rows.dims();
    if dims.order != 2 {
        return Err(ExcitationError::Rows(
            "the equations of a mechanism have accelerations as their highest derivatives",
        ));
    }
    let limits = limits(model, &setup)?;
    let centres: Vec<(f64, f64)> = limits.iter().map(|own| reach(own, frequency)).collect();
    let factors = factors(model, &setup.constants)?;
    let share = setup.procedure.effort_share;
    let efforts: Vec<f64> = setup.procedure.input_limits.iter().map(|limit| share * limit).collect();
    let weights = weights(settings.criterion, &efforts, dims.rows, &factors);
    let problem = Problem {
        rows: &rows,
        constants: &setup.constants,
        base: rows.lumped(&parameters),
        factors,
        efforts,
        limits,
        weights,
        criterion: settings.criterion,
        room: 1.0,
    };
    let families = Families::new(&centres, settings.harmonics, frequency, dims.order + 1);
    let searched = search(&problem, &families, &parameters, settings, progress)?;
    let Searched { tried, feasible, .. } = searched;
    if searched.found.is_empty() {
        let all = tried == settings.starts && feasible == 0;
        return Err(if all { ExcitationError::NoMotion { starts: tried } } else { ExcitationError::TooShort });
    }
    Ok(motion::excitation(session, &problem, parameters.clone(), settings, searched)?)
}

/// The fundamental frequency, rad/s, whose period is a whole number of samples.
fn frequency(setup: &Setup, settings: &ExcitationSettings) -> Result<f64, ExcitationError> {
    let wrong = |setting, value, must| Err(ExcitationError::Setting { setting, value, must });
    if settings.harmonics < 2 {
        return wrong(
            "highest harmonic",
            f64::from(settings.harmonics),
            "a motion from rest to rest needs two harmonics",
        );
    }
    let last = setup.procedure.stages.last().ok_or(ExperimentError::NoStage)?;
    let period = settings.period.unwrap_or(2.0 * PI / last.frequency);
    if !(period.is_finite() && period > 0.0) {
        return wrong("period", period, "it must be a positive number of seconds");
    }
    let sample_time = setup.control.sample_time;
    let samples = (period / sample_time).round();
    if samples < 20.0 * f64::from(settings.harmonics) {
        return wrong("period", period, "the highest harmonic needs twenty samples in its period");
    }
    Ok(2.0 * PI / (samples * sample_time))
}

/// The limits of every coordinate.
fn limits(model: &dyn Model<f64>, setup: &Setup) -> Result<Vec<MotionLimits>, ExcitationError> {
    let procedure = &setup.procedure;
    let of = |c: usize| {
        let limits = MotionLimits {
            position: procedure.position_bounds[c],
            velocity: procedure.velocity_bounds[c],
            acceleration: procedure.acceleration_bounds[c],
        };
        let coordinate = || model.coordinate(c).name.to_string();
        if limits.velocity.is_infinite() && limits.acceleration.is_infinite() {
            return Err(ExcitationError::NoLimit { coordinate: coordinate() });
        }
        if limits.position.0.is_finite() != limits.position.1.is_finite() {
            return Err(ExcitationError::OneSided { coordinate: coordinate() });
        }
        Ok(limits)
    };
    (0..model.dims().coordinates).map(of).collect()
}

/// Centre and reach of a coordinate: what its limits leave for the fundamental.
fn reach(limits: &MotionLimits, frequency: f64) -> (f64, f64) {
    let [(centre, position), (_, velocity), (_, acceleration)] = limits.of_orders();
    (centre, position.min(velocity / frequency).min(acceleration / (frequency * frequency)))
}

/// The inputs from the rows: the inverse of the input map, which must not depend on the motion.
fn factors(model: &dyn Model<f64>, constants: &[f64]) -> Result<Vec<f64>, ExcitationError> {
    const OTHERS: ExcitationError = ExcitationError::Rows(
        "every equation must have an input of its own, with a factor that does not depend on the motion",
    );
    let dims = model.dims();
    if dims.inputs != dims.rows {
        return Err(OTHERS);
    }
    let map = |position: f64| -> Result<DMatrix<f64>, EvalError> {
        let motion: Vec<f64> = (0..dims.motion_len()).map(|at| position * (1.0 + at as f64).sqrt()).collect();
        let (mut workspace, mut out) = (vec![0.0; model.workspace_len()], vec![0.0; dims.input_map_len()]);
        model.input_map(&motion, constants, &mut workspace, &mut out)?;
        Ok(DMatrix::from_row_slice(dims.rows, dims.inputs, &out))
    };
    let (still, moved) = (map(0.0)?, map(0.37)?);
    let inverse = (still == moved).then(|| still.try_inverse()).flatten().ok_or(OTHERS)?;
    Ok(inverse.transpose().as_slice().to_vec())
}

/// Square root of the weight of every row: one for the condition number; the reciprocal of what the row's inputs may give for the
/// determinant, since the noise of drives grows with their size.
fn weights(criterion: Criterion, efforts: &[f64], rows: usize, factors: &[f64]) -> Vec<f64> {
    let limited = efforts.iter().all(|limit| limit.is_finite());
    if criterion == Criterion::Condition || !limited {
        return vec![1.0; rows];
    }
    let of = |row: usize| {
        let shares = efforts.iter().zip(factors.chunks_exact(rows)).map(|(limit, factors)| factors[row].abs() / limit);
        shares.fold(0.0, f64::max)
    };
    (0..rows).map(of).collect()
}
