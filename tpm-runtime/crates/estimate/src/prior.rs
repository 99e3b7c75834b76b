//! What stated priors add where data show nothing.

use crate::result::Estimate;
use crate::verdict::Status;
use tpm_numerics::singular::{Singular, unit_columns};
use tpm_numerics::{DMatrix, DVector, tolerance};

impl Estimate {
    /// Values of the parameters that the data do not show, where stated priors and the combinations that the data show determine
    /// them together; nothing for all other parameters.
    ///
    /// With N the hidden directions, theta + N z has the combinations of theta whatever z is. The z taken brings the stated
    /// parameters nearest to their priors, relative to these (least squares); a parameter that moves along what is left of N is
    /// not determined. `prior` has one value per parameter, nothing where none was stated.
    #[must_use]
    pub fn with_prior(&self, prior: &[Option<f64>]) -> Vec<Option<f64>> {
        if self.scales.is_empty() { self.nearest(prior) } else { self.scaled_to(prior).nearest(prior) }
    }

    /// The estimate in whose gauge of every scale a parameter is as its prior says, where one is stated.
    fn scaled_to(&self, prior: &[Option<f64>]) -> Self {
        let mut scaled = self.clone();
        for scale in &self.scales {
            let stated = |j: usize| Some((j, prior.get(j).copied().flatten()? / scaled.values[j]));
            let Some((own, factor)) = scale.members().find_map(stated).filter(|(_, factor)| *factor > 0.0) else {
                continue;
            };
            scale.multiply(&mut scaled.values, factor.powf(scale.powers[own].recip()));
            scaled = scaled.along(scale);
        }
        scaled
    }

    /// [`with_prior`](Self::with_prior) in a gauge near to the prior.
    fn nearest(&self, prior: &[Option<f64>]) -> Vec<Option<f64>> {
        let p = self.values.len();
        let hidden = |j: &usize| self.status[*j] == Status::Unobservable;
        let stated: Vec<(usize, f64)> =
            (0..p).filter(hidden).filter_map(|j| Some((j, prior.get(j).copied().flatten()?))).collect();
        let directions = &self.unobservable;
        if stated.is_empty() || directions.is_empty() {
            return vec![None; p];
        }
        let size = |j: usize, value: f64| if value == 0.0 { self.size_beside(&stated, j) } else { value.abs() };
        let scale: Vec<f64> = stated.iter().map(|&(j, value)| size(j, value)).collect();
        let shares = DMatrix::from_fn(stated.len(), directions.len(), |r, c| directions[c][stated[r].0] / scale[r]);
        let missing = DVector::from_fn(stated.len(), |r, _| (stated[r].1 - self.values[stated[r].0]) / scale[r]);
        let (shares, lengths) = unit_columns(shares);
        let singular = Singular::new(&shares, tolerance::COMPONENT);
        let solved = (singular.left.tr_mul(&missing)).component_div(&singular.values);
        let z = &singular.right * solved;
        let null = singular.null();
        let along = |z: &dyn Fn(usize) -> f64, j: usize| -> f64 {
            directions.iter().enumerate().map(|(c, direction)| direction[j] * z(c) / lengths[c]).sum()
        };
        let moves = |j: usize| {
            null.column_iter().any(|left| {
                let of = |j: usize| along(&|c| left[c], j).abs();
                of(j) > tolerance::COMPONENT * (0..p).map(of).fold(0.0, f64::max)
            })
        };
        let value = |j: usize| {
            let value = self.values[j] + along(&|c| z[c], j);
            // A prior that no combination contradicts is kept as it was stated.
            let kept = stated.iter().zip(&scale).find(|((own, _), _)| *own == j);
            match kept {
                Some(((_, prior), size)) if (value - prior).abs() <= tolerance::COMPONENT * size => *prior,
                _ => value,
            }
        };
        (0..p).map(|j| (hidden(&j) && !moves(j)).then(|| value(j))).collect()
    }

    /// The size of a parameter whose prior is zero, from those of the stated parameters that share a hidden direction with it.
    fn size_beside(&self, stated: &[(usize, f64)], parameter: usize) -> f64 {
        let beside = self.unobservable.iter().flat_map(|direction| {
            let others = stated.iter().filter(|(j, _)| direction[*j].abs() > tolerance::COMPONENT);
            others.map(|(j, value)| (value * direction[parameter] / direction[*j]).abs())
        });
        let size = beside.fold(0.0, f64::max);
        if size > 0.0 { size } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Estimate, Status};
    use tpm_numerics::{DMatrix, Matrix};

    /// Data that show a + 2 b = 5 and c = 7, and nothing of d.
    fn estimate() -> Estimate {
        let hidden = Status::Unobservable;
        Estimate {
            values: vec![1.0, 2.0, 7.0, 0.0],
            std: vec![f64::INFINITY, f64::INFINITY, 0.1, f64::INFINITY],
            covariance: Matrix::of(DMatrix::zeros(4, 4)),
            status: vec![hidden, hidden, Status::Identified, hidden],
            rank: 2,
            unobservable: vec![vec![1.0, -0.5, 0.0, 0.0], vec![0.0, 0.0, 0.0, 1.0]],
            scales: Vec::new(),
            condition: 1.0,
            residual: 0.0,
            residual_of: crate::ResidualOf::Force,
            chi_squared: 1.0,
            model_error: Vec::new(),
        }
    }

    #[test]
    fn combinations_hold_and_nothing_unstated_has_a_value() {
        assert_eq!(estimate().with_prior(&[None; 4]), [None; 4]);
        let one = estimate().with_prior(&[Some(4.0), None, Some(1.0), None]);
        assert!(one[2].is_none() && one[3].is_none(), "{one:?}");
        let [a, b] = [0, 1].map(|j| one[j].expect("determined"));
        assert!((a - 4.0).abs() < 1e-12 && (b - 0.5).abs() < 1e-12, "{one:?}");
        // Both are stated and contradict the data: the combination holds, and a zero that was stated is one.
        let both = estimate().with_prior(&[Some(4.0), Some(2.0), None, Some(0.0)]);
        let [a, b] = [0, 1].map(|j| both[j].expect("determined"));
        assert!((a + 2.0 * b - 5.0).abs() < 1e-12 && a < 4.0 && b < 2.0, "{both:?}");
        assert_eq!(both[3], Some(0.0));
    }
}
