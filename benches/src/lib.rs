//! What the benchmarks share.

pub mod by_hand;
