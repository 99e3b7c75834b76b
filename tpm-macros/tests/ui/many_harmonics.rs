tpm_macros::model! {
    with(run);
    model Cart {
        coordinate x [m];
        input u [N];
        parameter m [kg];
        m*ddot(x) = u;
        pattern {
            amplitude l [m];
            frequency w [rad/s];
            harmonics 40;
            x = rest_to_rest(l, w, 3);
        }
    }
}

fn main() {}
