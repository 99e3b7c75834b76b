tpm_macros::model! {
    model Slider {
        coordinate x [m];
        input u [N];
        parameter m [kg], k [N/m];

        m*ddot(x) + k*dot(x) + d*x = u;
        m*ddot(y) = u;
    }
}

fn main() {}
