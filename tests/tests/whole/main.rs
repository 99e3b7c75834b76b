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
// The sources of `tests/src/goldens.rs`, as the build script generated them. They compile here on `core` and `libm` alone.
#[allow(dead_code, unreachable_pub, reason = "a program uses what it needs of them")]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/generated.rs"));
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
