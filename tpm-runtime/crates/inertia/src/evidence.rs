//! What a result shows of an arm's physical parameters.

use crate::error::InertiaError;
use crate::nearest::Evidence;
use std::collections::{BTreeMap, BTreeSet};
use tpm_numerics::singular::{Singular, unit_columns};
use tpm_numerics::{Cholesky, DMatrix, DVector, tolerance};
use tpm_session::{DeclaredModel, StoredResult};
use tpm_symbolic::regressor::parameter_map::ParameterMap;

/// Rows W, values and covariance of W theta, by physical parameters.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    /// Names of all parameters: those of the model, then those asked for that no equation has.
    pub(crate) names: Vec<String>,
    /// What every row shows, by the columns of the model.
    pub(crate) weights: Vec<BTreeMap<String, f64>>,
    pub(crate) rows: DMatrix<f64>,
    pub(crate) values: DVector<f64>,
    pub(crate) covariance: DMatrix<f64>,
}

/// A parameter that the data show by itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Alone {
    pub(crate) value: f64,
    pub(crate) std: f64,
}

impl Shown {
    /// What a result shows, with columns for parameters that no equation has.
    pub(crate) fn new(
        model: &DeclaredModel,
        result: &StoredResult,
        also: impl IntoIterator<Item = String>,
    ) -> Result<Self, InertiaError> {
        let prepared = model.prepared();
        if result.model() != prepared.model.name {
            return Err(InertiaError::Model {
                found: result.model().to_owned(),
                expected: prepared.model.name.to_string(),
            });
        }
        let map = ParameterMap::new(prepared);
        if !map.is_linear() {
            return Err(InertiaError::Nonlinear);
        }
        let mut names: Vec<String> = map.parameters().iter().map(|symbol| map.name(*symbol).to_owned()).collect();
        let present: BTreeSet<String> = names.iter().cloned().collect();
        names.extend(also.into_iter().filter(|name| !present.contains(name)));
        let zero = |symbol| if map.parameters().contains(&symbol) { 0.0 } else { f64::NAN };
        let (jacobian, offsets) = (map.jacobian_at(zero), map.evaluate(zero));
        if jacobian.iter().flatten().chain(&offsets).any(|entry| !entry.is_finite()) {
            return Err(InertiaError::Nonlinear);
        }
        let (weights, values, covariance) = result.entries();
        // What a result says of inertias holds whatever its nonlinear parameters, such as a rate of friction, turn out to be.
        let nonlinear = prepared.model.nonlinear.iter().map(|own| &prepared.model.quantity(own.symbol).name);
        let nonlinear: BTreeSet<&str> = nonlinear.map(AsRef::as_ref).collect();
        let linear = |row: &usize| weights[*row].keys().all(|name| !nonlinear.contains(name.as_str()));
        let kept: Vec<usize> = (0..weights.len()).filter(linear).collect();
        if kept.is_empty() {
            return Err(InertiaError::Nothing);
        }
        let mut values: Vec<f64> = kept.iter().map(|&row| values[row]).collect();
        let covariance = covariance.dense().select_rows(&kept).select_columns(&kept);
        let weights: Vec<BTreeMap<String, f64>> = kept.into_iter().map(|row| weights[row].clone()).collect();
        let mut rows = DMatrix::zeros(weights.len(), names.len());
        for (row, weights) in weights.iter().enumerate() {
            for (column, weight) in weights {
                let at = map.columns().iter().position(|name| name == column);
                let at = at.ok_or_else(|| InertiaError::Parameter(column.clone()))?;
                jacobian[at].iter().enumerate().for_each(|(j, entry)| rows[(row, j)] += weight * entry);
                values[row] -= weight * offsets[at];
            }
        }
        Ok(Self { names, weights, rows, values: DVector::from_vec(values), covariance })
    }

    /// The index of a parameter.
    pub(crate) fn index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|own| own == name)
    }

    /// The value of a parameter that was held, where it stands alone in a row without variance.
    pub(crate) fn held(&self, parameter: usize) -> Option<f64> {
        let only = |row: &usize| {
            self.covariance[(*row, *row)] == 0.0
                && self.rows.row(*row).iter().enumerate().all(|(j, entry)| (*entry != 0.0) == (j == parameter))
        };
        (0..self.values.len()).find(only).map(|row| self.values[row] / self.rows[(row, parameter)])
    }

    /// The largest size that a positive parameter has in any of the sums that the data show, where it is in one.
    pub(crate) fn most(&self, parameter: usize) -> Option<f64> {
        let size = |row: usize| {
            let own = self.rows[(row, parameter)].abs();
            (own > 0.0).then(|| (self.values[row].abs() + self.covariance[(row, row)].max(0.0).sqrt()) / own)
        };
        (0..self.values.len()).filter_map(size).filter(|size| *size > 0.0).max_by(f64::total_cmp)
    }

    /// The parameters that the data show by themselves, in order.
    pub(crate) fn alone(&self) -> Vec<Option<Alone>> {
        let (scaled, lengths) = unit_columns(self.rows.clone());
        let found = Singular::new(&scaled, tolerance::RANK);
        let of = |j: usize| {
            let part = found.right.row(j).transpose();
            let shown = (part.norm_squared() - 1.0).abs() <= tolerance::STORED;
            shown.then(|| {
                let factors = &found.left * part.component_div(&found.values) / lengths[j];
                let variance = factors.dot(&(&self.covariance * &factors));
                Alone { value: factors.dot(&self.values), std: variance.max(0.0).sqrt() }
            })
        };
        (0..self.names.len()).map(of).collect()
    }

    /// The rows without variance have that of an exact number, `sizes` the sizes of the parameters.
    pub(crate) fn evidence(&self, sizes: &DVector<f64>) -> Result<Evidence, InertiaError> {
        let mut covariance = self.covariance.clone();
        for row in 0..self.values.len() {
            if covariance[(row, row)] == 0.0 {
                let parts: f64 = self.rows.row(row).iter().zip(sizes).map(|(entry, size)| (entry * size).abs()).sum();
                let size = parts.max(self.values[row].abs());
                covariance[(row, row)] = (tolerance::EXACT_DEVIATION * if size > 0.0 { size } else { 1.0 }).powi(2);
            }
        }
        let covariance = factored(covariance).ok_or(InertiaError::Covariance)?;
        Ok(Evidence { rows: self.rows.clone(), values: self.values.clone(), covariance })
    }
}

/// The Cholesky factor of a covariance, found with variances of one.
pub(crate) fn factored(covariance: DMatrix<f64>) -> Option<Cholesky<f64, tpm_numerics::Dyn>> {
    let deviations = covariance.diagonal().map(f64::sqrt);
    let scaled = DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |r, c| {
        covariance[(r, c)] / (deviations[r] * deviations[c])
    });
    let mut root = Cholesky::new(scaled)?.unpack();
    root.row_iter_mut().zip(deviations.iter()).for_each(|(mut row, deviation)| row *= *deviation);
    Some(Cholesky::pack_dirty(root))
}
