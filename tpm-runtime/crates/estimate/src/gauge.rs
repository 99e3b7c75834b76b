//! Parameters of which data show products of powers alone.
//!
//! A row `phi(q) theta = 0` without an input or a known term holds for every multiple of its parameters, and a state that no sensor reads may
//! have any size where its parameters are `s^p` times as large. What is hidden then is the direction `p theta` along the values
//! themselves. Another record hides a direction that differs by the noise of both, and where the two are put together as they
//! stand, that difference passes for knowledge of the scale. In the gauge in which one of the parameters is one, the others are products
//! of powers, such as ratios, and these add up like any other parameters.

use crate::result::Estimate;
use crate::scale::Scale;
use crate::verdict::{Evidence, POOR_DEVIATION, Status};
use tpm_numerics::singular::largest_one;
use tpm_numerics::{Matrix, tolerance};

/// Largest distance of a power from a whole number, as a share of it.
const NEAR: f64 = 0.02;
/// Largest power that is looked for.
const LARGEST: f64 = 4.0;

impl Estimate {
    /// A hidden direction as that of a scale; nothing where it is not along powers of the values. Along others these are those of a prior, or
    /// zero.
    pub(super) fn scale_of(&self, direction: usize) -> Option<Scale> {
        let components = &self.unobservable[direction];
        let members: Vec<usize> =
            (0..components.len()).filter(|&j| components[j].abs() > tolerance::COMPONENT).collect();
        if members.len() < 2 || members.iter().any(|&j| self.values[j] == 0.0) {
            return None;
        }
        // The least of the shares has the power one, of which all others are multiples.
        let share = |j: usize| components[j] / self.values[j];
        let unit = members.iter().map(|&j| share(j)).min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        let power = |j: usize| {
            let power = share(j) / unit;
            let near = power.round();
            ((power - near).abs() <= NEAR * near.abs() && near.abs() <= LARGEST).then_some(near)
        };
        let mut powers = vec![0.0; components.len()];
        for &j in &members {
            powers[j] = power(j)?;
        }
        Some(Scale { direction, powers })
    }

    /// The estimate in which a parameter of every scale is one, and the direction of the scale is that of the values.
    #[must_use]
    pub fn in_own_scales(mut self) -> Self {
        for scale in self.scales.clone() {
            if let Some(own) = scale.own(&self.values) {
                self = self.in_gauge(&scale, own).along(&scale);
            }
        }
        self
    }

    /// The estimate with values and covariance of all parameters where something else tells every scale, such as a part of the machine that is
    /// known.
    #[must_use]
    pub fn with_scales_known(mut self, values: Vec<f64>, covariance: Matrix) -> Self {
        let of_scale = |j: usize| self.scales.iter().any(|scale| scale.powers[j] != 0.0);
        for j in (0..values.len()).filter(|&j| of_scale(j)) {
            let std = covariance[(j, j)].max(0.0).sqrt();
            self.std[j] = std;
            self.status[j] = Status::of(Evidence::Shown { value: values[j], std, felt: f64::INFINITY }, POOR_DEVIATION);
        }
        self.rank += self.scales.len();
        let told: Vec<usize> = self.scales.drain(..).map(|scale| scale.direction).collect();
        let left = self.unobservable.drain(..).enumerate().filter(|(at, _)| !told.contains(at));
        self.unobservable = left.map(|(_, direction)| direction).collect();
        (self.values, self.covariance) = (values, covariance);
        self
    }

    /// The estimate in which one of parameters with a common scale is one, and known.
    fn in_gauge(mut self, scale: &Scale, own: usize) -> Self {
        let mut map = scale.bring(&mut self.values, own, 1.0);
        self.values[own] = 1.0;
        map[(own, own)] = 0.0;
        self.covariance = Matrix::of(&map * self.covariance.dense() * map.transpose());
        self
    }

    /// The estimate whose direction of a scale is that of its values, the largest component being one.
    pub(super) fn along(mut self, scale: &Scale) -> Self {
        let along: Vec<f64> = scale.powers.iter().zip(&self.values).map(|(power, value)| power * value).collect();
        if along.iter().any(|component| *component != 0.0) {
            self.unobservable[scale.direction] = largest_one(&along);
        }
        self
    }

