tpm_macros::model! {
    with(campaign);
    model Hanging {
        coordinate x [m], a [rad];
        input u [N];
        parameter m [kg], p [kg*m], j [kg*m^2];
        constant g = 9.81 [m/s^2];
        m*ddot(x) + p*cos(a)*ddot(a) - p*sin(a)*dot(a)^2 = u;
        p*cos(a)*ddot(x) + j*ddot(a) + p*g*sin(a) = 0;
        pattern {
            amplitude l [m];
            frequency w [rad/s];
            x = rest_to_rest(l, w, 3);
        }
    }
}

fn main() {}
