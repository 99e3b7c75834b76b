//! What a careful engineer writes for one model, as the measure of generated code.

/// Feng, Eqn 3.24: input and regressor from (x, x', x'') and (m, k1, k2).
#[must_use]
pub fn slider(motion: &[f64; 3], theta: &[f64; 3]) -> (f64, [f64; 3]) {
    let [x, v, a] = *motion;
    let [m, k1, k2] = *theta;
    let v2 = v * v;
    (m * a + k1 * x + k2 * v2, [a, x, v2])
}

/// Feng, Eqns 5.1, 5.2 with second-order series: inputs and 2 x 9 regressor from (th1, th2, th1', th2', th1'', th2''), a10 to
/// a32 and (th10, th20).
#[must_use]
pub fn arm(motion: &[f64; 6], theta: &[f64; 9], constants: &[f64; 2]) -> ([f64; 2], [[f64; 9]; 2]) {
    let [_, th2, d1, d2, dd1, dd2] = *motion;
    let s = th2 - constants[1];
    let s2 = s * s;
    let ts = 2.0 * s;
    let (d11, d12, d22) = (d1 * d1, d1 * d2, d2 * d2);
    let (a1, a2) = (2.0 * dd1, 2.0 * dd2);
    let c12 = 2.0 * d12;
    let first = [a1, s * a1 + c12, s2 * a1 + ts * c12, 0.0, 0.0, 0.0, dd2, s * dd2 + d22, s2 * dd2 + ts * d22];
    let second = [0.0, -d11, -(ts * d11), a2, s * a2 + d22, s2 * a2 + ts * d22, dd1, s * dd1, s2 * dd1];
    let t = theta;
    let tau1 =
        first[0] * t[0] + first[1] * t[1] + first[2] * t[2] + first[6] * t[6] + first[7] * t[7] + first[8] * t[8];
    let tau2 = second[1] * t[1]
        + second[2] * t[2]
        + second[3] * t[3]
        + second[4] * t[4]
        + second[5] * t[5]
        + second[6] * t[6]
        + second[7] * t[7]
        + second[8] * t[8];
    ([tau1, tau2], [first, second])
}

/// A motion, parameters (rig 1 of Feng's arm, Taylor coefficients) and constants of the arm.
#[must_use]
pub fn arm_inputs() -> ([f64; 6], [f64; 9], [f64; 2]) {
    let motion = [0.1, 5.3, -0.4, 0.6, 1.2, -0.8];
    let theta = [2375.0, 891.0, 149.0, 209.0, 171.0, -225.0, -965.0, -807.0, 337.0];
    (motion, theta, [0.0, 5.421_616_82])
}

#[cfg(test)]
mod tests {
    use super::{arm, arm_inputs, slider};
    use tpm_models::{closed_loop_arm, mass_spring_drag};

    #[test]
    fn the_same_numbers_as_the_generated_code() {
        let (motion, theta) = ([0.3, -0.7, 1.1], [2.0, 40.0, 1.5]);
        let (force, phi) = slider(&motion, &theta);
        let motion = mass_spring_drag::Motion::from_array(&motion);
        let theta = mass_spring_drag::Parameters::from_array(theta);
        assert!((mass_spring_drag::feed_forward(&motion, &theta).u - force).abs() < 1e-14);
        assert_eq!(mass_spring_drag::regressor(&motion), [phi]);

        let (motion, theta, constants) = arm_inputs();
        let (forces, phi) = arm(&motion, &theta, &constants);
        let motion = closed_loop_arm::Motion::from_array(&motion);
        let theta = closed_loop_arm::Parameters::from_array(theta);
        let constants = closed_loop_arm::Constants::from_array(constants);
        let found = closed_loop_arm::feed_forward(&motion, &theta, &constants);
        for (found, expected) in [found.tau1, found.tau2].iter().zip(forces) {
            assert!((found - expected).abs() < 1e-11 * expected.abs(), "{found} {expected}");
        }
        for (found, expected) in
            closed_loop_arm::regressor(&motion, &constants).as_flattened().iter().zip(phi.as_flattened())
        {
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
    }
}
