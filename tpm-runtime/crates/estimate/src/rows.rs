//! The rows of a model at one instant of a motion.

use tpm_controller::model::{EvalError, Model};

/// A model with what is known when it is evaluated.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    pub(crate) model: &'a dyn Model<f64>,
    pub(crate) constants: &'a [f64],
}

/// Memory of one evaluation.
pub(crate) struct Scratch {
    work: Vec<f64>,
    pub(crate) regressor: Vec<f64>,
    pub(crate) known: Vec<f64>,
    pub(crate) map: Vec<f64>,
}

impl Rows<'_> {
    pub(crate) fn scratch(self) -> Scratch {
        let dims = self.model.dims();
        Scratch {
            work: vec![0.0; self.model.workspace_len()],
            regressor: vec![0.0; dims.regressor_len()],
            known: vec![0.0; dims.rows],
            map: vec![0.0; dims.input_map_len()],
        }
    }

    pub(crate) fn evaluate(self, instant: &[f64], scratch: &mut Scratch) -> Result<(), EvalError> {
        self.model.regressor(instant, self.constants, &mut scratch.work, &mut scratch.regressor)?;
        self.sides(instant, scratch)
    }

    /// The rows at motions that stand one behind the other: `take` is given the number of a motion, and its rows.
    pub(crate) fn each(self, motions: &[f64], mut take: impl FnMut(usize, &Scratch)) -> Result<(), EvalError> {
        let slots = self.model.dims().motion_len();
        let (mut of_rows, mut at) = (self.scratch(), self.scratch());
        let mut done = Ok(());
        let Scratch { work, regressor, known, .. } = &mut of_rows;
        self.model.rows_along(motions, self.constants, work, (regressor, known), &mut |i, phi, known| {
            at.regressor.copy_from_slice(phi);
            at.known.copy_from_slice(known);
            let instant = &motions[i * slots..(i + 1) * slots];
            match self.model.input_map(instant, self.constants, &mut at.work, &mut at.map) {
                Ok(()) => take(i, &at),
                Err(error) => done = Err(error),
            }
        })?;
        done
    }

    /// The rows under inputs that may stand in them otherwise than alone.
    pub(crate) fn evaluate_under(
        self,
        instant: &[f64],
        inputs: &[f64],
        scratch: &mut Scratch,
    ) -> Result<(), EvalError> {
        let Scratch { work, regressor, known, map } = scratch;
        self.model.rows_under(instant, inputs, self.constants, work, (regressor, known))?;
        self.model.input_map(instant, self.constants, work, map)
    }

    /// The rows without their regressor: known terms and factors of the inputs.
    pub(crate) fn sides(self, instant: &[f64], scratch: &mut Scratch) -> Result<(), EvalError> {
        let Scratch { work, known, map, .. } = scratch;
        self.model.known(instant, self.constants, work, known)?;
        self.model.input_map(instant, self.constants, work, map)
    }

    /// What a row does not owe to parameters: forces of inputs less known terms. Known terms and factors of inputs are those of all rows.
    pub(crate) fn right_of(self, (known, map): (&[f64], &[f64]), row: usize, inputs: &dyn Fn(usize) -> f64) -> f64 {
        let count = self.model.dims().inputs;
        (0..count).map(|i| map[row * count + i] * inputs(i)).sum::<f64>() - known[row]
    }

    /// What the parameters make in a row.
    pub(crate) fn made(self, scratch: &Scratch, row: usize, theta: &[f64]) -> f64 {
        let p = theta.len();
        scratch.regressor[row * p..(row + 1) * p].iter().zip(theta).map(|(phi, theta)| phi * theta).sum()
    }
}
