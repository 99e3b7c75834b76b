//! The rows of a model on which inputs act.

use tpm_controller::model::{EvalError, Model};

/// Collects the rows on which an input acts, over the instants seen so far.
pub struct Driven {
    driven: Vec<bool>,
    map: Vec<f64>,
    scratch: Vec<f64>,
}

impl Driven {
    /// The collection before the first instant.
    pub fn new(model: &dyn Model<f64>) -> Self {
        let dims = model.dims();
        Driven {
            driven: vec![false; dims.rows],
            map: vec![0.0; dims.input_map_len()],
            scratch: vec![0.0; model.workspace_len()],
        }
    }

    /// Takes in the motion of an instant.
    ///
    /// # Errors
    /// [`EvalError`] when the slices do not fit the model.
    pub fn see(&mut self, model: &dyn Model<f64>, motion: &[f64], constants: &[f64]) -> Result<(), EvalError> {
        model.input_map(motion, constants, &mut self.scratch, &mut self.map)?;
        let rows = self.map.chunks_exact(model.dims().inputs.max(1));
        for (driven, row) in self.driven.iter_mut().zip(rows) {
            *driven |= row.iter().any(|factor| factor.abs() > 0.0);
        }
        Ok(())
    }

    /// The rows on which no input acted.
    pub fn without_input(&self) -> Vec<usize> {
        (0..self.driven.len()).filter(|&row| !self.driven[row]).collect()
    }
}
