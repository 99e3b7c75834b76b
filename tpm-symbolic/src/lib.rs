//! Exact algebra for the Trajectory Pattern Method.
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
//! Model --prepare--> RegressorForm --expand(Pattern)--> HarmonicTable --identifiability--> rank, directions
//!                    |             \--Plan------------> straight-line evaluation
//!                    \--ParameterMap--> lumped from physical parameters, and back
//! ```
//!
//! Around it stands the calculus that leads to such a model and from it: Euler-Lagrange equations ([`mechanics::lagrange`]), Taylor
//! series of what does not expand finitely ([`linear::taylor`]), signs and absolute values ([`harmonic::nonsmooth`]), linearisation
//! ([`linear::linearize`]).
//!
//! Nothing here knows of files, source text or floats, except for the one correct rounding at the edge
//! ([`number::rational::to_f64`]), the bounds of what a table leaves out of an infinite series, and Bessel functions, which are
//! not rational ([`harmonic::bessel`]).

pub mod algebra;
pub mod expr;
pub mod harmonic;
pub mod linear;
pub mod mechanics;
pub mod number;
pub mod plan;
pub mod regressor;
