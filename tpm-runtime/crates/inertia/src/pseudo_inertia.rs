//! The pseudo-inertia of a body, P = [[S, h], [h^T, m]] with S = tr(I)/2 1 - I, and its ten parameters.
//!
//! Parameters are those of `tpm_symbolic::mechanics::tree::NAMES`, about the frame of the body; some distribution of mass has them
//! exactly when P is positive semidefinite (Wensing, Kim, Slotine, IEEE RA-L 3, 2018).

use tpm_numerics::{Cholesky, Const, SMatrix};

/// A symmetric 4 x 4 matrix.
pub(crate) type Pseudo = SMatrix<f64, 4, 4>;

/// Rows and columns of the entries of a symmetric 4 x 4 matrix.
pub(crate) const ENTRIES: [(usize, usize); 10] =
    [(0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];

/// The pseudo-inertia of ten parameters.
pub(crate) fn pseudo_inertia(parameters: &[f64; 10]) -> Pseudo {
    let [m, x, y, z, xx, xy, xz, yy, yz, zz] = *parameters;
    let half = (xx + yy + zz) / 2.0;
    Pseudo::new(half - xx, -xy, -xz, x, -xy, half - yy, -yz, y, -xz, -yz, half - zz, z, x, y, z, m)
}

/// The ten parameters of a pseudo-inertia.
pub(crate) fn parameters(p: &Pseudo) -> [f64; 10] {
    let trace = p[(0, 0)] + p[(1, 1)] + p[(2, 2)];
    [
        p[(3, 3)],
        p[(0, 3)],
        p[(1, 3)],
        p[(2, 3)],
        trace - p[(0, 0)],
        -p[(0, 1)],
        -p[(0, 2)],
        trace - p[(1, 1)],
        -p[(1, 2)],
        trace - p[(2, 2)],
    ]
}

/// The Cholesky factor of a pseudo-inertia; `None` where it is not positive definite.
pub(crate) fn factor(p: &Pseudo) -> Option<Pseudo> {
    Cholesky::<f64, Const<4>>::new(*p).map(|factor| factor.l())
}

/// Unit matrices of an orthonormal basis of the symmetric matrices, in the order of [`ENTRIES`].
pub(crate) fn unit(entry: usize) -> Pseudo {
    let (i, j) = ENTRIES[entry];
    let mut matrix = Pseudo::zeros();
    let size = if i == j { 1.0 } else { std::f64::consts::FRAC_1_SQRT_2 };
    matrix[(i, j)] = size;
    matrix[(j, i)] = size;
    matrix
}

/// The pseudo-inertia of a uniform ball.
pub(crate) fn ball(mass: f64, centre: [f64; 3], radius: f64) -> Pseudo {
    let spread = mass * radius * radius / 5.0;
    let place = tpm_numerics::SVector::<f64, 4>::new(centre[0], centre[1], centre[2], 1.0);
    let mut p = place * place.transpose() * mass;
    for i in 0..3 {
        p[(i, i)] += spread;
    }
    p
}

#[cfg(test)]
mod tests {
    use super::{ball, factor, parameters, pseudo_inertia};

    #[test]
    fn parameters_lead_back() {
        let own = [2.0, 0.1, -0.2, 0.3, 0.5, 0.01, -0.02, 0.6, 0.03, 0.7];
        let back = parameters(&pseudo_inertia(&own));
        assert!(own.iter().zip(back).all(|(own, back)| (own - back).abs() < 1e-15), "{back:?}");
    }

    #[test]
    fn a_ball_has_two_fifths_of_its_squared_radius() {
        let found = parameters(&ball(2.0, [0.0, 0.0, 1.0], 0.5));
        assert!((found[9] - 0.4 * 2.0 * 0.25).abs() < 1e-15 && (found[4] - 2.0 - 0.2).abs() < 1e-15, "{found:?}");
        assert!(factor(&pseudo_inertia(&found)).is_some());
        // A triangle of principal moments that does not close.
        assert!(factor(&pseudo_inertia(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 3.0])).is_none());
    }
}
