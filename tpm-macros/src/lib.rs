//! Declares a dynamics model inside a Rust program: [`model!`] in place, [`model_file!`] in a file that other tools read too.
//!
//! A model is written down once, as equations with units, and becomes a module of plain functions over named fields: where the
//! reference is, which input it needs, and which parameters the measured harmonics give. Its faults are compile errors at the very
//! term.
//!
//! ```
//! tpm_macros::model! {
//!     crate = tpm_controller; // left out by users of `tpm-runtime`, which re-exports the macros
//!     model Slider {
//!         coordinate x [m];
//!         input u [N];
//!         parameter m [kg], d [N*s/m];
//!         m*ddot(x) + d*dot(x) = u;
//!         pattern { amplitude lambda [m]; frequency w [rad/s]; x = rest_to_rest(lambda, w, 3); }
//!     }
//! }
//! use slider::{Parameters, Pattern, feed_forward};
//!
//! # fn main() {
//! let motion = Pattern { lambda: 0.3, w: 3.0 }.reference(0.25); // after 0.25 s
//! let force = feed_forward(&motion, &Parameters { m: 2.0, d: 5.0 }).u;
//! assert_eq!(force, 2.0 * motion.x.ddot + 5.0 * motion.x.dot);
//! # }
//! ```
//!
//! The crate documentation of `tpm-codegen` describes the language. Everything that the macros do is in that ordinary library,
//! because a crate of macros can export nothing else.

use std::path::Path;

/// Declares a dynamics model in place: `model! { model Name { ... } }`.
///
/// It expands to a public module, named as the model in small letters, and the model's type, `name::Name`. The module holds
/// structures with named fields for parameters, constants, motion, amplitudes and harmonics, and straight-line functions for
/// the reference motion, the regressor, the feed-forward, the estimator matrix and the solution. The code is generic over `f32`
/// and `f64`, needs neither the standard library nor an allocator, and cannot panic.
///
/// After `eliminate ... as c` the module holds the equations that remain: `Parameters` are c1, c2, ..., `Physical::lump` computes
/// them from the declared parameters, and motions reach to the derivatives that the elimination brought in.
///
/// Dynamics are always exact. The estimator matrix is exact too, but for two declarations: `taylor q about q0 order n` replaces
/// functions that do not expand finitely by their Taylor polynomials, and `harmonics n` bounds the harmonics that are kept of terms
/// with infinitely many (signs, absolute values; 31 when nothing is declared). The module's documentation names each replacement
/// and bounds the harmonics left out. A pattern whose table does not exist, because a coordinate has no motion or a function neither
/// expands nor has a declared order, gives a module without estimator matrix and harmonics, and its documentation says why.
///
/// `model! { with(run, campaign); model Name { ... } }` asks for parts that are not made without being asked for, those of
/// `tpm generate --with`: `split`, `gravity`, `mass_matrix`, `forward_dynamics`, `base_regressor`, `estimator` (base parameters from any
/// motion), `run` (the declared parameters from one run), `linearised` (the same by the estimators `error` and `hill`), `numerical` (from
/// differences of runs), `campaign` (the machine identifies itself), `monitor` (is it still the same?); and `strokes` and
/// `forgetting`. What a model does not allow is an error on the word.
///
/// `filter(W[:Q], sample_time = T[, independent = W[:Q]]);` adds the feed-forward behind low passes (rad/s, quality, seconds), and
/// `identified(NAME = VALUE, ...);` the constant `IDENTIFIED` with a value for every parameter.
///
/// `model! { crate = path::to::runtime; model Name { ... } }` names the crate that the code uses, when it is not `::tpm_runtime`;
/// `crate = tpm_controller;` is enough for a controller.
#[proc_macro]
pub fn model(input: proc_macro::TokenStream) -> proc_macro::TokenStream {
    tpm_codegen::inline::model(input.into()).into()
}

/// Declares the dynamics model of a `.tpm` file: `model_file!("path/to/model.tpm")`, relative to the package's folder.
///
/// It expands to what `model!` expands to, and a change of the file rebuilds the crate.
/// `model_file!("path/to/model.tpm", crate = path::to::runtime)` names the crate that the code uses, when it is not `::tpm_runtime`, and
/// `model_file!("path/to/model.tpm", with(run, campaign))` asks for parts as `model!` does; `filter(...)` and
/// `identified(...)` stand there too.
#[proc_macro]
pub fn model_file(input: proc_macro::TokenStream) -> proc_macro::TokenStream {
    let folder = std::env::var_os("CARGO_MANIFEST_DIR");
    tpm_codegen::inline::model_file(input.into(), folder.as_deref().map(Path::new)).into()
}
