//! The macros `model!` and `model_file!`, which declare a dynamics model and emit its estimator.
//!
//! Both are re-exported by `tpm-runtime`, whose documentation shows them at work. Everything they do is in `tpm-codegen`, an
//! ordinary library; a crate of macros can export nothing else.

use std::path::Path;

/// Declares a dynamics model in place: `model! { model Name { ... } }`.
///
/// It expands to a public module, named as the model in small letters, and the model's type, `name::Name`. The module holds
/// structures with named fields for parameters, constants, motion, amplitudes and harmonics, and straight-line functions for
/// the reference motion, the regressor, the feed-forward, the estimator matrix and the solution. The code is generic over `f32`
/// and `f64`, needs neither the standard library nor an allocator, and cannot panic.
///
/// After `eliminate ... as c` the module is that of what remains: `Parameters` are c1, c2, ..., `Physical::lump` gives them
/// from the declared parameters, and motions reach to the derivatives that the elimination brought in.
///
/// Dynamics are always exact. The estimator matrix is exact too, but for what the model declares: `taylor q about q0 order n`
/// replaces functions that do not expand finitely by their Taylor polynomials, and `harmonics n` says how many harmonics are
/// kept of terms with infinitely many (signs, absolute values; 31 when nothing is declared). The module's documentation
/// names each replacement and bounds the harmonics left out. A pattern without a table, because a coordinate has no motion or a
/// function neither expands nor has a declared order, gives a module without estimator matrix and harmonics, which says why.
///
/// `model! { crate = path::to::runtime; model Name { ... } }` says where the runtime is when it is not `::tpm_runtime`.
#[proc_macro]
pub fn model(input: proc_macro::TokenStream) -> proc_macro::TokenStream {
    tpm_codegen::inline::model(input.into()).into()
}

/// Declares the dynamics model of a `.tpm` file: `model_file!("path/to/model.tpm")`, relative to the package's folder.
///
/// It expands to what `model!` expands to, and a change of the file rebuilds the crate.
/// `model_file!("path/to/model.tpm", crate = path::to::runtime)` says where the runtime is when it is not `::tpm_runtime`.
#[proc_macro]
pub fn model_file(input: proc_macro::TokenStream) -> proc_macro::TokenStream {
    let folder = std::env::var_os("CARGO_MANIFEST_DIR");
    tpm_codegen::inline::model_file(input.into(), folder.as_deref().map(Path::new)).into()
}
