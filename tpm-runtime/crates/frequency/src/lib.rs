//! Identification in the frequency domain: excite, measure a frequency response, fit a model to it (Fong, section 3.2).
//!
//! Invariant: frequencies are angular, rad/s, unless a name or a text states Hz. A response belongs to the machine in
//! continuous time: the response of the input's hold is divided out once, where the frequency response is estimated.

mod basis;
mod bode;
mod excitation;
#[cfg(test)]
mod fit_tests;
mod orders;
#[cfg(test)]
mod pendulum_tests;
mod points;
mod rational;
mod record;
mod response;
mod structured;
mod transfer;

pub use bode::{BodeSettings, NamedModel, bode, bode_of_models};
pub use excitation::{Excitation, ExcitationError, Phases, crest_factor};
pub use orders::{OrderComparison, OrderError, OrderTrial, compare_orders};
pub use rational::{Delay, FitError, FitWarning, FittedValue, RationalFit, RationalSettings, Root, fit_rational};
pub use record::{RecordFitError, fit_record};
pub use response::{FrequencyResponse, Gap, HoldEffect, ResponseError, ResponseEstimator, ResponseLine, Welch};
pub use structured::{ResponseModel, StructuredFit, StructuredSettings, fit_structured};
pub use transfer::{TransferError, TransferFunction};

/// A complex number: a response, a pole, a zero.
pub type Complex = num_complex::Complex<f64>;
