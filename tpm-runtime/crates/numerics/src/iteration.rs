//! The numbers of an iterative algorithm.
//!
//! Invariant: every iteration has a most number of steps, so that it ends. A constant of this type stands beside each algorithm, and its
//! doc says what a step is and what `settled` is a share of.

/// When an iteration ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iteration {
    /// Most steps.
    pub most: usize,
    /// Largest change in one step, or largest error after it, at which the iteration has converged.
    pub settled: f64,
}

/// When a resolution is fine enough that is doubled from the least one on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doubling {
    /// Fewest points or harmonics.
    pub least: usize,
    /// Most points or harmonics.
    pub most: usize,
    /// Largest change by doubling, or largest part beyond the resolution, at which it is fine enough.
    pub settled: f64,
}

impl Doubling {
    /// A number of points or harmonics, held between the fewest and the most.
    pub fn clamp(&self, count: usize) -> usize {
        count.clamp(self.least, self.most)
    }
}
