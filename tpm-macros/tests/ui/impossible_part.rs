tpm_macros::model! {
    with(run, campaign);
    model Cart {
        coordinate x [m];
        input u [N];
        parameter m [kg];
        m*ddot(x) = u;
    }
}

fn main() {}
