//! What a careful engineer writes, as the measure of generated code.

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

/// Sixteen phasors, each turned by its own step: independent lanes, which compilers put into vectors.
pub struct Bank {
    cos: [f64; 16],
    sin: [f64; 16],
    turn_cos: [f64; 16],
    turn_sin: [f64; 16],
    /// Sums of the signal times cosine of 1, 2, ... times the phase.
    pub cosines: [f64; 16],
    /// Sums of the signal times sine of 1, 2, ... times the phase.
    pub sines: [f64; 16],
}

impl Bank {
    /// A bank at phase zero, for a fundamental that advances by `step` radians from sample to sample.
    #[must_use]
    pub fn new(step: f64) -> Self {
        let turn = |k: usize| (k as f64 + 1.0) * step;
        Self {
            cos: [1.0; 16],
            sin: [0.0; 16],
            turn_cos: std::array::from_fn(|k| turn(k).cos()),
            turn_sin: std::array::from_fn(|k| turn(k).sin()),
            cosines: [0.0; 16],
            sines: [0.0; 16],
        }
    }

    /// Takes in one sample.
    #[inline]
    pub fn push(&mut self, value: f64) {
        for k in 0..16 {
            let (c, s) = (self.cos[k], self.sin[k]);
            self.cosines[k] += value * c;
            self.sines[k] += value * s;
            self.cos[k] = c * self.turn_cos[k] - s * self.turn_sin[k];
            self.sin[k] = s * self.turn_cos[k] + c * self.turn_sin[k];
        }
    }
}

/// Feng, Eqn 3.24, on its pattern: reference, feed-forward, PD, and the harmonics that its table has.
pub struct Control {
    amplitude: f64,
    w: f64,
    m: f64,
    k1: f64,
    k2: f64,
    kp: f64,
    kd: f64,
    /// Sums of the input times cos k w t, k = 0, 1, 2, 3, 4, 6.
    pub sums: [f64; 6],
}

impl Default for Control {
    fn default() -> Self {
        Self::new()
    }
}

impl Control {
    /// The controller for an amplitude of 0.3 m and a fundamental of 3 rad/s.
    #[must_use]
    pub fn new() -> Self {
        Self { amplitude: 0.3, w: 3.0, m: 2.0, k1: 40.0, k2: 1.5, kp: 2000.0, kd: 120.0, sums: [0.0; 6] }
    }

    /// The input from the phase, and from position and velocity as they were measured.
    #[inline]
    pub fn step(&mut self, phase: f64, [x, v]: [f64; 2]) -> f64 {
        let (s1, c1) = libm::sincos(phase);
        let c2 = 2.0 * c1 * c1 - 1.0;
        let c3 = c1 * (2.0 * c2 - 1.0);
        let s3 = s1 * (2.0 * c2 + 1.0);
        let c4 = 2.0 * c2 * c2 - 1.0;
        let c6 = 2.0 * c3 * c3 - 1.0;
        let speed = self.amplitude * self.w;
        let reference = self.amplitude * (c1 - c3 / 9.0);
        let velocity = speed * (s3 / 3.0 - s1);
        let acceleration = speed * self.w * (c3 - c1);
        let feed_forward = self.m * acceleration + self.k1 * reference + self.k2 * velocity * velocity;
        let u = feed_forward + self.kp * (reference - x) + self.kd * (velocity - v);
        for (sum, base) in self.sums.iter_mut().zip([1.0, c1, c2, c3, c4, c6]) {
            *sum += u * base;
        }
        u
    }
}

#[cfg(test)]
mod tests {
    use super::{Control, arm, arm_inputs, slider};
    use tpm_models::{closed_loop_arm, mass_spring_drag};

    #[test]
    fn the_same_numbers_as_the_generated_code() {
        let (motion, theta) = ([0.3, -0.7, 1.1], [2.0, 40.0, 1.5]);
        let (force, phi) = slider(&motion, &theta);
        let motion = mass_spring_drag::Motion::from_array(&motion);
        let theta = mass_spring_drag::Parameters::from_array(theta);
        assert!((mass_spring_drag::feed_forward(&motion, &theta).u - force).abs() < 1e-14);
        assert_eq!(mass_spring_drag::regressor(&motion), [phi]);

        // Exactly on the pattern the input is the feed-forward.
        let pattern = mass_spring_drag::Pattern { lambda: 0.3, w: 3.0 };
        let theta = mass_spring_drag::Parameters { m: 2.0, k1: 40.0, k2: 1.5 };
        let motion = pattern.reference_at(0.7);
        let u = Control::new().step(0.7, [motion.x.value, motion.x.dot]);
        assert!((mass_spring_drag::feed_forward(&motion, &theta).u - u).abs() < 1e-11);

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
