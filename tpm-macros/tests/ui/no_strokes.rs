tpm_macros::model! {
    with(strokes);
    model Cart {
        coordinate x [m];
        input u [N];
        parameter m [kg];
        m*ddot(x) = u;
    }
}

fn main() {}
