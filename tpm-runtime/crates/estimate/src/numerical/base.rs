//! The run with which perturbed runs of `numerical` are compared: its error, the noise of its lines, what its reference shows, and what
//! noise makes of its mean.

use super::perturbations::{Lines, Perturbations, Response};
use crate::along::Along;
use crate::error::EstimateError;
use crate::first_order::fed_back;
use crate::information::reduced;
use crate::noise::{noise_along, rounding_shares};
use crate::response::answer;
use crate::run::Run;
use crate::settings::Settings;
use crate::table::LineTable;
use num_complex::Complex;
use tpm_controller::model::Model;
use tpm_motion::trajectory::Trajectory;
use tpm_numerics::{DMatrix, tolerance};

/// A matrix holds about a run when secants have carried that run no farther than this, in steps.
const MOST_SECANT_STEPS: f64 = 2.0;

/// The run with which perturbed runs are compared.
#[derive(Clone)]
pub(super) struct Base {
    pub(super) reference: Trajectory,
    pub(super) parameters: Vec<f64>,
    pub(super) error: Lines,
    /// How much of the noise of every run since the matrix was begun is in the error: all of one run.
    pub(super) noise: Vec<f64>,
    pub(super) variance: Vec<Vec<f64>>,
    pub(super) perturbations: Perturbations,
    /// How far secants have carried the base from where M was measured, in steps.
    pub(super) moved: Vec<f64>,
    /// The other parameters that are free: each with a direction that no reference shows, in which its own component is one.
    pub(super) dependent: Vec<(usize, Vec<f64>)>,
    /// Entries that are zero in the exact table, per parameter and harmonic.
    pub(super) zero: Vec<Vec<bool>>,
    /// What noise makes of the mean of the error; nothing where it is not known.
    pub(super) shift: Option<MeanShift>,
    /// Rounding to counts that other runs on the reference repeat, per coordinate, as a share of the variance; and as much of it as the
    /// variance does not have already.
    pub(super) repeated: Vec<(f64, f64)>,
}

/// What the motion that noise causes makes of the means of the tracking error.
#[derive(Clone)]
pub(super) struct MeanShift {
    /// Per coordinate: for every parameter of value one and, last, for the known term.
    pub(super) coordinates: Vec<Vec<f64>>,
    /// Standard deviation of the whole, as a share of it.
    pub(super) uncertainty: f64,
}

impl MeanShift {
    fn new(
        model: &dyn Model<f64>,
        run: &Run<'_>,
        along: &Along,
        highest: usize,
    ) -> Result<Option<Self>, EstimateError> {
        let theta = &run.trial.parameters;
        let found = noise_along(model, run, along, theta, highest)?;
        let Some((rows, uncertainty)) = found.and_then(|noise| noise.shifts) else { return Ok(None) };
        let width = theta.len() + 1;
        let forces = DMatrix::from_fn(rows.len(), width, |row, j| Complex::new(rows[row][j], 0.0));
        let moved = answer(along, run.trial, theta, run.hold, 0, &forces);
        let of = |moved: DMatrix<Complex<f64>>| {
            let coordinates = moved.row_iter().map(|row| row.iter().map(|shift| shift.re).collect()).collect();
            MeanShift { coordinates, uncertainty }
        };
        Ok(moved.map(of))
    }
}

impl Base {
    pub(super) fn new(
        model: &dyn Model<f64>,
        run: &Run<'_>,
        error: Lines,
        highest: usize,
        (response, bend): (Option<&Response>, f64),
        table: Option<&dyn LineTable>,
        settings: &Settings,
    ) -> Result<Self, EstimateError> {
        let dims = model.dims();
        let along = Along::of_trial(model, run.trial, highest, table)?;
        let force =
            run.spectra.lines.iter().skip(dims.coordinates).map(|lines| power(lines)).fold(0.0, f64::max).sqrt();
        let rounding = rounding_shares(run.spectra, run.hold, dims);
        let variance = with_rounding(run, &rounding, highest);
        let noise = variance.iter().flatten().sum::<f64>();
        // Square of the size of H^-1, row by row and harmonic by harmonic.
        let stiffness = |r: usize, k: usize| {
            let felt = along.response(r, &run.trial.parameters, k);
            let gain = fed_back(run.trial, &along, run.hold, r, k);
            felt.iter().zip(gain).map(|(j, gain)| (j + gain).norm_sqr()).sum::<f64>()
        };
        let size = |j: usize| {
            let felt = (0..dims.rows).map(|r| power(along.regressor(r, j))).fold(0.0, f64::max).sqrt();
            let whole = if felt > 0.0 && force > 0.0 { force / felt } else { 1.0 };
            let value = run.trial.parameters[j].abs();
            if value > 0.1 * whole { value } else { whole }
        };
        let alone = |j: usize| {
            let lines =
                (0..dims.rows).flat_map(|r| along.regressor(r, j).iter().enumerate().map(move |line| (r, line)));
            let moved = |(r, (k, line)): (usize, (usize, &Complex<f64>))| match stiffness(r, k) {
                stiffness if stiffness > 0.0 => line.norm_sqr() / stiffness,
                _ => 0.0,
            };
            lines.map(moved).sum::<f64>()
        };
        let zero = |j: usize| {
            let largest = (0..dims.rows).flat_map(|r| along.regressor(r, j)).map(|z| z.norm()).fold(0.0, f64::max);
            let line = |k: usize| {
                (0..dims.rows).all(|r| along.regressor(r, j)[k].norm() <= tolerance::REGRESSOR_LINE * largest)
            };
            (0..=highest).map(line).collect()
        };
        let (perturbed, dependent) = unknowns(settings, dims.parameters)?;
        let sizes: Vec<f64> = perturbed.iter().map(|&j| size(j)).collect();
        let alone: Vec<f64> = perturbed.iter().map(|&j| alone(j)).collect();
        Ok(Base {
            reference: run.trial.trajectory.clone(),
            parameters: run.trial.parameters.clone(),
            variance,
            moved: vec![0.0; perturbed.len()],
            perturbations: Perturbations::new(perturbed, &sizes, &alone, response, noise, bend),
            dependent,
            zero: (0..dims.parameters).map(zero).collect(),
            shift: MeanShift::new(model, run, &along, highest)?,
            repeated: rounding.iter().map(|(in_one, repeated)| (*repeated, f64::max(repeated - in_one, 0.0))).collect(),
            error,
            noise: vec![1.0],
        })
    }

