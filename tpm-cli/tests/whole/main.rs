//! The tool as a user runs it: one program for the tests of all verbs.

mod actuators;
mod any_log;
mod bad_input;
mod campaign;
mod compare;
mod dry_friction;
mod excite;
mod functions;
mod generate;
mod hard;
mod hidden;
mod identifiability;
mod inspect;
mod linear;
mod live;
mod log;
mod pendulum_study;
mod physical;
mod printed;
mod readme;
mod regulate;
mod support;
mod trajectories;
mod truth;
mod validate;
