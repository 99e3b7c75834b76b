//! The rows of a model at the samples themselves: a plain regression.
//!
//! A model without a derivative is a static map, whose rows `Phi(q) theta + known(q) = B u` hold at every sample by itself, in whatever order
//! the samples stand: they are all that there is, and least squares over them is the estimate. Of a model with derivatives the motion is
//! followed by polynomials over a few samples (Savitzky and Golay). Nothing is lost at the ends of a record, so that the shortest one will do;
//! but noise of the sensors stands in the regressor, so that the values are those from which a simulation begins, and no more.

use crate::error::EstimateError;
use crate::free::Free;
use crate::information::{Information, Solution};
use crate::local;
use crate::result::{Estimate, LeastSquares};
use crate::rows::Rows;
use crate::settings::Settings;
use crate::time_domain::{Stretch, TimeRecord, WEIGHING_PASSES};
use tpm_controller::model::Model;
use tpm_numerics::{DMatrix, DVector, Matrix};

/// An estimate from the rows at the samples.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Sampled {
    /// The estimate.
    pub estimate: Estimate,
    /// What is left of every row, as a share of its force.
    pub row_residuals: Vec<f64>,
    /// Samples that were used.
    pub samples: usize,
    /// Largest share of a row's force that one unit of a parameter makes, by parameter.
    felt: Vec<f64>,
}

impl Sampled {
    /// The estimate with other values and covariance, both of all parameters; `settings` say which are held.
    #[must_use]
    pub fn restated(&self, values: Vec<f64>, covariance: Matrix, settings: &Settings) -> Estimate {
        self.estimate.with_values(values, covariance, settings, |j, std| self.felt[j] * std)
    }
}

/// Whether a model has no derivative, so that its rows hold at every sample by itself.
#[must_use]
pub fn is_static(model: &dyn Model<f64>) -> bool {
    (0..model.dims().coordinates).all(|c| model.coordinate_order(c) == 0)
}

/// The equations of one row, one for every sample: columns of the free parameters, and behind them the right-hand side.
struct Row {
    entries: DMatrix<f64>,
    /// Mean square of the forces: of the right-hand side, or of all columns where it is zero throughout.
    force: f64,
}

/// Estimates the parameters in which a model is linear from its rows at every sample, the motion being followed by polynomials over
/// `2 reach + 1` samples; a motion of which no derivative is asked is taken as it is recorded.
///
/// # Errors
/// [`EstimateError::NoSignal`] when there are no samples, or they show nothing; [`EstimateError::Model`] and [`EstimateError::NotFinite`] when
/// the rows cannot be evaluated; [`EstimateError::Frozen`] and [`EstimateError::AllFrozen`] when parameters are held that do not exist, or
/// all.
pub fn estimate_sampled(
    model: &dyn Model<f64>,
    constants: &[f64],
    record: &TimeRecord<'_>,
    reach: usize,
    settings: &Settings,
) -> Result<Sampled, EstimateError> {
    let dims = model.dims();
    let free = settings.free(dims.parameters)?;
    let rows = equations(Rows { model, constants }, (record, reach), &free, settings)?;
    let samples = rows.first().map_or(0, |row| row.entries.nrows());
    let mut weights: Vec<f64> = rows.iter().map(|row| 1.0 / row.force.max(f64::MIN_POSITIVE)).collect();
    let mut values = settings.start(dims.parameters);
    let prior = free.of(&values);
    let known: Vec<Vec<f64>> = settings.hidden.iter().map(|direction| free.of(direction)).collect();
    let mut information = weighted(&rows, &weights);
    let mut solved = information.scaled().solve(&prior, None, &known);
    for _ in 0..WEIGHING_PASSES {
        for (row, weight) in rows.iter().zip(&mut weights) {
            *weight = 1.0 / (row.left(&solved.values) + f64::EPSILON * row.force).max(f64::MIN_POSITIVE);
        }
        information = weighted(&rows, &weights);
        solved = information.scaled().solve(&prior, None, &known);
    }
    if samples == 0 || solved.rank == 0 {
        return Err(EstimateError::NoSignal);
    }
    let equations = (samples * dims.rows) as f64;
    let freedom = equations / (equations - solved.rank as f64).max(1.0);
    let whole = free.spread_square(&(covariance(&rows, &weights, &solved) * freedom));
    free.put(&solved.values, &mut values);
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole).sqrt() } else { 0.0 };
    let row_residuals: Vec<f64> = rows.iter().map(|row| share(row.left(&solved.values), row.force)).collect();
    let felt: Vec<f64> = (0..dims.parameters)
        .map(|j| {
            let Some(at) = free.indices.iter().position(|&own| own == j) else { return 0.0 };
            let of = |row: &Row| share(row.entries.column(at).norm_squared() / row.entries.nrows() as f64, row.force);
            rows.iter().map(of).fold(0.0, f64::max)
        })
        .collect();
    let scaled = information.scaled();
    let estimate = Estimate::of_rows(
        &free,
        LeastSquares {
            values,
            covariance: whole,
            hidden: &solved.unobservable,
            touched: &scaled.touched(&solved.unobservable),
            rank: solved.rank,
            condition: scaled.condition(&known),
            row_residuals: &row_residuals,
            felt: &felt,
        },
    );
    Ok(Sampled { estimate, row_residuals, samples, felt })
}

