//! Motors of a machine along a pattern, as answers that are displayed and serialised: whether they can follow, and what common and split
//! feed-forward make of them (Feng, chapter 6 and appendix C).

mod actuators;
mod feed_forward;
mod moved;

pub use actuators::Actuators;
pub use feed_forward::{FeedForwardError, FeedForwards};
pub use moved::MovedMachine;
