//! How honest identified numbers are: logs of simulated machines whose parameters are known, identified as a user would do it.
//!
//! Every figure is a count over many logs: how often an interval holds the truth where the model is right, and how often a number is
//! right or refused, and its fault named, where the model or the log is wrong. The program `honesty` prints them as tables.

pub mod bound;
pub mod cases;
pub mod chance;
pub mod correct;
pub mod efficiency;
pub mod encoders;
pub mod examine;
pub mod identify;
pub mod machines;
pub mod pendulum;
pub mod rig;
pub mod spoilt;
pub mod table;
