tpm_macros::model! {
    model Pendulum {
        coordinate x;
        input u;
        parameter k;

        ddot(x) + sin(k*x) = u;
    }
}

fn main() {}
