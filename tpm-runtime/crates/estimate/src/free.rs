//! The parameters that are estimated, apart from those that are held.

use crate::error::EstimateError;
use crate::settings::Settings;
use tpm_numerics::DMatrix;

/// Which of a model's parameters are estimated.
pub(super) struct Free {
    parameters: usize,
    /// Indices of the free parameters, ascending.
    pub(super) indices: Vec<usize>,
}

impl Settings {
    /// The parameters that are not held.
    ///
    /// # Errors
    /// [`EstimateError::Frozen`] when a parameter is held that does not exist, [`EstimateError::AllFrozen`] when all are held.
    pub(super) fn free(&self, parameters: usize) -> Result<Free, EstimateError> {
        if let Some(frozen) = self.frozen.iter().find(|frozen| frozen.parameter >= parameters) {
            return Err(EstimateError::Frozen(frozen.parameter));
        }
        let held = |j: &usize| self.frozen.iter().any(|frozen| frozen.parameter == *j);
        let indices: Vec<usize> = (0..parameters).filter(|j| !held(j)).collect();
        if indices.is_empty() && parameters > 0 {
            Err(EstimateError::AllFrozen)
        } else {
            Ok(Free { parameters, indices })
        }
    }

    /// Values of all parameters before anything is measured: their priors, zero where there is none, and held ones where they are held.
    pub(super) fn start(&self, parameters: usize) -> Vec<f64> {
        let mut values = self.prior.clone();
        values.resize(parameters, 0.0);
        self.hold(&mut values);
        values
    }

    /// Writes the values at which parameters are held.
    pub(super) fn hold(&self, values: &mut [f64]) {
        for frozen in &self.frozen {
            values[frozen.parameter] = frozen.value;
        }
    }
}

impl Free {
    /// The entries of the free parameters.
    pub(super) fn of(&self, whole: &[f64]) -> Vec<f64> {
        self.indices.iter().map(|&j| whole[j]).collect()
    }

    /// A direction of the free parameters as a direction of all, with zeros for those that are held.
    pub(super) fn spread(&self, part: &[f64]) -> Vec<f64> {
        let mut whole = vec![0.0; self.parameters];
        self.put(part, &mut whole);
        whole
    }

    /// A matrix over the free parameters as a matrix over all, with zeros for those that are held.
    pub(super) fn spread_square(&self, part: &DMatrix<f64>) -> DMatrix<f64> {
        let mut whole = DMatrix::zeros(self.parameters, self.parameters);
        for (a, &i) in self.indices.iter().enumerate() {
            for (b, &j) in self.indices.iter().enumerate() {
                whole[(i, j)] = part[(a, b)];
            }
        }
        whole
    }

    /// Writes the entries of the free parameters.
    pub(super) fn put(&self, part: &[f64], whole: &mut [f64]) {
        for (&j, &value) in self.indices.iter().zip(part) {
            whole[j] = value;
        }
    }
}
