//! Generates source code for a controller from a dynamics model, which is written only once.
//!
//! A model is a text of equations with units; here a mass with a spring and quadratic drag (Feng, Eqn 3.24). Its source in Rust or C
//! holds the reference motion, the feed-forward, and the estimator that finds the parameters from measured harmonics:
//!
//! ```
//! # #[cfg(feature = "generate")]
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use tpm_codegen::emit::estimator::EstimatorSource;
//! use tpm_codegen::generate::{Language, Options, generate};
//! use tpm_codegen::{Source, parse_model};
//!
//! let source = Source::new(
//!     "mass_spring_drag.tpm",
//!     "model MassSpringDrag {
//!          coordinate x [m];
//!          input u [N];
//!          parameter m [kg], k1 [N/m], k2 [N*s^2/m^2];
//!          m*ddot(x) + k1*x + k2*dot(x)^2 = u;
//!          pattern { amplitude lambda [m]; frequency w [rad/s]; x = rest_to_rest(lambda, w, 3); }
//!      }",
//! );
//! let parsed = parse_model(&source)?;
//! let files = generate(&EstimatorSource::new(parsed.model)?, &Options::new(Language::C, "an example"))?;
//! assert_eq!([&files[0].name, &files[1].name], ["mass_spring_drag.h", "mass_spring_drag.c"]);
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "generate"))]
//! # fn main() {}
//! ```
//!
//! A build script does this in one call ([`build::model`], and the example `build_script`). The macros of `tpm-macros`
//! and the command line `tpm` call this crate too. It converts between the text and the exact algebra of
//! `tpm-symbolic`:
//!
//! ```text
//! Source --lex, parse--> ast::ModelDeclaration --check--> names, structure, units --lower--> tpm_symbolic::mechanics::model::ExactModel
//! ExactModel --> emit::estimator::EstimatorSource --emit--> tables, Rust, C
//! ```
//!
//! Every stage collects all independent faults and reports them together as [`Diagnostics`], each at its place in the text or on
//! the user's tokens.
//!
//! # The language
//!
//! A source has one model. Comments begin with `//`. Keywords are contextual: a parameter may be called `as`, `type` or `model`.
//! `t` (the time) and `pi` are reserved. Statements end with `;`:
//!
//! | statement | meaning |
//! |---|---|
//! | `coordinate x [m], y [m];` | generalised coordinates |
//! | `unmeasured y [m];` | coordinates that no sensor measures, identified from logs with the parameters |
//! | `presliding z of q over 0.005;` | how far the friction of a coordinate has built up since it reversed |
//! | `input u [N];` | actuating forces, torques, voltages |
//! | `parameter m [kg], k [N/m];` | to be identified |
//! | `nonlinear parameter vs [m/s] from 0.01 to 0.5;` | to be identified from logs; may stand inside functions, within this interval, see [below](#nonlinear-parameters) |
//! | `constant g = 9.8 [m/s^2], th10 [rad];` | known exactly, or at run time only |
//! | `let s = x - x0;` | a name for an expression; uses only what is defined above it |
//! | `left = right;` | an equation of motion; both sides are expressions |
//! | `kinetic = ...; potential = ...; dissipation = ...;` | energies, and Rayleigh's dissipation function, instead of equations |
//! | `force q = ...;` | the generalised force on a coordinate; without one it is free, and its row is equal to 0 |
//! | `mechanism { ... }` | rigid bodies, joints and drives instead of equations, see [below](#mechanisms) |
//! | `series f(q) [unit] about q0 order n as a0, ..., an;` | an unknown function by its Taylor coefficients, which are parameters |
//! | `series f(q) = ... about q0 order n;` | a known function, replaced by its Taylor polynomial; `as` names the coefficients |
//! | `taylor q about q0 order n;` | for tables: terms that do not expand finitely in q become Taylor polynomials |
//! | `lump NAME = m*L^2;` | a name for a lumped parameter |
//! | `eliminate x1, x2 as c;` | eliminates free coordinates; what remains has parameters c1, c2, ... |
//! | `pattern NAME { ... }` | a reference motion; the name may be left out once |
//!
//! A change of coordinates is a `let`: `let th2 = alpha2 - pi;` and th2 and its derivatives may stand everywhere.
//!
//! A pattern has one `frequency w [rad/s];`, any number of amplitudes (`amplitude lambda [m];`), a motion for each coordinate that
//! is neither free nor eliminated, and `harmonics n;`, the number of harmonics kept of terms with infinitely many. A motion is a
//! finite Fourier series, `x = x0 + lambda*(cos(w*t) - 1/9*cos(3*w*t));`, or `rest_to_rest(lambda, w, n)` (derivatives 1 to n
//! vanish at both ends, n odd), or `point_to_point(x0, x1, w, n)`; the frequency may be an integer multiple, `3*w`.
//!
//! `shape(w, ...)` is the series that meets the end conditions of its clauses, exactly (Feng, Eqns 2.1 to 2.9):
//!
//! | clause | meaning |
//! |---|---|
//! | `start(x0, v0, ...)` | position, velocity and further derivatives with respect to time at the phase 0 |
//! | `end(pi, x1, v1, ...)` | the phase at which the motion ends, then position and derivatives there |
//! | `rest(n)` | derivatives 1 to n vanish at both ends, but for those that are given |
//! | `amplitude(lambda)` | the coefficient of the lowest cosine, for a motion whose travel is not given |
//! | `harmonics(1, 2)`, `cosines(1, 3)`, `sines(2)` | the harmonics that the series may have; without them, the lowest that meet the conditions |
//!
//! `shape(w, start(x0), end(pi, x1), rest(3))` is `point_to_point(x0, x1, w, 3)`, and `shape(w, start(0, v), end(pi/2, x1), rest(2))`
//! starts with a velocity and comes to rest after a quarter of the period. The end phase is a multiple of pi at which the harmonics
//! have rational cosines and sines, such as `pi` and `pi/2`, or `2*atan2(p, q)` with rational p and q. There is such a phase next to
//! every angle, and it is named where another one is refused. Harmonics that cannot meet the conditions are refused too, with the
//! condition and the least harmonics that can. What the conditions leave free goes to the least mean square of the acceleration.
//!
//! # Nonlinear parameters
//!
//! A parameter enters the equations linearly, in products with other parameters and functions of the motion. One that stands inside a
//! function of the motion, such as the velocity `vs` in `exp(-(dot(q)/vs)^2)` or the offset `q0` in `sin(q - q0)`, is declared
//! `nonlinear`, with the interval in which it is looked for: two expressions of constants, in the parameter's own unit. The interval
//! must keep away from values at which the equations have none, such as zero where the parameter is divided by. A nonlinear parameter
//! stands neither inside `sign` nor beside an input. Logs identify it together with the other parameters. Tables, generated code and
//! experiments take it as a constant that is known at run time, and a result gives it its value there.
//!
//! # Mechanisms
//!
//! A mechanism is a tree of rigid bodies. Its equations of motion follow by recursive Newton-Euler, exact and not multiplied out
//! ([`tpm_symbolic::mechanics::tree`]), and are linear in the inertia parameters of the bodies about their own frames:
//!
//! ```text
//! mechanism {
//!     gravity (0, 0, -9.81);                                  // in the frame of the base, m/s^2
//!     body upper {                                            // on the base
//!         revolute q1 about z at (0, 0, 0.3);
//!         inertia parameters;
//!     }
//!     body fore on upper {
//!         revolute q2 about -y at (0.4, 0, 0) turned (0, pi/2, 0);
//!         inertia parameters;
//!     }
//!     body tool on fore {
//!         fixed at (0.3, 0, 0);
//!         inertia mass 0.5 at (0, 0, 0.02) moments (0.0004, 0, 0, 0.0004, 0, 0.0002);
//!     }
//!     drive q1 by tau1 with viscous, coulomb, offset, rotor;
//!     drive wrist = q1 + q2 by tau2;                          // a motor that is coupled to two joints
//! }
//! ```
//!
//! | statement | meaning |
//! |---|---|
//! | `gravity (x, y, z);` | the acceleration of gravity in the frame of the base |
//! | `body NAME on PARENT { ... }` | a body; without `on` it stands on the base; bodies may come in any order |
//! | `revolute q about AXIS at (x, y, z) turned (roll, pitch, yaw);` | the body turns by the coordinate q, rad |
//! | `prismatic q along AXIS at ... turned ...;` | the body slides by the coordinate q, m |
//! | `revolute 1/2*q about ...;`, `prismatic -1*q along ...;` | the joint follows the one that `q` moves as it is, with this factor: fingers, belts, gears |
//! | `fixed at ... turned ...;` | the body moves with its parent |
//! | `inertia parameters;` | the parameters `m_NAME`, `mx_NAME`, `my_NAME`, `mz_NAME`, `Ixx_NAME`, `Ixy_NAME`, `Ixz_NAME`, `Iyy_NAME`, `Iyz_NAME`, `Izz_NAME` |
//! | `inertia mass m at (x, y, z) turned (...) moments (Ixx, Ixy, Ixz, Iyy, Iyz, Izz);` | a known inertia: its centre of mass, and the moments about that |
//! | `drive q by INPUT with LOSSES;` | what drives and brakes a joint: an input, and parameters `fv_q` (`viscous`), `fc_q` (`coulomb`), `f0_q` (`offset`), `Ia_q` (`rotor`) |
//! | `drive NAME = q5 + q6 by INPUT with LOSSES;` | a motor that moves by a constant combination of joints: its torque is on each of them with its factor; the parameters end in NAME |
//!
//! `at` places the joint's frame in the frame of the parent, `turned` turns it about the fixed axes x, then y, then z, and the frame
//! of the body moves from there. Origins, masses and moments are numbers in SI units or expressions of constants. An angle is a
//! multiple of pi/2, or `2*atan2(p, q)` with rational p and q, so that its cosine and sine are rational. An axis is `x`, `-y`, `z`
//! or a vector, whose length does not matter but must be rational. First moments are mass times centre (`mx = m*x`), `Ixy` is the
//! entry of the tensor (minus the integral of x y). A parameter that moves nothing, such as `Ixx` of a body that only turns about
//! its z axis, is left out of the model. `force q = ...;` adds forces to those of the drives, such as springs. A coordinate without
//! drive and force is free.
//!
//! # Expressions
//!
//! Expressions have `+ - * / ^`, the functions `sin cos tan asin acos atan2 sqrt tanh exp log abs sign` (`log` is the natural
//! logarithm), time derivatives `dot(e)`, `ddot(e)`,
//! `der(e, n)`, and partial ones `diff(e, q)` by a coordinate. `^` takes a non-negative integer, does not associate, and binds
//! tighter than unary minus, that tighter than `* /` (left to right), those tighter than `+ -`. Numbers are exact: `1/9` and `0.1`
//! are rational.
//!
//! Units stand in brackets and are optional ([`tpm_units`] lists them). Every term of an equation must have the unit of its
//! right-hand side; mm against m is an error that names the factor. A quantity without a unit is not checked.

#[cfg(feature = "generate")]
pub mod build;
pub mod diagnostic;
pub mod emit;
#[cfg(feature = "generate")]
pub mod export;
mod findings;
#[cfg(feature = "generate")]
pub mod generate;
pub mod identified;
#[cfg(feature = "import")]
pub mod import;
pub mod inline;
pub mod language;
mod near;
pub mod source;
mod spread;

pub use diagnostic::{Diagnostic, Diagnostics};
pub use findings::findings;
pub use language::stream::TokenSource;
pub use language::{Parsed, parse_factor, parse_model, parse_tokens, parse_value};
pub use source::{Source, Span};
