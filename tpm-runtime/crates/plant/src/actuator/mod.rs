//! Actuators: whether the motors of a machine can follow a motion, and which feed-forward makes the best use of them
//! (Feng, chapter 6 and appendix C).
//!
//! Every input u_i drives a coordinate of its own. Its *motion-independent* part is the reaction that holds this coordinate
//! still while the others move, its *motion-dependent* part is the rest ([`Demand`]). The bandwidth of the amplifier
//! limits how fast a permanent-magnet motor ([`Motor`]) gives the first part; inertia and speed limit the second. Both
//! parts determine current, voltage and power along a pattern ([`requirements`]), the fastest and largest feasible
//! motion ([`bound()`]), and the tracking error of a loop whose low pass filters both parts ([`Drive`]; Figures 6.3 to
//! 6.5).

mod bounds;
mod demand;
mod drive;
mod figure;
mod file;
mod limited;
mod loop_file;
mod motor;
mod mounted;
mod placed;
mod requirement;

pub use bounds::{Bound, bound, scaled};
pub use demand::{Demand, Parts};
pub use drive::{Drive, DriveError, LoopPoles, Scheme, Tracking};
pub use figure::{torque_speed, tracking_errors};
#[cfg(feature = "schema")]
pub use file::schema as motor_schema;
pub use file::{MotorFile, Motors};
pub use limited::Limited;
pub use loop_file::LoopFile;
pub use motor::{Amplifier, Amplitudes, Limit, Limits, Motor};
pub use mounted::strongest;
pub use mounted::{Cut, LimitUse, Mounted};
pub use placed::FileFault;
pub use requirement::{CutOff, Harmonic, Peak, Requirement, Sample, requirements};

#[cfg(test)]
pub(crate) mod tests {
    use tpm_controller::model::{Buffer, Dims, EvalError, Label, Model, require_len, store};

    /// M, m L, m L^2 of Feng, section 6.3: M = 10 kg and m = 1 kg together, L = 0.4 m.
    pub(crate) const FENG: [f64; 3] = [11.0, 0.4, 0.16];

    /// Feng, Eqns 6.6 and 6.7 by hand, in M + m, m L and m L^2.
    pub(crate) struct CartPendulum;

    impl Model<f64> for CartPendulum {
        fn name(&self) -> &str {
            "CartPendulum"
        }
        fn dims(&self) -> Dims {
            Dims { coordinates: 2, order: 2, inputs: 2, rows: 2, parameters: 3, constants: 0 }
        }
        fn coordinate(&self, index: usize) -> Label<'_> {
            if index == 0 { Label::new("x", "m") } else { Label::new("theta", "rad") }
        }
        fn input(&self, index: usize) -> Label<'_> {
            if index == 0 { Label::new("F", "N") } else { Label::new("tau", "N*m") }
        }
        fn parameter(&self, index: usize) -> Label<'_> {
            Label::bare(["M_m", "m_L", "m_L_2"].get(index).copied().unwrap_or(""))
        }
        fn constant(&self, _: usize) -> Label<'_> {
            Label::bare("")
        }
        fn row(&self, index: usize) -> Label<'_> {
            self.input(index)
        }
        fn workspace_len(&self) -> usize {
            0
        }
        fn regressor(&self, motion: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
            require_len(Buffer::Motion, motion.len(), 6)?;
            let (sin, cos) = motion[1].sin_cos();
            let (speed, xdd, thdd) = (motion[3], motion[4], motion[5]);
            store(&[xdd, thdd * cos - speed * speed * sin, 0.0, 0.0, xdd * cos, thdd], out)
        }
        fn known(&self, _: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
            store(&[0.0, 0.0], out)
        }
        fn input_map(&self, _: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
            store(&[1.0, 0.0, 0.0, 1.0], out)
        }
    }
}
