//! The model's own error, read from residuals.

use num_complex::Complex;

/// Steps of the grid on which the most likely addition to the noise is searched.
const GRID_STEPS: u32 = 240;

/// Power per harmonic that residuals show beyond the stated noise: the maximum of the likelihood of a flat addition.
///
/// Maximum likelihood, not a moment: lines with much noise say little about a small addition, and must not drown the lines
/// with little noise in it. `share` is the degrees of freedom that the fit left, per equation.
pub(super) fn excess(residual: &[Complex<f64>], variance: &[f64], harmonics: &[usize], share: f64) -> f64 {
    if residual.is_empty() || share <= 0.0 {
        return 0.0;
    }
    let lines: Vec<(f64, f64, f64)> = residual
        .iter()
        .zip(variance)
        .zip(harmonics)
        .map(|((r, &v), &k)| {
            // A mean is one real equation and carries a quarter of the power of a line.
            if k == 0 { (4.0 * r.norm_sqr() / share, 4.0 * v, 0.5) } else { (r.norm_sqr() / share, v, 1.0) }
        })
        .collect();
    let cost = |addition: f64| {
        lines.iter().map(|&(power, v, count)| count * ((v + addition).ln() + power / (v + addition))).sum::<f64>()
    };
    let top = lines.iter().map(|l| l.0).fold(0.0, f64::max);
    let bottom = lines.iter().map(|l| l.1).fold(f64::INFINITY, f64::min);
    if top <= 0.0 {
        return 0.0;
    }
    // The minimum over a grid, by bisection: a part on which the slope's lower bound is not negative has its minimum at the first
    // point, and one on which its upper bound is not positive at the last.
    let (low, high) = ((bottom * 1e-3).max(top * 1e-24).ln(), (top * 2.0).ln());
    let addition = |i: u32| (low + (high - low) * f64::from(i) / f64::from(GRID_STEPS)).exp();
    let (mut best, mut least) = (0.0, cost(0.0));
    let mut intervals = [(0, 0); 2 * GRID_STEPS.ilog2() as usize + 4];
    intervals[0] = (0, GRID_STEPS);
    let mut waiting = 1;
    while waiting > 0 {
        waiting -= 1;
        let (first, last) = intervals[waiting];
        let (from, to) = (addition(first), addition(last));
        let slope = |near: f64, far: f64| {
            lines
                .iter()
                .map(|&(power, v, count)| count * (1.0 / (v + far) - power / (v + near) / (v + near)))
                .sum::<f64>()
        };
        let tried = if first == last || slope(from, to) >= 0.0 {
            from
        } else if slope(to, from) <= 0.0 {
            to
        } else {
            let middle = first + (last - first) / 2;
            // The left half is looked at first.
            intervals[waiting] = (middle + 1, last);
            intervals[waiting + 1] = (first, middle);
            waiting += 2;
            continue;
        };
        let now = cost(tried);
        if now < least {
            least = now;
            best = tried;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::{GRID_STEPS, excess};
    use num_complex::Complex;

    #[test]
    fn the_excess_is_the_best_point_of_the_whole_grid() {
        for case in 0..200_u32 {
            let number = |i: u32| f64::from((case * 7919 + i * 104_729) % 1009) / 1009.0;
            let count = 1 + case % 9;
            let variance: Vec<f64> = (0..count).map(|i| 10.0_f64.powf(-8.0 * number(i))).collect();
            let power: Vec<f64> = (0..count).map(|i| 10.0_f64.powf(-8.0 * number(i + 50))).collect();
            let residual: Vec<Complex<f64>> = power.iter().map(|p| Complex::new(p.sqrt(), 0.0)).collect();
            let harmonics: Vec<usize> = (1..=count as usize).collect();
            let cost = |a: f64| power.iter().zip(&variance).map(|(p, v)| (v + a).ln() + p / (v + a)).sum::<f64>();
            let top = power.iter().copied().fold(0.0, f64::max);
            let bottom = variance.iter().copied().fold(f64::INFINITY, f64::min);
            let (low, high) = ((bottom * 1e-3).max(top * 1e-24).ln(), (top * 2.0).ln());
            let grid = (0..=GRID_STEPS).map(|i| (low + (high - low) * f64::from(i) / f64::from(GRID_STEPS)).exp());
            let least = grid.chain([0.0]).map(cost).fold(f64::INFINITY, f64::min);
            let found = cost(excess(&residual, &variance, &harmonics, 1.0));
            assert!((found - least).abs() <= 1e-12 * (1.0 + least.abs()), "{case}: {found} {least}");
        }
    }
}
