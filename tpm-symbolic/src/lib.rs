//! Exact algebra for the Trajectory Pattern Method: from the equations of a machine to the table of its harmonics.
//!
//! # What to call
//!
//! - **A table** of harmonic coefficients: [`regressor_form`](regressor::form::regressor_form) separates a model into
//!   columns, one for each parameter ([`prepare`](regressor::prepare::prepare) where coordinates are to be eliminated
//!   first), and [`expand`](harmonic::expand::expand) expands it under a pattern.
//! - **Ranks**: [`identifiability`](harmonic::identifiability::identifiability) determines which parameters, or which
//!   combinations, one or several patterns identify.
//! - **Physical parameters** behind lumped ones: [`ParameterMap`](regressor::parameter_map::ParameterMap).
//! - **A plan**: the operations, in order, that evaluate a regressor or a table; see [`plan`].
//!
//! Models come from the model language (the crate `tpm-codegen` reads it), from energies
//! ([`mechanics::lagrange`]), or are built by hand, as here: a mass with a spring and quadratic drag,
//! m x'' + c x'^2 + k x = F.
//!
//! ```
//! use tpm_symbolic::algebra::{fourier::Trig, polynomial::Monomial};
//! use tpm_symbolic::harmonic::{expand::expand, identifiability::{Experiment, identifiability}};
//! use tpm_symbolic::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
//! use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
//! use tpm_symbolic::number::rational::integer;
//! use tpm_symbolic::regressor::form::regressor_form;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut model = ExactModel { name: "Drag".to_owned(), ..ExactModel::default() };
//! let x = model.declare_coordinate("x", None);
//! let [m, c, k] = ["m", "c", "k"].map(|name| model.declare(name, None, Kind::Parameter));
//! let force = model.declare("F", None, Kind::Input);
//! let lambda = model.declare("lambda", None, Kind::Amplitude);
//! let w = model.declare("w", None, Kind::Frequency);
//!
//! // The terms of m x'' + c x'^2 + k x - F = 0.
//! let g = &mut model.graph;
//! let [position, velocity, acceleration] = [0, 1, 2].map(|order| g.derivative_of(x, order));
//! let square = g.pow(velocity, 2);
//! let [m, c, k, force] = [m, c, k, force].map(|symbol| g.symbol(symbol));
//! let terms = [g.mul(m, acceleration), g.mul(c, square), g.mul(k, position), g.neg(force)];
//! let terms = (1..).zip(terms).map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
//! model.equations.push(Equation { name: "eq1".to_owned(), terms });
//!
//! // The pattern x = lambda (cos w t - 1/9 cos 3 w t), which is at rest at both ends.
//! let motion = Motion::term(Monomial::power_of(lambda, 1), rest_to_rest(3)?);
//! let pattern = Pattern { name: None, amplitudes: vec![lambda], frequency: w, motions: vec![Some(motion)] };
//!
//! let form = regressor_form(&model)?;
//! let table = expand(&model, &form, &pattern)?;
//! // m enters the first harmonic of F with -1 lambda w^2 cos w t.
//! let first = table.entries().find(|entry| entry.harmonic == 1 && entry.column == Some(0)).ok_or("no entry")?;
//! assert_eq!((first.function, first.coefficient), (Trig::Cos, integer(-1)));
//! // The square of a motion with harmonics up to 3 reaches the sixth.
//! assert_eq!(table.highest_harmonic(0), 6);
//!
//! let found = identifiability(&[Experiment::of("one run", &model, &table)])?;
//! assert_eq!((found.rank, found.proven), (3, true));
//! # Ok(())
//! # }
//! ```
//!
//! # The problem
//!
//! A machine obeys equations that are linear in unknown parameters,
//!
//! ```text
//! sum_j theta_j phi_rj(q, q', q'', ...) = u_r ,        r = 1, 2, ...
//! ```
//!
//! and every coordinate is made to follow a finite Fourier series, such as
//! q = lambda (cos w t - 1/9 cos 3 w t), which is at rest at both ends. Then every regressor is itself a Fourier series,
//!
//! ```text
//! phi_rj = sum_i [ b_c(r,i,j) cos(i w t) + b_s(r,i,j) sin(i w t) ] prod lambda^a w^b ,
//! ```
//!
//! whose coefficients b are rational numbers that depend on nothing but the shape of the model and of the pattern
//! (D. Feng, dissertation, Eqns 3.13-3.17). The table of the b relates the harmonics of forces, tracking errors and
//! parameter errors. This crate computes it exactly:
//!
//! ```text
//! ExactModel --prepare--> RegressorForm --expand(Pattern)--> HarmonicTable --identifiability--> rank, directions
//!                    |             \--Plan------------> straight-line evaluation
//!                    \--ParameterMap--> lumped from physical parameters, and back
//! ```
//!
//! Further modules derive such models and use them: Euler-Lagrange equations ([`mechanics::lagrange`]), Taylor series
//! of terms that do not expand finitely ([`linear::taylor`]), signs and absolute values ([`harmonic::nonsmooth`]),
//! linearisation ([`linear::linearize`]).
//!
//! # What imports what
//!
//! [`budget`] < [`number`] < [`algebra`] < [`expr`] < [`mechanics`] < [`regressor`] < [`harmonic`] < [`plan`]: a folder imports from those
//! before it only. [`linear`] stands above [`mechanics`], beside the regressors.
//!
//! This crate does not use files or source text, and floats only for the one correct rounding of results
//! ([`number::rational::to_f64`]) and the bounds of truncation errors of infinite series.

pub mod algebra;
pub mod budget;
pub mod expr;
pub mod harmonic;
pub mod linear;
pub mod mechanics;
pub mod number;
pub mod plan;
pub mod regressor;
