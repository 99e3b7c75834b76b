//! Tests of the whole, one binary: what no single crate can show.

mod campaign;
mod emitted;
mod foundation;
mod licences;
mod physical;
mod support;
mod tables;
