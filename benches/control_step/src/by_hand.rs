//! What a careful engineer writes.

/// Sixteen phasors, each turned by its own step: independent lanes, which compilers put into vectors.
pub struct Bank {
    cos: [f64; 16],
    sin: [f64; 16],
    turn_cos: [f64; 16],
    turn_sin: [f64; 16],
    pub cosines: [f64; 16],
    pub sines: [f64; 16],
}

impl Bank {
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
    pub sums: [f64; 6],
}

impl Control {
    pub fn new() -> Self {
        Self { amplitude: 0.3, w: 3.0, m: 2.0, k1: 40.0, k2: 1.5, kp: 2000.0, kd: 120.0, sums: [0.0; 6] }
    }

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