impl Row {
    /// Mean square of what values leave.
    fn left(&self, values: &[f64]) -> f64 {
        self.residuals(values).norm_squared() / self.entries.nrows().max(1) as f64
    }

    fn residuals(&self, values: &[f64]) -> DVector<f64> {
        let n = values.len();
        self.entries.column(n) - self.entries.columns(0, n) * DVector::from_column_slice(values)
    }
}

/// The equations of all rows.
fn equations(
    of: Rows<'_>,
    (record, reach): (&TimeRecord<'_>, usize),
    free: &Free,
    settings: &Settings,
) -> Result<Vec<Row>, EstimateError> {
    let model = of.model;
    let dims = model.dims();
    let n = free.indices.len();
    let mut entries: Vec<Vec<f64>> = vec![Vec::new(); dims.rows];
    let mut scratch = of.scratch();
    for stretch in &record.stretches {
        let Some(motion) = motion(model, stretch, record.sample_time, reach) else { continue };
        for (k, instant) in motion.chunks_exact(dims.motion_len()).enumerate() {
            let inputs: Vec<f64> = stretch.inputs.iter().map(|input| input[k]).collect();
            of.evaluate_under(instant, &inputs, &mut scratch)?;
            for (row, own) in entries.iter_mut().enumerate() {
                let phi = |j: usize| scratch.regressor[row * dims.parameters + j];
                let held: f64 = settings.frozen.iter().map(|frozen| frozen.value * phi(frozen.parameter)).sum();
                own.extend(free.indices.iter().map(|&j| phi(j)));
                own.push(of.right_of((&scratch.known, &scratch.map), row, &|i| inputs[i]) - held);
            }
        }
    }
    let row = |(row, entries): (usize, Vec<f64>)| -> Result<Row, EstimateError> {
        if let Some(at) = entries.iter().position(|value| !value.is_finite()) {
            let name = |j: &usize| model.parameter(*j).name.to_string();
            let what = free.indices.get(at % (n + 1)).map_or_else(|| "known terms and inputs".to_owned(), name);
            return Err(EstimateError::NotFinite { row: model.row(row).name.to_string(), what });
        }
        let entries = DMatrix::from_row_iterator(entries.len() / (n + 1), n + 1, entries);
        let right = entries.column(n).norm_squared();
        let all: f64 = entries.columns(0, n).norm_squared();
        let force = if right > 0.0 { right } else { all } / entries.nrows().max(1) as f64;
        Ok(Row { entries, force })
    };
    entries.into_iter().enumerate().map(row).collect()
}

/// Motion and derivatives at every sample of a stretch, as a model reads them; nothing where the stretch is shorter than the polynomials.
fn motion(model: &dyn Model<f64>, stretch: &Stretch<'_>, sample_time: f64, reach: usize) -> Option<Vec<f64>> {
    let dims = model.dims();
    let mut motion = vec![0.0; stretch.samples() * dims.motion_len()];
    for (c, signal) in stretch.coordinates.iter().enumerate() {
        let order = model.coordinate_order(c);
        let own = match order {
            0 => signal.to_vec(),
            _ => local::derivatives(signal, sample_time, reach, order, 1)?,
        };
        for (instant, values) in motion.chunks_exact_mut(dims.motion_len()).zip(own.chunks_exact(order + 1)) {
            values
                .iter()
                .enumerate()
                .for_each(|(derivative, value)| instant[derivative * dims.coordinates + c] = *value);
        }
    }
    Some(motion)
}

/// What weighted rows say.
fn weighted(rows: &[Row], weights: &[f64]) -> Information {
    let n = rows.first().map_or(1, |row| row.entries.ncols());
    let of = |(row, weight): (&Row, &f64)| Information::of(&row.entries * weight.sqrt());
    rows.iter().zip(weights).map(of).reduce(|a, b| a.pool(&b)).unwrap_or_else(|| Information::empty(n - 1))
}

/// Covariance from what every equation leaves, whatever its variance (White 1980): the noise of a force often grows with the force.
fn covariance(rows: &[Row], weights: &[f64], solved: &Solution) -> DMatrix<f64> {
    let n = solved.values.len();
    let mut sum = DMatrix::zeros(n, n);
    for (row, weight) in rows.iter().zip(weights) {
        let mut scores = row.entries.columns(0, n).into_owned();
        for (mut own, left) in scores.row_iter_mut().zip(row.residuals(&solved.values).iter()) {
            own *= weight * left;
        }
        sum += scores.tr_mul(&scores);
    }
    &solved.covariance * sum * &solved.covariance
}
