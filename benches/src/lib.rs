//! Workloads for the benchmarks, the same written by hand, and the comparison with other tools.

pub mod by_hand;
pub mod catalogue;
pub mod chain;
pub mod workloads;
