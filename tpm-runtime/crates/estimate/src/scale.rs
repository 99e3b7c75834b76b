//! Parameters of which data show ratios alone.
//!
//! A row `phi(q) theta = 0` without an input or a known term holds for every multiple of its parameters: what it hides is the direction along
//! the values themselves. Another record hides a direction that differs by the noise of both, and where the two are put together as they
//! stand, that difference passes for knowledge of the scale. In the gauge in which one of the parameters is one, the others are ratios,
//! and these add up like any other parameters.

use crate::result::Estimate;
use crate::verdict::Status;
use tpm_numerics::{DMatrix, Matrix, tolerance};

/// A hidden direction is along the values where the ratios of its components to these differ by less than this share.
const ALONG: f64 = 0.05;

/// A set of parameters of which data show ratios alone.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Scale {
    /// Its place among the unobservable directions.
    index: usize,
    /// The largest of the parameters, which is one in its gauge.
    pub(super) own: usize,
    /// All of them.
    pub(super) members: Vec<usize>,
}

impl Estimate {
    /// Sets of parameters of which the data show ratios alone.
    pub(super) fn sets(&self) -> Vec<Scale> {
        let of = |&index: &usize| {
            let direction = self.unobservable.get(index)?;
            let members: Vec<usize> =
                (0..direction.len()).filter(|&j| direction[j].abs() > tolerance::COMPONENT).collect();
            let own = members.iter().copied().max_by(|&a, &b| self.values[a].abs().total_cmp(&self.values[b].abs()))?;
            (members.len() > 1 && self.values[own].abs() > 0.0).then_some(Scale { index, own, members })
        };
        self.scales.iter().filter_map(of).collect()
    }

    /// Whether a hidden direction is along the values. Along others these are those of a prior, or zero.
    pub(super) fn is_along(&self, direction: &[f64]) -> bool {
        let members = || (0..direction.len()).filter(|&j| direction[j].abs() > tolerance::COMPONENT);
        let largest = members().max_by(|&a, &b| direction[a].abs().total_cmp(&direction[b].abs()));
        let Some(size) = largest.map(|own| self.values[own] / direction[own]) else { return false };
        size.abs() > 0.0
            && members().count() > 1
            && members().all(|j| (self.values[j] / direction[j] - size).abs() <= ALONG * size.abs())
    }

    /// The estimate in which a parameter of every scale is one, and the direction of the scale is that of the values.
    #[must_use]
    pub fn in_own_scales(mut self) -> Self {
        for scale in self.sets() {
            self = self.in_gauge(&scale.members, scale.own).along(&scale);
        }
        self
    }

    /// The estimate in which one of parameters with a common scale is one, and known.
    pub(super) fn in_gauge(mut self, members: &[usize], own: usize) -> Self {
        let p = self.values.len();
        let size = self.values[own];
        members.iter().for_each(|&j| self.values[j] /= size);
        self.values[own] = 1.0;
        let mut map = DMatrix::identity(p, p);
        for &j in members {
            map[(j, j)] = 1.0 / size;
            map[(j, own)] -= self.values[j] / size;
        }
        map[(own, own)] = 0.0;
        self.covariance = Matrix::of(&map * self.covariance.dense() * map.transpose());
        self
    }

    /// The estimate whose direction of a scale is that of its values, the largest component being one.
    pub(super) fn along(mut self, scale: &Scale) -> Self {
        let largest = scale.members.iter().map(|&j| self.values[j]).max_by(|a, b| a.abs().total_cmp(&b.abs()));
        if let Some(largest) = largest.filter(|largest| largest.abs() > 0.0) {
            let direction = &mut self.unobservable[scale.index];
            direction.fill(0.0);
            scale.members.iter().for_each(|&j| direction[j] = self.values[j] / largest);
        }
        self
    }

    /// The estimate in the gauge of a scale with `own`, which is then what is hidden; as it is where it has no such scale.
    pub(super) fn hiding(self, own: usize) -> Self {
        let Some(scale) = self.sets().into_iter().find(|scale| scale.members.contains(&own)) else { return self };
        let mut gauged = self.in_gauge(&scale.members, own);
        let direction = &mut gauged.unobservable[scale.index];
        direction.fill(0.0);
        direction[own] = 1.0;
        gauged.scales.retain(|index| *index != scale.index);
        gauged
    }

    /// The estimate of what [`hiding`](Self::hiding) estimates told together, whose parameters with a common scale are these.
    pub(super) fn showing(mut self, own: usize, members: &[usize]) -> Self {
        let is_own = |direction: &Vec<f64>| {
            direction.iter().enumerate().all(|(j, component)| (component.abs() > tolerance::COMPONENT) == (j == own))
        };
        let Some(index) = self.unobservable.iter().position(is_own) else { return self };
        for &j in members {
            (self.std[j], self.status[j]) = (f64::INFINITY, Status::Unobservable);
        }
        self.scales.push(index);
        self.along(&Scale { index, own, members: members.to_vec() })
    }
}

#[cfg(test)]
mod tests {
    use crate::pooled::pool;
    use crate::pooled::tests::estimate;
    use crate::result::Estimate;
    use crate::settings::Settings;
    use crate::verdict::Status;

    /// What a record says of (a, b, c) = (2, 0.5, 4), shown up to a common factor, with an error of the ratios: in the gauge `size`.
    fn record(errors: [f64; 2], size: f64) -> Estimate {
        let ratios = [0.5 + errors[0], 0.125 + errors[1], 1.0];
        let values: Vec<f64> = ratios.iter().map(|ratio| ratio * size).collect();
        let variance = (0.001 * size).powi(2);
        let covariance = [vec![variance, 0.0, 0.0], vec![0.0, variance, 0.0], vec![0.0, 0.0, 0.0]];
        let mut found = estimate(&values, &covariance, vec![ratios.to_vec()]);
        found.status = vec![Status::Unobservable; 3];
        found.scales = vec![0];
        assert!(found.is_along(&found.unobservable[0]));
        found
    }

    #[test]
    fn ratios_of_several_records_do_not_show_the_scale() {
        let (one, other) = (record([0.001, -0.001], 1470.0), record([-0.001, 0.001], -0.02));
        let together = pool(&[&one, &other], &Settings::default()).expect("records").estimate;
        assert!(together.status.iter().all(|status| *status == Status::Unobservable), "{together:?}");
        let found = together.in_own_scales().combinations();
        assert_eq!(found.len(), 2);
        for (own, ratio) in found.iter().zip([0.5, 0.125]) {
            let (by, value) = own.ratio.expect("a ratio");
            assert_eq!(by, 2);
            assert!((value - ratio).abs() < 1e-6, "{own:?}");
            assert!((own.std - 0.001 / 2f64.sqrt()).abs() < 1e-5 && own.value.abs() < 1e-12, "{own:?}");
        }
    }

    #[test]
    fn a_direction_that_is_not_along_the_values_is_no_scale() {
        let covariance = [vec![1e-6, 0.0], vec![0.0, 1e-6]];
        for values in [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0]] {
            let found = estimate(&values, &covariance, vec![vec![1.0, -1.0]]);
            assert!(!found.is_along(&found.unobservable[0]), "{values:?}");
            assert!(found.combinations().iter().all(|own| own.ratio.is_none()));
        }
    }
}
