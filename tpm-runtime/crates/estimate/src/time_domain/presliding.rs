//! Dry friction that builds up again after a reversal.
//!
//! Before a joint slides, its contacts bend: from a reversal at q0 on, where friction was D0 of what it is while the joint slides, it is
//!
//! ```text
//! D = s - (s - D0) exp(-|q - q0| / travel),    s the sign of the motion
//! ```
//!
//! until the next one (Dahl's model, whose differential equation `travel D' = q' - |q'| D` this solves exactly). A reversal smaller than what
//! noise of the sensor makes of a machine at rest is none.

/// How far friction has built up at successive positions, from -1 to 1; none before the first motion. Reversals of less than `least` do not
/// count.
pub(crate) fn built_up(positions: &[f64], travel: f64, least: f64) -> Vec<f64> {
    let mut built = vec![0.0; positions.len()];
    let Some(&first) = positions.first() else { return built };
    // The last reversal, what had built up there, and the farthest place since in the direction of the motion.
    let (mut from, mut far) = (0, 0);
    let mut sign = 0.0;
    for (k, &q) in positions.iter().enumerate() {
        if sign == 0.0 {
            if (q - first).abs() > least {
                sign = (q - first).signum();
                far = k;
            }
        } else if sign * (q - positions[far]) >= 0.0 {
            far = k;
        } else if sign * (positions[far] - q) > least {
            go_on(positions, &mut built, (from, far), sign, travel);
            (from, far, sign) = (far, k, -sign);
        }
    }
    go_on(positions, &mut built, (from, positions.len() - 1), sign, travel);
    built
}

/// Lets friction build up from one place to another, between which a coordinate moves one way.
fn go_on(positions: &[f64], built: &mut [f64], (from, to): (usize, usize), sign: f64, travel: f64) {
    let (start, before) = (positions[from], built[from]);
    let mut moved = 0.0_f64;
    for k in from..=to {
        moved = moved.max(sign * (positions[k] - start));
        built[k] = sign - (sign - before) * (-moved / travel).exp();
    }
}

#[cfg(test)]
mod tests {
    use super::built_up;

    #[test]
    fn it_solves_dahls_equation() {
        let (h, travel) = (1e-4, 0.015);
        let position = |t: f64| 0.3 * (2.0 * t).sin() + 0.02 * (9.0 * t).cos();
        let positions: Vec<f64> = (0..60_000).map(|k| position(h * f64::from(k))).collect();
        let built = built_up(&positions, travel, 0.0);
        // Euler's rule in steps a fortieth as long.
        let (mut own, mut worst) = (0.0, 0.0_f64);
        for (k, built) in built.iter().enumerate() {
            worst = worst.max((own - built).abs());
            for step in 0..40 {
                let t = h * (k as f64 + f64::from(step) / 40.0);
                let moved = position(t + h / 40.0) - position(t);
                own += (moved - moved.abs() * own) / travel;
            }
        }
        assert!(worst < 2e-3, "{worst}");
        assert!(built.iter().all(|own| own.abs() <= 1.0) && built[20_000..].iter().any(|own| *own > 0.999));
    }

    #[test]
    fn noise_at_rest_is_no_reversal() {
        let noise = |k: usize| 1e-5 * ((k * 7919 % 101) as f64 / 50.0 - 1.0);
        let positions: Vec<f64> = (0..4000).map(|k| 1e-3 * (k.min(1000) as f64) + noise(k)).collect();
        let (with, without) = (built_up(&positions, 1e-3, 4e-5), built_up(&positions, 1e-3, 0.0));
        assert!(with[3999] > 0.99, "{}", with[3999]);
        assert!(without[3999] < 0.5, "{}", without[3999]);
        assert!(built_up(&[], 1.0, 0.0).is_empty() && built_up(&[2.0; 3], 1.0, 0.0) == [0.0; 3]);
    }
}
