//! Names in the form that Rust uses.

use proc_macro2::Ident;
use tpm_symbolic::algebra::fourier::Trig;

use super::super::estimator::EstimatorSource;
use super::super::name::{Language, Namer};
use super::super::names::{self, Style, derivative_name, harmonic_name};

/// Types of emitted modules, and the names that they import. They are reserved: no name of a model may shadow them.
const TYPES: &str = "Accelerations Accumulator AccumulatorError BaseEstimate BaseEstimator BaseParameters Buffer Clone Constants Copy \
    Debug Default Dims Err Estimate EvalError Forces Harmonics Inputs Label Model Motion Ok Option Parameters Presliding \
    PartialEq Pattern Physical Real Result SampleFault Shown SingularMass SolveError SquareRoot T";

/// The names of an emitted module.
pub(super) type Names = names::Names<Ident>;

/// The names of one pattern.
pub(super) type PatternNames = names::PatternNames<Ident>;

/// Every name of the module.
pub(super) fn names(estimator: &EstimatorSource) -> Names {
    let mut types = Namer::new(Language::Rust, &TYPES.split(' ').collect::<Vec<_>>());
    let mut style = Style {
        language: Language::Rust,
        type_name: &mut |wanted, suffix| types.type_name(wanted, suffix),
        reserved: &["core", "filtered", "run", "std", "support"],
    };
    names::Names::new(&mut style, &estimator.model, &estimator.form, &estimator.plan).map(ident)
}

/// An identifier, raw where it must be.
pub(super) fn ident(name: &str) -> Ident {
    let span = proc_macro2::Span::call_site();
    match name.strip_prefix("r#") {
        Some(plain) => Ident::new_raw(plain, span),
        None => Ident::new(name, span),
    }
}

/// The field of a derivative.
pub(super) fn derivative_field(order: u32) -> Ident {
    ident(&derivative_name(order))
}

/// The field of a harmonic.
pub(super) fn harmonic_field(harmonic: usize, function: Trig) -> Ident {
    ident(&harmonic_name(harmonic, function))
}
