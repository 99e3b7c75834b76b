//! The rig of a simulated plant: its true parameters, sensors and actuators.

use crate::simulated::sensor::{Actuator, Sensor};

/// Sensors, actuators and integration of a simulated plant, with the true values of its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// True values of the parameters, in the model's order.
    pub parameters: Vec<f64>,
    /// Constants of the model.
    pub constants: Vec<f64>,
    /// One per coordinate.
    pub sensors: Vec<Sensor>,
    /// One per input.
    pub actuators: Vec<Actuator>,
    /// Integration steps per sample.
    pub sub_steps: usize,
    /// Seed of the noise; the number of the run selects a stream of it.
    pub seed: u64,
}
