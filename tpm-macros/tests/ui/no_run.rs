tpm_macros::model! {
    with(linearised);
    model Cart {
        coordinate x [m];
        input u [N];
        constant m [kg];
        m*ddot(x) = u;
    }
}

fn main() {}
