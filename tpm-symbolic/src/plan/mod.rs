//! Straight-line plans, which the interpreter executes and the emitters print, operation by operation, with exact
//! constants.

pub mod bank;
pub mod base;
mod compile;
mod constants;
pub mod derivatives;
mod draft;
pub mod dynamics;
mod entries;
pub mod estimator;
pub mod evaluation;
mod factored;
pub mod forces;
pub mod leaf;
pub mod lumping;
pub mod observability;
pub mod operation;
pub mod pattern;
mod reference;
mod sharing;
pub mod split;
pub mod straight_line;
pub mod table;
mod written;
