//! A slide with a pendulum that is driven, as a mechanism: bodies, joints and drives instead of equations.
#![no_std]

tpm_macros::model! {
    crate = tpm_controller;
    with(campaign, mass_matrix, forward_dynamics, monitor, strokes);
    filter(200:0.7, sample_time = 1e-3);
    model Slide {
        coordinate x [m], q [rad];
        input f [N], tau [N*m];

        mechanism {
            gravity (0, 0, -9.81);
            body slide {
                prismatic x along x;
                inertia parameters;
            }
            body arm on slide {
                revolute q about y;
                inertia parameters;
            }
            drive x by f with viscous;
            drive q by tau with viscous;
        }

        pattern {
            amplitude lambda [m], phi [rad];
            frequency w [rad/s];
            x = rest_to_rest(lambda, w, 3);
            q = phi*(cos(2*w*t) - 1);
        }
    }
}
