//! The machine that is simulated where a template has no log.

/// Numbers of a machine that is simulated and played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Start {
    /// The true values of the parameters. A campaign begins with half of the first one and with zero of the others; where a coordinate moves
    /// as the others move it, that motion is found with what is known before, which is half of each.
    pub(super) values: &'static [(&'static str, f64)],
    /// Gains of the feedback on the first coordinate.
    pub(super) kp: f64,
    pub(super) kd: f64,
    /// What the drive can do at most, and how far a run may be off.
    pub(super) most: f64,
    pub(super) off: f64,
    /// The amplitude of the slow stage; the fast one has twice as much.
    pub(super) amplitude: f64,
}
