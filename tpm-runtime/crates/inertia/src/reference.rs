//! The inertias of a description as a reference, mended where no body has them.

use crate::pseudo_inertia::{ball, factor, parameters, pseudo_inertia};
use tpm_numerics::SMatrix;

/// Radius of the ball in place of a body without mass in the description, m.
const RADIUS: f64 = 0.05;
/// Least moment about the centre of mass of a mended body, as that of its mass at this distance, m.
const LEAST_DISTANCE: f64 = 0.01;
/// Least principal value of the integral of p p^T about the centre, as a share of the largest.
const LEAST_SHARE: f64 = 1e-3;

/// Parameters that a body can have, near those of a description; and whether they are others than given. A body without mass becomes a
/// ball of the mass `least`.
pub(crate) fn possible(given: &[f64; 10], least: f64) -> ([f64; 10], bool) {
    let pseudo = pseudo_inertia(given);
    if factor(&pseudo).is_some() {
        return (*given, false);
    }
    let mass = given[0];
    if mass <= 0.0 {
        return (parameters(&ball(least, [0.0; 3], RADIUS)), true);
    }
    let first = pseudo.fixed_view::<3, 1>(0, 3).into_owned();
    let about: SMatrix<f64, 3, 3> = pseudo.fixed_view::<3, 3>(0, 0) - first * first.transpose() / mass;
    let mut eigen = about.symmetric_eigen();
    let bound = (eigen.eigenvalues.max() * LEAST_SHARE).max(mass * LEAST_DISTANCE * LEAST_DISTANCE);
    eigen.eigenvalues.iter_mut().for_each(|value| *value = value.max(bound));
    let mut mended = pseudo;
    mended.fixed_view_mut::<3, 3>(0, 0).copy_from(&(eigen.recompose() + first * first.transpose() / mass));
    (parameters(&mended), true)
}

#[cfg(test)]
mod tests {
    use super::possible;
    use crate::pseudo_inertia::{factor, pseudo_inertia};

    #[test]
    fn only_what_no_body_has_is_mended() {
        let fine = [2.0, 0.2, 0.0, 0.0, 0.1, 0.0, 0.0, 0.12, 0.0, 0.12];
        assert_eq!(possible(&fine, 1.0), (fine, false));
        let (nothing, point) = ([0.0; 10], [2.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.02]);
        let open = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 3.0];
        for given in [nothing, point, open] {
            let (found, mended) = possible(&given, 0.5);
            assert!(mended && factor(&pseudo_inertia(&found)).is_some(), "{found:?}");
            assert!(given[0] == 0.0 || found[..4] == given[..4], "{found:?}");
        }
    }
}
