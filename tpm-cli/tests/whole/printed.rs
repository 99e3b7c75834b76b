//! Derivations of the shipped models as they are printed. Other tests show that they are right; these show every change.

use crate::support::{printed, printed_in, root};

#[test]
fn lumped_parameters_and_reconstructions() {
    // Feng, Eqns 4.34 to 4.41 among them.
    for model in
        ["two_carts", "three_carts", "closed_loop_arm", "cart_pendulum", "rotary_pendulum", "rotary_pendulum_down"]
    {
        insta::assert_snapshot!(format!("check_{model}"), printed(&["check", &format!("models/{model}.tpm")]));
    }
}

#[test]
fn what_patterns_show() {
    // Exit code 1 where the pattern does not show every parameter.
    for (model, code) in [("mass_spring_drag", 0), ("two_carts", 0), ("three_carts", 1), ("closed_loop_arm", 1)] {
        let text = printed_in(&root(), &["identifiability", &format!("models/{model}.tpm")], code);
        insta::assert_snapshot!(format!("identifiability_{model}"), text);
    }
}

#[test]
fn linearised_at_rest() {
    // Fong, Eqns 15 to 22 and 27.
    for model in ["rotary_pendulum", "rotary_pendulum_down", "cart_pendulum", "mass_spring_drag"] {
        insta::assert_snapshot!(format!("linearize_{model}"), printed(&["linearize", &format!("models/{model}.tpm")]));
    }
}

#[test]
fn inputs_taken_apart() {
    // Feng, Eqns 6.6 to 6.9.
    insta::assert_snapshot!("split_cart_pendulum", printed(&["split", "models/cart_pendulum.tpm"]));
}
