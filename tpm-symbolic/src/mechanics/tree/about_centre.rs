//! Mass, centre of mass and moments about it, as descriptions of robots write them, and the proof that a body can have them.
//!
//! With the integral of p p^T over the mass about the centre, S = tr(I)/2 1 - I, some distribution of mass has these values exactly
//! when m > 0 and S is positive definite: the 4 x 4 pseudo-inertia of the body about any frame is then positive definite too (Wensing,
//! Kim, Slotine, IEEE RA-L 3, 2018).

use crate::mechanics::tree::inertia::MOMENTS;
use crate::number::rational::{Rational, integer};
use num_traits::{Signed, Zero};

/// A body by its mass, its centre of mass and its moments about this centre, along the axes of its frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AboutCentre {
    /// The mass, kg.
    pub mass: Rational,
    /// The centre of mass in the frame, m.
    pub centre: [Rational; 3],
    /// Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the centre of mass, kg m^2.
    pub moments: [Rational; 6],
}

impl AboutCentre {
    /// A body without mass.
    #[must_use]
    pub fn nothing() -> Self {
        Self {
            mass: Rational::zero(),
            centre: std::array::from_fn(|_| Rational::zero()),
            moments: std::array::from_fn(|_| Rational::zero()),
        }
    }

    /// The body with these parameters about the origin of its frame, in the order of [`NAMES`](super::NAMES); `None` without mass.
    #[must_use]
    pub fn of_parameters(parameters: &[Rational; 10]) -> Option<Self> {
        let mass = parameters[0].clone();
        if mass.is_zero() {
            return None;
        }
        let centre: [Rational; 3] = std::array::from_fn(|i| &parameters[1 + i] / &mass);
        let away = steiner(&mass, &centre);
        Some(Self { moments: std::array::from_fn(|k| &parameters[4 + k] - &away[k]), mass, centre })
    }

    /// The ten parameters about the origin of the frame, in the order of [`NAMES`](super::NAMES).
    #[must_use]
    pub fn parameters(&self) -> [Rational; 10] {
        let away = steiner(&self.mass, &self.centre);
        std::array::from_fn(|k| match k {
            0 => self.mass.clone(),
            1..4 => &self.mass * &self.centre[k - 1],
            _ => &self.moments[k - 4] + &away[k - 4],
        })
    }

    /// Whether the mass and the integral of p p^T about the centre are positive definite: the leading minors are positive.
    #[must_use]
    pub fn is_possible(&self) -> bool {
        let [xx, xy, xz, yy, yz, zz] = &self.moments;
        let half = (xx + yy + zz) / integer(2);
        let [a, b, c] = [&half - xx, &half - yy, &half - zz];
        let [ab, ac, bc] = [-xy.clone(), -xz.clone(), -yz.clone()];
        let second = &a * &b - &ab * &ab;
        let third = &a * (&b * &c - &bc * &bc) - &ab * (&ab * &c - &bc * &ac) + &ac * (&ab * &bc - &b * &ac);
        [&self.mass, &a, &second, &third].into_iter().all(Signed::is_positive)
    }
}

/// The moments of a mass at a place: m (c.c 1 - c c^T).
fn steiner(mass: &Rational, centre: &[Rational; 3]) -> [Rational; 6] {
    let square: Rational = centre.iter().map(|component| component * component).sum();
    MOMENTS.map(|(i, j)| {
        let product = &centre[i] * &centre[j];
        mass * if i == j { &square - &product } else { -product }
    })
}

#[cfg(test)]
mod tests {
    use super::AboutCentre;
    use crate::number::rational::integer;

    fn body(mass: i64, moments: [i64; 6]) -> AboutCentre {
        AboutCentre { mass: integer(mass), centre: [1, -2, 3].map(integer), moments: moments.map(integer) }
    }

    #[test]
    fn limiting_bodies_are_not_possible() {
        assert!(body(1, [2, 0, 0, 2, 0, 3]).is_possible());
        assert!(body(1, [4, 1, -1, 5, 1, 6]).is_possible());
        // A plate, a triangle that does not close, moments about some axis below zero, and no mass.
        for (mass, moments) in
            [(1, [1, 0, 0, 1, 0, 2]), (1, [1, 0, 0, 1, 0, 3]), (1, [2, 3, 0, 2, 0, 2]), (0, [2, 0, 0, 2, 0, 3])]
        {
            assert!(!body(mass, moments).is_possible(), "{mass} {moments:?}");
        }
    }

    #[test]
    fn parameters_about_a_frame_lead_back() {
        let own = body(2, [4, 1, -1, 5, 1, 6]);
        let parameters = own.parameters();
        // Ixx of two kilograms at (1, -2, 3), and Ixy.
        assert_eq!((&parameters[4], &parameters[5]), (&integer(4 + 2 * 13), &integer(1 + 2 * 2)));
        assert_eq!(AboutCentre::of_parameters(&parameters), Some(own));
        assert_eq!(AboutCentre::of_parameters(&AboutCentre::nothing().parameters()), None);
    }
}