    /// Whether a run has the reference of the base run. Open coordinates are not compared: their reference follows from the
    /// parameters.
    pub(super) fn is_of(&self, run: &Run<'_>) -> bool {
        self.reference.prescribes_as(&run.trial.trajectory, &run.trial.open)
    }

    /// A change of the parameters as one of the perturbed parameters alone, in steps: the others follow from directions that change no
    /// row.
    pub(super) fn in_steps(&self, change: &[f64]) -> Vec<f64> {
        let of = |&j: &usize| {
            let beside: f64 = self.dependent.iter().map(|(own, direction)| direction[j] * change[*own]).sum();
            change[j] - beside
        };
        let own: Vec<f64> = self.perturbations.parameters.iter().map(of).collect();
        self.perturbations.in_steps(&own)
    }

    /// Whether the exact table has zeros at a harmonic for all that a perturbed run changes.
    pub(super) fn is_zero(&self, run: usize, k: usize) -> bool {
        self.perturbations.change(run).all(|(j, change)| change == 0.0 || self.zero[j][k])
    }

    /// Highest harmonic of the error.
    pub(super) fn harmonics(&self) -> usize {
        self.error[0].len() - 1
    }

    /// Whether secants have carried M.
    pub(super) fn is_carried(&self) -> bool {
        squares(&self.moved) > 0.0
    }

    /// Whether M was measured about the base.
    pub(super) fn is_fresh(&self) -> bool {
        squares(&self.moved) <= MOST_SECANT_STEPS * MOST_SECANT_STEPS
    }

    /// The columns of all parameters, given those per step.
    pub(super) fn matrix(&self, columns: &[Lines]) -> Vec<Lines> {
        let none: Lines = self.error.iter().map(|lines| vec![Complex::new(0.0, 0.0); lines.len()]).collect();
        let mut matrix = vec![none; self.parameters.len()];
        for (&j, column) in self.perturbations.parameters.iter().zip(self.perturbations.by_parameter(columns)) {
            for (own, direction) in &self.dependent {
                for (sum, line) in matrix[*own].iter_mut().flatten().zip(column.iter().flatten()) {
                    *sum -= line * direction[j];
                }
            }
            matrix[j] = column;
        }
        matrix
    }
}

/// The parameters whose columns need a run, and those whose columns follow from hidden directions.
#[expect(clippy::type_complexity, reason = "a list of indices, and one of directions by their index")]
pub(super) fn unknowns(
    settings: &Settings,
    parameters: usize,
) -> Result<(Vec<usize>, Vec<(usize, Vec<f64>)>), EstimateError> {
    let free = settings.free(parameters)?;
    let dependent = reduced(settings.hidden.clone());
    let follows = |j: &usize| dependent.iter().any(|(own, _)| own == j);
    Ok((free.indices.into_iter().filter(|j| !follows(j)).collect(), dependent))
}

/// Variances of the error's lines: noise, and rounding to counts as far as it repeats with the motion.
pub(super) fn variances(model: &dyn Model<f64>, run: &Run<'_>, highest: usize) -> Vec<Vec<f64>> {
    with_rounding(run, &rounding_shares(run.spectra, run.hold, model.dims()), highest)
}

/// The same, given what rounding adds to every coordinate as a share of its noise.
fn with_rounding(run: &Run<'_>, shares: &[(f64, f64)], highest: usize) -> Vec<Vec<f64>> {
    let of = |(c, (rounding, _)): (usize, &(f64, f64))| {
        let peak = run.spectra.lines[c].iter().map(|line| line.norm()).fold(0.0, f64::max);
        let least = (tolerance::READING * peak).powi(2) + f64::MIN_POSITIVE;
        (0..=highest).map(|k| run.spectra.variance(c, k) * (1.0 + rounding) + least).collect()
    };
    shares.iter().enumerate().map(of).collect()
}

pub(super) fn power(lines: &[Complex<f64>]) -> f64 {
    lines.iter().map(|line| line.norm_sqr()).sum()
}

pub(super) fn squares(step: &[f64]) -> f64 {
    step.iter().map(|step| step * step).sum()
}
