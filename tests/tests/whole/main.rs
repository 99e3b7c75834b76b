//! Tests of the whole, one binary: what no single crate can show.

mod arm;
mod campaign;
mod chain;
mod emitted;
mod filtered;
mod foundation;
mod frequency;
// As `tpm generate models/mass_spring_drag.tpm --lang rust -o tests/generated` wrote it; the command line's tests compare.
#[allow(dead_code, unreachable_pub, reason = "a program uses what it needs of it")]
#[path = "../../generated/mass_spring_drag.rs"]
mod generated;
mod licences;
mod pendulum;
mod physical;
mod split;
mod support;
mod tables;
