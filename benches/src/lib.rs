//! Workloads for the benchmarks, code written by hand as their measure, the comparison with other tools, and the cases that show
//! how honest identified numbers are.

pub mod by_hand;
pub mod catalogue;
pub mod chain;
pub mod estimators;
pub mod honesty;
pub mod workloads;
