//! The exact pseudo-inverse of a pattern's estimator matrix as numbers.

use crate::program::Program;
use tpm_controller::model::{Buffer, EvalError, require_len, split_workspace};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::pattern::PatternPlan;

/// The exact pseudo-inverse of a pattern's estimator matrix, ready to be evaluated: parameters from harmonics without a
/// decomposition.
#[derive(Clone, Debug)]
pub struct InterpretedInverse {
    /// Number of amplitudes plus one, for the frequency.
    symbols: usize,
    constants: usize,
    harmonics: usize,
    program: Program,
}

impl InterpretedInverse {
    /// Compiles the pseudo-inverse of a pattern's estimator matrix for evaluation; `None` where the pattern has none.
    /// `constants` are the constants of the model that are known at run time only.
    #[must_use]
    pub fn new(pattern: &PatternPlan, constants: &[Symbol]) -> Option<Self> {
        let (inverse, table) = (pattern.pseudo_inverse.as_ref()?, pattern.table.as_ref().ok()?);
        let symbols = pattern.amplitudes.iter().chain([&pattern.frequency]).chain(constants);
        let leaves: Vec<Leaf> =
            symbols.map(|&symbol| Leaf::Symbol(symbol)).chain((0..table.rows.len()).map(Leaf::Harmonic)).collect();
        Some(Self {
            symbols: pattern.amplitudes.len() + 1,
            constants: constants.len(),
            harmonics: table.rows.len(),
            program: Program::new(&inverse.plan, &leaves),
        })
    }

    /// Number of entries that a workspace needs.
    #[must_use]
    pub fn workspace_len(&self) -> usize {
        self.program.workspace_len
    }

    /// Least-squares estimates of the parameters from harmonics of the force along the pattern. `pattern` holds the
    /// amplitudes and the frequency, none of them zero; `harmonics` are in the order of the rows of the harmonic table.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has the wrong length.
    pub fn parameters(
        &self,
        pattern: &[f64],
        constants: &[f64],
        harmonics: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        require_len(Buffer::Pattern, pattern.len(), self.symbols)?;
        require_len(Buffer::Constants, constants.len(), self.constants)?;
        require_len(Buffer::Harmonics, harmonics.len(), self.harmonics)?;
        require_len(Buffer::Output, out.len(), self.program.output_len())?;
        let (scratch, _) = split_workspace(workspace, self.program.workspace_len)?;
        self.program.run(&[pattern, constants, harmonics], scratch, out);
        Ok(())
    }
}