    /// The estimate in the gauge of a scale with `own`, which is then what is hidden; as it is where it has no such scale.
    pub(super) fn hiding(self, own: usize) -> Self {
        let found = self.scales.iter().find(|scale| scale.powers[own] != 0.0 && self.values[own] != 0.0).cloned();
        let Some(scale) = found else { return self };
        let mut gauged = self.in_gauge(&scale, own);
        let direction = &mut gauged.unobservable[scale.direction];
        direction.fill(0.0);
        direction[own] = 1.0;
        gauged.scales.retain(|other| *other != scale);
        gauged
    }

    /// The estimate of what [`hiding`](Self::hiding) estimates told together, with their scale.
    pub(super) fn showing(mut self, own: usize, scale: &Scale) -> Self {
        let is_own = |direction: &Vec<f64>| {
            direction.iter().enumerate().all(|(j, component)| (component.abs() > tolerance::COMPONENT) == (j == own))
        };
        let Some(direction) = self.unobservable.iter().position(is_own) else { return self };
        for j in scale.members() {
            (self.std[j], self.status[j]) = (f64::INFINITY, Status::Unobservable);
        }
        let scale = Scale { direction, ..scale.clone() };
        self.scales.push(scale.clone());
        self.along(&scale)
    }
}

#[cfg(test)]
mod tests {
    use crate::pooled::pool;
    use crate::pooled::tests::estimate;
    use crate::result::Estimate;
    use crate::settings::Settings;
    use crate::verdict::Status;
    use tpm_numerics::singular::largest_one;

    /// What a record says of (a, b, c) = (2, 0.5, 4) but for a factor s, s^-1, s of these, with errors of a/c and b c: in the gauge c = `size`.
    fn record(errors: [f64; 2], size: f64) -> Estimate {
        let values = [(0.5 + errors[0]) * size, (2.0 + errors[1]) / size, size];
        let (a, b) = (0.001 * size, 0.001 / size);
        let covariance = [vec![a * a, 0.0, 0.0], vec![0.0, b * b, 0.0], vec![0.0, 0.0, 0.0]];
        let along = largest_one(&[values[0], -values[1], values[2]]);
        let mut found = estimate(&values, &covariance, vec![along]);
        found.status = vec![Status::Unobservable; 3];
        found.scales = vec![found.scale_of(0).expect("a scale")];
        found
    }

    #[test]
    fn powers_are_told_from_the_values() {
        let powers = record([0.0; 2], 1470.0).scales[0].powers.clone();
        assert!(powers == [1.0, -1.0, 1.0] || powers == [-1.0, 1.0, -1.0], "{powers:?}");
    }

    #[test]
    fn one_known_parameter_tells_all_with_its_scale() {
        let found = record([0.0; 2], 1470.0);
        let told: Vec<f64> = found.with_prior(&[None, Some(0.5), None]).into_iter().flatten().collect();
        assert!(told.iter().zip([2.0, 0.5, 4.0]).all(|(found, truth)| (found - truth).abs() < 1e-9), "{told:?}");
    }

    #[test]
    fn products_of_several_records_do_not_show_the_scale() {
        let (one, other) = (record([0.001, -0.001], 1470.0), record([-0.001, 0.001], 0.02));
        let together = pool(&[&one, &other], &Settings::default()).expect("records").estimate;
        assert!(together.status.iter().all(|status| *status == Status::Unobservable), "{together:?}");
        let found = together.in_own_scales().combinations();
        assert_eq!(found.len(), 2, "{found:?}");
        for own in &found {
            let product = own.product.expect("a product");
            let (truth, std) = match (own.lead, product.by, product.power) {
                (0, 2, 1.0) => (0.5, 0.001),
                (1, 2, -1.0) | (2, 1, -1.0) => (2.0, 0.001),
                (0, 1, -1.0) | (1, 0, -1.0) => (1.0, 0.0025),
                (2, 0, 1.0) => (2.0, 0.004),
                other => panic!("{other:?}"),
            };
            assert!((product.value - truth).abs() < 1e-4, "{own:?}");
            assert!(own.std < std, "{own:?}");
        }
    }

    #[test]
    fn a_direction_that_is_not_along_the_values_is_no_scale() {
        let covariance = [vec![1e-6, 0.0], vec![0.0, 1e-6]];
        for values in [[0.5, 0.31], [0.0, 0.0], [1.0, 0.0]] {
            let found = estimate(&values, &covariance, vec![vec![1.0, -1.0]]);
            assert_eq!(found.scale_of(0), None, "{values:?}");
            assert!(found.combinations().iter().all(|own| own.product.is_none()));
        }
    }
}
