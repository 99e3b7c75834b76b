tpm_macros::model! {
    with(campaign);
    model Chain {
        coordinate x1 [m], x2 [m];
        input F [N];
        parameter m1 [kg], m2 [kg], r [1], k1 [N/m], k3 [N/m];
        m1*ddot(x1) + k1*x1 + k3*(x1 - x2) = F;
        m2*r*ddot(x2) + k3*(x2 - x1) = 0;
        eliminate x1 as c;
        pattern {
            amplitude l [m];
            frequency w [rad/s];
            x2 = rest_to_rest(l, w, 5);
        }
    }
}

fn main() {}
