//! A simulated machine: plant, sensors, drive and sampled control loop.

mod closed_loop_arm;
mod continuous;
mod drive;
mod regulate;
mod rig;
mod sensor;
mod simulation;
mod transmission;

pub use closed_loop_arm::{ArmGeometry, ClosedLoopArm};
pub use continuous::simulate_continuous;
pub use drive::drive;
pub use regulate::{Regulated, Regulation, regulate};
pub use rig::Rig;
pub use sensor::{Actuator, Sensor};
pub use simulation::{SimulatedRun, simulate};
