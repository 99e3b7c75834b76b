//! The result that every estimator gives.

use crate::free::Free;
use crate::scale::Scale;
use crate::settings::Settings;
use crate::verdict::{Evidence, LARGE_RESIDUAL, POOR_DEVIATION, ResidualOf, Status, Verdict};
use tpm_numerics::{DMatrix, Matrix, root_mean_square};

/// The result that every estimator gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Value of every parameter, in the model's units. Along what the data do not show these are those of the prior, or zero where
    /// none was stated: combinations that the data show hold, but an unobservable parameter's value is no result
    /// ([`with_prior`](Self::with_prior) gives what was stated). Along a scale they are in a gauge of no meaning.
    pub values: Vec<f64>,
    /// Standard deviation of every parameter; infinite where unobservable, zero where frozen.
    pub std: Vec<f64>,
    /// Covariance, parameters x parameters, in the model's units; over the observable directions.
    pub covariance: Matrix,
    /// What may be said of every parameter.
    pub status: Vec<Status>,
    /// Rank of the equations: the number of independent combinations that the data show.
    pub rank: usize,
    /// Directions in parameter space that the data do not show, the largest component of each being one.
    pub unobservable: Vec<Vec<f64>>,
    /// Which of these are scales, along which parameters are multiplied by powers of a common factor.
    pub scales: Vec<Scale>,
    /// Condition number of the weighted equations after column scaling, over the observable directions.
    pub condition: f64,
    /// Root-mean-square residual as a share of what [`residual_of`](Self::residual_of) says.
    pub residual: f64,
    /// What the residual is a share of.
    pub residual_of: ResidualOf,
    /// Weighted sum of squared residuals per degree of freedom before any inflation; about one when the noise explains them.
    pub chi_squared: f64,
    /// Standard deviation that the model's own error adds to a harmonic of each row, units of the row.
    pub model_error: Vec<f64>,
}

/// What weighted least squares over the rows of a model gave.
pub(super) struct LeastSquares<'a> {
    /// Values of all parameters.
    pub(super) values: Vec<f64>,
    /// Covariance of all parameters.
    pub(super) covariance: DMatrix<f64>,
    /// Directions of the free parameters that the equations do not show.
    pub(super) hidden: &'a [Vec<f64>],
    /// Whether a free parameter belongs to one of them.
    pub(super) touched: &'a [bool],
    pub(super) rank: usize,
    pub(super) condition: f64,
    /// What is left of every row, as a share of its force.
    pub(super) row_residuals: &'a [f64],
    /// Largest share of a row's force that one unit of a parameter makes, by parameter.
    pub(super) felt: &'a [f64],
}

impl Estimate {
    /// The estimate that least squares over the rows of a model gave.
    pub(super) fn of_rows(free: &Free, found: LeastSquares<'_>) -> Self {
        let LeastSquares { values, covariance, hidden, touched, rank, condition, row_residuals, felt } = found;
        let verdict = Verdict::new(free, touched, &values, &covariance, |j, std| felt[j] * std);
        Estimate {
            values,
            std: verdict.std,
            covariance: Matrix::of(covariance),
            status: verdict.status,
            rank,
            unobservable: hidden.iter().map(|direction| free.spread(direction)).collect(),
            scales: Vec::new(),
            condition,
            residual: root_mean_square(row_residuals.iter().copied()),
            residual_of: ResidualOf::Force,
            chi_squared: 1.0,
            model_error: vec![0.0; row_residuals.len()],
        }
    }

    /// The estimate with values and covariance of all parameters that were found in another way. What is hidden, or held by the settings,
    /// stays as it is; `felt` gives the largest share of a row's force that a change of a parameter makes.
    pub(super) fn with_values(
        &self,
        values: Vec<f64>,
        covariance: Matrix,
        settings: &Settings,
        felt: impl Fn(usize, f64) -> f64,
    ) -> Self {
        let (mut std, mut status) = (self.std.clone(), self.status.clone());
        let held = |j: usize| settings.frozen.iter().any(|frozen| frozen.parameter == j);
        for j in (0..values.len()).filter(|&j| self.status[j] != Status::Unobservable && !held(j)) {
            std[j] = covariance[(j, j)].max(0.0).sqrt();
            let evidence = Evidence::Shown { value: values[j], std: std[j], felt: felt(j, std[j]) };
            status[j] = Status::of(evidence, POOR_DEVIATION);
        }
        let found = Estimate { values, std, covariance, status, ..self.clone() };
        self.scales.iter().fold(found, Estimate::along)
    }

    /// The estimate with values and covariance of all parameters that a simulation of the model gave. A parameter whose deviation was
    /// large beside its value, and which was nearly nothing and known to be, still is where its deviation has not grown.
    pub fn refined(&self, values: Vec<f64>, covariance: Matrix, settings: &Settings) -> Self {
        let nothing =
            |j: usize| self.status[j] == Status::Identified && self.std[j] > POOR_DEVIATION * self.values[j].abs();
        let felt = |j: usize, std: f64| if nothing(j) && std <= self.std[j] { 0.0 } else { f64::INFINITY };
        self.with_values(values, covariance, settings, felt)
    }

    /// The estimate of updates that have not settled: what the last one moved is one standard deviation more.
    pub fn moving(&self, moved: &[f64], settings: &Settings) -> Self {
        self.refined(self.values.clone(), self.covariance.moved_by(moved), settings)
    }

    /// The estimate of the first parameters alone, whatever the others are.
    pub fn of_first(&self, count: usize) -> Self {
        let first = |values: &[f64]| values.iter().take(count).copied().collect::<Vec<f64>>();
        let rows: Vec<Vec<f64>> = self.covariance.to_rows().iter().take(count).map(|row| first(row)).collect();
        let shown = |direction: &Vec<f64>| direction.iter().any(|component| component.abs() > 0.0);
        let before = |own: usize| self.unobservable[..own].iter().filter(|direction| shown(&first(direction))).count();
        let of_these = |scale: &&Scale| scale.powers.iter().skip(count).all(|power| *power == 0.0);
        let scale = |own: &Scale| Scale { direction: before(own.direction), powers: first(&own.powers) };
        Estimate {
            values: first(&self.values),
            std: first(&self.std),
            covariance: Matrix::from_rows(&rows).unwrap_or_else(|| self.covariance.clone()),
            status: self.status.iter().take(count).copied().collect(),
            unobservable: self.unobservable.iter().map(|direction| first(direction)).filter(shown).collect(),
            scales: self.scales.iter().filter(of_these).map(scale).collect(),
            ..self.clone()
        }
    }

    /// Whether the model explains what was measured: the residual is not above [`LARGE_RESIDUAL`].
    #[must_use]
    pub fn is_explained(&self) -> bool {
        self.residual <= LARGE_RESIDUAL
    }
}
