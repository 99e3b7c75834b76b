//! A machine with values on one of its motions.

use std::fmt;
use tpm_motion::trajectory::Trajectory;
use tpm_physical::MotorizedMachine;
use tpm_report::number;

/// A machine with values, and the amplitudes and the frequency with which it moves.
#[derive(Debug)]
pub struct MovedMachine {
    /// Name of the model.
    pub model: String,
    /// The machine.
    pub machine: MotorizedMachine,
    /// Amplitudes of the pattern by their names, in its units.
    pub amplitudes: Vec<(String, f64)>,
    /// The frequency by its name, rad/s.
    pub frequency: (String, f64),
}

impl MovedMachine {
    /// Values of the amplitudes, in the pattern's order.
    #[must_use]
    pub fn sizes(&self) -> Vec<f64> {
        self.amplitudes.iter().map(|(_, value)| *value).collect()
    }

    /// The motion.
    #[must_use]
    pub fn trajectory(&self) -> Trajectory {
        self.machine.trajectory(&self.sizes(), self.frequency.1)
    }

    /// The title of a figure.
    pub(super) fn title(&self) -> String {
        format!("{}: {self}", self.model)
    }
}

/// The amplitudes and the frequency in words, such as `lambda = 0.1, w = 3`.
impl fmt::Display for MovedMachine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, value) in &self.amplitudes {
            write!(f, "{name} = {}, ", number(*value))?;
        }
        write!(f, "{} = {}", self.frequency.0, number(self.frequency.1))
    }
}
