//! The language and the writers, on text and on the shipped models.

mod build;
mod c;
mod committed;
mod constants_of_tables;
mod derivation;
mod exported;
mod format;
mod generate;
mod language;
mod lowering;
mod monitor;
mod newton_euler;
mod one_source;
#[path = "../../../tests/support/random.rs"]
mod random;
mod random_code;
#[allow(dead_code, reason = "only models with a regressor form are compiled")]
#[path = "../../../tests/support/random_model.rs"]
mod random_model;
mod rounding;
mod specialised;
mod support;
