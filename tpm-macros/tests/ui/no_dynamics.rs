tpm_macros::model! {
    with(forward_dynamics);
    model Held {
        coordinate x [m], y [m];
        input u [N];
        parameter m [kg], k [N/m];
        m*ddot(x) + k*y = u;
    }
}

fn main() {}
