//! The shipped machines: models with their experiments, on simulated machines whose parameters are known.

use crate::honesty::identify::parse;
use std::collections::BTreeMap;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::session::{Session, SessionError};

/// A model and its experiment.
#[derive(Clone, Copy, Debug)]
pub struct Shipped {
    /// What the machine is.
    pub name: &'static str,
    /// Text of the model.
    pub model: &'static str,
    /// Text of the experiment.
    pub experiment: &'static str,
}

/// System A: mass, spring and drag (Feng, Eqn 3.24).
pub const SYSTEM_A: Shipped = Shipped {
    name: "A, mass, spring and drag",
    model: include_str!("../../../models/mass_spring_drag.tpm"),
    experiment: include_str!("../../../models/mass_spring_drag.toml"),
};

/// System B: two carts, the far one prescribed (Feng, Eqns 4.30 and 4.31).
pub const SYSTEM_B: Shipped = Shipped {
    name: "B, two carts",
    model: include_str!("../../../models/two_carts.tpm"),
    experiment: include_str!("../../../models/two_carts.toml"),
};

/// The rotary pendulum hanging down (Fong, Eqn 26).
pub const PENDULUM: Shipped = Shipped {
    name: "rotary pendulum, hanging",
    model: include_str!("../../../models/rotary_pendulum_down.tpm"),
    experiment: include_str!("../../../models/rotary_pendulum_down.toml"),
};

impl Shipped {
    /// The experiment, to be changed.
    ///
    /// # Panics
    /// When the shipped file is wrong, which would be a fault of the file.
    #[must_use]
    pub fn experiment(&self) -> Experiment {
        Experiment::parse(self.experiment).expect("invariant: shipped experiments are right")
    }

    /// The machine with a changed experiment.
    ///
    /// # Errors
    /// The faults of the experiment.
    pub fn session(&self, experiment: Experiment) -> Result<Session, SessionError> {
        Session::new(parse(self.model)?, experiment, None, BTreeMap::new())
    }
}

/// Starts the estimates at the truth.
pub fn start_at_truth(experiment: &mut Experiment) {
    experiment.prior = experiment.plant.parameters.clone();
}

/// Takes the encoders away, and leaves white noise of this standard deviation on every coordinate that has a sensor.
pub fn white_sensors(experiment: &mut Experiment, noise: impl Fn(f64) -> f64) {
    for sensor in experiment.plant.sensors.values_mut() {
        sensor.noise = noise(sensor.noise);
        (sensor.counts, sensor.step) = (0.0, 0.0);
    }
}
