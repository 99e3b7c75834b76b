//! Tests of the whole, in one program: properties that no single crate can show.

mod arm;
mod arm_estimator;
mod base_parameters;
// The module that the build script made of a shipped model.
#[allow(dead_code, unreachable_pub, reason = "a program uses what it needs of them")]
mod built {
    include!(concat!(env!("OUT_DIR"), "/mass_spring_drag.rs"));
}
mod budget;
mod campaign;
mod chain;
mod emitted;
mod examples;
mod filtered;
mod forgetting;
mod foundation;
mod frequency;
mod functions;
mod fuzz;
// The files that `tpm generate models/NAME.tpm --lang rust -o tests/generated` wrote; tests of `tpm-codegen` compare them with the
// generator. They compile here on `core` and `libm` alone.
#[allow(dead_code, unreachable_pub, reason = "a program uses what it needs of them")]
#[path = "../../generated"]
mod generated {
    pub mod brushless_motor;
    pub mod cart_pendulum;
    pub mod closed_loop_arm;
    pub mod emps;
    pub mod mass_spring_drag;
    pub mod rotary_pendulum;
    pub mod rotary_pendulum_down;
    pub mod rotary_pendulum_dry;
    pub mod silverbox;
    pub mod three_carts;
    pub mod two_carts;
}
mod delays;
mod imported_motion;
mod inertias;
mod judge;
mod licences;
mod lines;
mod matrices;
mod measured;
mod mechanism;
mod mujoco;
mod numerics_room;
mod packages;
mod pendulum;
mod physical;
mod robots;
mod session;
mod split;
mod strokes;
mod structure;
mod support;
mod tables;
