//! Workloads for the benchmarks, code written by hand as their measure, and the comparison with other tools.

pub mod by_hand;
pub mod catalogue;
pub mod chain;
pub mod workloads;
