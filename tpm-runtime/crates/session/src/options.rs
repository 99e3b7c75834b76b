//! What is known of a log, by the model's indices.

use crate::reading::RecordSettings;
use tpm_controller::model::Presliding;
use tpm_estimate::{Domain, Refine, Settings};
use tpm_motion::Dynamics;

/// Settings that a user may give for a log, with signals, constants and parameters by index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogOptions {
    /// How it is read.
    pub reading: RecordSettings,
    /// Known dynamics between the recorded inputs and the forces, by input; inputs past the end of the list have none.
    pub actuators: Vec<Dynamics>,
    /// What coordinates follow from that have no sensor, by coordinate; nothing, also where the list ends, for every other one.
    pub following: Vec<Option<Presliding<f64>>>,
    /// Whether harmonics or the time domain; harmonics of a log that repeats, when not given.
    pub domain: Option<Domain>,
    /// Whether the estimates are refined by simulating the model.
    pub refine: Refine,
    /// Values of the model's run-time constants, in its order and units.
    pub constants: Vec<f64>,
    /// What is known of the parameters, and how they are estimated from the equations of the log.
    pub estimation: Settings,
    /// Standard deviation of the zero of every coordinate, in its unit; nothing, also where the list ends, where the zero is exact.
    pub zero_deviations: Vec<Option<f64>>,
    /// Standard deviation of the gain of every input, as a share of it; nothing, also where the list ends, where the gain is exact.
    pub gain_deviations: Vec<Option<f64>>,
    /// Which of the priors in `estimation` were stated, so that a result names them where the log does not show a parameter; none where
    /// the list ends.
    pub stated: Vec<bool>,
}

impl LogOptions {
    /// The stated priors, in the model's order and units, nothing where none is stated.
    pub(super) fn stated_prior(&self) -> Vec<Option<f64>> {
        self.estimation.prior.iter().enumerate().map(|(j, value)| self.is_stated(j).then_some(*value)).collect()
    }

    /// States priors, in the model's order and units; parameters without one have the prior zero.
    pub(super) fn state(&mut self, prior: &[Option<f64>]) {
        self.stated = prior.iter().map(Option::is_some).collect();
        self.estimation.prior = prior.iter().map(|value| value.unwrap_or(0.0)).collect();
    }

    /// Whether a parameter has a stated prior.
    pub(super) fn is_stated(&self, parameter: usize) -> bool {
        self.stated.get(parameter).copied().unwrap_or(false)
    }

    /// These options of a log with what is known of the machine: constants, priors, held values, directions that no motion shows.
    pub(super) fn of_machine(mut self, machine: &Self) -> Self {
        self.constants.clone_from(&machine.constants);
        self.stated.clone_from(&machine.stated);
        self.estimation.prior.clone_from(&machine.estimation.prior);
        self.estimation.frozen.clone_from(&machine.estimation.frozen);
        self.estimation.hidden.clone_from(&machine.estimation.hidden);
        self.estimation.load.clone_from(&machine.estimation.load);
        self
    }
}
