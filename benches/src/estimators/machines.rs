//! The machines of the papers with the experiments by which every estimator identifies them.

use crate::honesty::machines::Shipped;

const fn machine(name: &'static str, model: &'static str, experiment: &'static str) -> Shipped {
    Shipped { name, model, experiment }
}

/// All of them, in the order of the tables.
pub const MACHINES: [Shipped; 7] = [
    machine(
        "Feng, Eqn 3.24",
        include_str!("../../../models/mass_spring_drag.tpm"),
        include_str!("../../../models/experiments/mass_spring_drag.toml"),
    ),
    machine(
        "two carts",
        include_str!("../../../models/two_carts.tpm"),
        include_str!("../../../models/experiments/two_carts.toml"),
    ),
    machine(
        "three carts",
        include_str!("../../../models/three_carts.tpm"),
        include_str!("../../../models/experiments/three_carts.toml"),
    ),
    machine(
        "arm, thesis pattern",
        include_str!("../../../models/closed_loop_arm.tpm"),
        include_str!("../../../models/experiments/closed_loop_arm_thesis.toml"),
    ),
    machine(
        "arm, 3w and 2w",
        include_str!("../../../models/closed_loop_arm.tpm"),
        include_str!("../../../models/experiments/closed_loop_arm.toml"),
    ),
    machine(
        "cart-pendulum",
        include_str!("../../../models/cart_pendulum.tpm"),
        include_str!("../../../models/experiments/cart_pendulum.toml"),
    ),
    machine(
        "rotary pendulum",
        include_str!("../../../models/rotary_pendulum_down.tpm"),
        include_str!("../../../models/experiments/rotary_pendulum_down.toml"),
    ),
];
