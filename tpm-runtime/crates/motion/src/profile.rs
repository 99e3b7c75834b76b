//! Laws of a stroke from rest to rest, as machines use them beside trajectory patterns.
//!
//! Invariant: a law s(tau) rises from 0 at tau = 0 to 1 at tau = 1 and is antisymmetric about its middle, s(1 - tau) = 1 - s(tau).
//! Between the corners of a law all derivatives exist.

/// A law of a stroke.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Law {
    /// The polynomial 10 tau^3 - 15 tau^4 + 6 tau^5, with velocity and acceleration zero at both ends.
    Polynomial,
    /// The cycloid tau - sin(2 pi tau)/(2 pi), with velocity and acceleration zero at both ends.
    Cycloid,
    /// Constant acceleration, constant velocity and constant deceleration for a third of the time each.
    Trapezoid,
}

impl Law {
    /// Every law, in the order in which tables list them.
    pub const ALL: [Self; 3] = [Self::Polynomial, Self::Cycloid, Self::Trapezoid];

    /// The name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Law::Polynomial => "3-4-5 polynomial",
            Law::Cycloid => "cycloid",
            Law::Trapezoid => "trapezoid",
        }
    }

    /// The highest derivative that is continuous where strokes follow each other forth and back.
    #[must_use]
    pub const fn continuous(self) -> usize {
        match self {
            Law::Polynomial | Law::Cycloid => 2,
            Law::Trapezoid => 1,
        }
    }

    /// The derivative of an order with respect to tau, between 0 and 1.
    #[must_use]
    pub fn derivative(self, tau: f64, order: usize) -> f64 {
        use std::f64::consts::PI;
        match self {
            Law::Polynomial => {
                // sum_k c_k k!/(k - order)! tau^(k - order) for k = 3, 4, 5.
                [(3usize, 10.0), (4, -15.0), (5, 6.0)]
                    .into_iter()
                    .filter(|(k, _)| *k >= order)
                    .map(|(k, c)| (k - order + 1..=k).fold(c, |c, j| c * j as f64) * tau.powi((k - order) as i32))
                    .sum()
            }
            Law::Cycloid => {
                let angle = 2.0 * PI * tau;
                let line = match order {
                    0 => tau,
                    1 => 1.0,
                    _ => 0.0,
                };
                // The n-th derivative of sin x is sin(x + n pi/2).
                line - (2.0 * PI).powi(order as i32 - 1) * (angle + order as f64 * PI / 2.0).sin()
            }
            Law::Trapezoid => {
                const FASTEST: f64 = 1.5;
                const ACCELERATION: f64 = 4.5;
                match (order, (3.0 * tau) as usize) {
                    (0, 0) => 0.5 * ACCELERATION * tau * tau,
                    (0, 1) => 0.25 + FASTEST * (tau - 1.0 / 3.0),
                    (0, _) => 1.0 - 0.5 * ACCELERATION * (1.0 - tau) * (1.0 - tau),
                    (1, 0) => ACCELERATION * tau,
                    (1, 1) => FASTEST,
                    (1, _) => ACCELERATION * (1.0 - tau),
                    (2, 0) => ACCELERATION,
                    (2, 1) => 0.0,
                    (2, _) => -ACCELERATION,
                    _ => 0.0,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Law;

    #[test]
    fn laws_run_from_zero_to_one_and_their_derivatives_belong_together() {
        const STEP: f64 = 1e-6;
        for law in Law::ALL {
            let ends = [law.derivative(0.0, 0), law.derivative(1.0, 0), law.derivative(0.0, 1), law.derivative(1.0, 1)];
            for (found, expected) in ends.into_iter().zip([0.0, 1.0, 0.0, 0.0]) {
                assert!((found - expected).abs() < 1e-12, "{law:?}: {ends:?}");
            }
            for i in 1..40 {
                // Away from the corners of the trapezoid, which lie at 1/3 and 2/3.
                let tau = f64::from(i) / 40.0;
                for order in 0..2 {
                    let slope = (law.derivative(tau + STEP, order) - law.derivative(tau - STEP, order)) / (2.0 * STEP);
                    let exact = law.derivative(tau, order + 1);
                    assert!((slope - exact).abs() < 1e-6, "{law:?} {tau} {order}: {slope} {exact}");
                }
                let mirrored = law.derivative(1.0 - tau, 0);
                assert!((law.derivative(tau, 0) + mirrored - 1.0).abs() < 1e-12);
            }
        }
    }
}
