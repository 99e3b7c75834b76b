//! Example models, each in a `.tpm` file that the command line reads and that is compiled here.
//!
//! `tpm_models::MassSpringDrag` is a model for the runtime; `tpm_models::mass_spring_drag` holds its parameters, reference
//! motion, feed-forward and estimator as straight-line code.
#![no_std]

use tpm_runtime::model_file;

model_file!("brushless_motor.tpm");
model_file!("cart_pendulum.tpm");
model_file!("closed_loop_arm.tpm", with(run, campaign));
model_file!("emps.tpm");
model_file!("mass_spring_drag.tpm");
model_file!("rotary_pendulum.tpm");
model_file!("rotary_pendulum_down.tpm");
model_file!("rotary_pendulum_dry.tpm");
model_file!("silverbox.tpm");
model_file!("stribeck_pendulum.tpm");
model_file!("three_carts.tpm");
model_file!("two_carts.tpm", with(run, campaign));

/// A model that is declared in place, with `model!`.
pub mod inline {
    tpm_runtime::model! {
        // Feng, Eqn 3.24: m x'' + k1 x + k2 x'^2 = u
        model MassSpringDrag {
            coordinate x [m];
            input u [N];
            parameter m [kg], k1 [N/m], k2 [N*s^2/m^2];

            m*ddot(x) + k1*x + k2*dot(x)^2 = u;

            pattern {
                amplitude lambda [m];
                frequency w [rad/s];
                x = rest_to_rest(lambda, w, 3);
            }
        }
    }
}
