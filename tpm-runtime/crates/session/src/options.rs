//! What is known of a log, by the model's indices.

use tpm_core::harmonics::Hold;
use tpm_estimate::{Domain, Frozen, Refine, Weights};
use tpm_log::ReadingSettings;
use tpm_motion::Dynamics;

/// Settings that a user may give for a log, with signals, constants and parameters by index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogOptions {
    /// How its columns become signals.
    pub reading: ReadingSettings,
    /// First sample to use (from 0); found when not given.
    pub from_sample: Option<usize>,
    /// Period in seconds; found when not given.
    pub period: Option<f64>,
    /// What happens to the inputs between samples.
    pub hold: Hold,
    /// Known dynamics between the recorded inputs and the forces, by input; inputs past the end of the list have none.
    pub actuators: Vec<Dynamics>,
    /// Whether harmonics or the time domain; harmonics of a log that repeats, when not given.
    pub domain: Option<Domain>,
    /// Highest harmonic; chosen from the spectrum when not given.
    pub harmonics: Option<usize>,
    /// Weights of the equations.
    pub weights: Weights,
    /// Whether the estimates are refined by simulating the model.
    pub refine: Refine,
    /// Values of the model's run-time constants, in its order.
    pub constants: Vec<f64>,
    /// Prior values of the parameters, in the model's order, nothing where none is stated; may be empty.
    pub prior: Vec<Option<f64>>,
    /// Parameters that are held at a value.
    pub frozen: Vec<Frozen>,
    /// Directions in parameter space that no motion shows, known beforehand; noise seems to show them.
    pub hidden: Vec<Vec<f64>>,
}
