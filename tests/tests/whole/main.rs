//! Tests of the whole, one binary: what no single crate can show.

mod arm;
// What the build script made.
#[allow(dead_code, unreachable_pub, reason = "a program uses what it needs of them")]
mod built {
    include!(concat!(env!("OUT_DIR"), "/mass_spring_drag.rs"));
}
mod campaign;
mod chain;
mod emitted;
mod examples;
mod filtered;
mod foundation;
mod frequency;
// As `tpm generate models/NAME.tpm --lang rust -o tests/generated` wrote them; the command line's tests compare. That they compile
// here shows that they stand alone on `core` and `libm`.
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
    pub mod silverbox;
    pub mod three_carts;
    pub mod two_carts;
}
mod licences;
mod packages;
mod pendulum;
mod physical;
mod split;
mod support;
mod tables;
