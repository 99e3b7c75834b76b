//! Holds the integration tests of the workspace; has no code of its own but the README's Rust examples.

#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
