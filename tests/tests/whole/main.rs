//! Tests of the whole, one binary: what no single crate can show.

mod campaign;
mod emitted;
mod foundation;
// As `tpm generate models/mass_spring_drag.tpm --lang rust -o tests/generated` wrote it; the command line's tests compare.
#[path = "../../generated/mass_spring_drag.rs"]
#[allow(dead_code, unreachable_pub, reason = "a program uses what it needs of it")]
mod generated;
mod licences;
mod physical;
mod support;
mod tables;
