//! The language and the writers, on text and on the shipped models.

mod build;
mod c;
mod committed;
mod derivation;
mod generate;
mod language;
mod lowering;
mod newton_euler;
mod random;
mod support;
