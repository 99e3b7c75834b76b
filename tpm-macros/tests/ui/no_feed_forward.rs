tpm_macros::model! {
    with(campaign);
    model Pulled {
        coordinate x [m];
        input u [N], v [N];
        parameter m [kg];
        m*ddot(x) = u - v;
        pattern {
            amplitude l [m];
            frequency w [rad/s];
            x = rest_to_rest(l, w, 3);
        }
    }
}

fn main() {}
