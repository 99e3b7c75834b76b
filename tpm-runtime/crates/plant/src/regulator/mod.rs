//! Regulators: state feedback that keeps a machine at rest in a point, with its poles and its margins.

mod controllability;
mod design;
mod margins;
mod optimal;

pub use controllability::{Mode, unreached_modes};
pub use design::{Design, DesignError, Rates, Weighted, design};
pub use margins::{Margins, margins};
pub(crate) use optimal::held;
pub use optimal::{ContinuousRegulator, Regulator, RegulatorWeights};
