//! Rotations with rational entries.
//!
//! Invariant: a [`Rotation`] is a product of rotations by angles whose cosine and sine are rational, so that it is
//! exactly orthogonal. Such angles exist near any angle: cos a = (1 - t^2)/(1 + t^2), sin a = 2t/(1 + t^2) with
//! rational t near tan(a/2).

use crate::number::rational::{Rational, integer};
use num_traits::{One, Zero};
use serde::{Deserialize, Serialize};

/// An angle by its cosine and sine, which are rational.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Angle {
    cosine: Rational,
    sine: Rational,
}

impl Angle {
    /// This many quarter turns.
    #[must_use]
    pub fn quarter_turns(count: i64) -> Self {
        let (cosine, sine) = [(1, 0), (0, 1), (-1, 0), (0, -1)][count.rem_euclid(4) as usize];
        Self { cosine: integer(cosine), sine: integer(sine) }
    }

    /// The angle whose half has this tangent.
    #[must_use]
    pub fn half_tangent(tangent: &Rational) -> Self {
        let square = tangent * tangent;
        let divisor = (Rational::one() + &square).recip();
        Self { cosine: (Rational::one() - square) * &divisor, sine: tangent * integer(2) * divisor }
    }
}

/// A rotation matrix: its columns are the axes of the rotated frame in the original frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rotation([[Rational; 3]; 3]);

impl Default for Rotation {
    fn default() -> Self {
        Self::identity()
    }
}

impl Rotation {
    /// No rotation.
    #[must_use]
    pub fn identity() -> Self {
        Self(std::array::from_fn(|i| std::array::from_fn(|j| integer(i64::from(i == j)))))
    }

    /// Rotations about the fixed axes x, then y, then z: the roll, pitch and yaw of robot descriptions.
    #[must_use]
    pub fn roll_pitch_yaw(angles: &[Angle; 3]) -> Self {
        let [roll, pitch, yaw] = [0, 1, 2].map(|axis| Self::about(axis, &angles[axis]));
        yaw.times(&pitch).times(&roll)
    }

    /// The rotation about the x, y or z axis (0, 1, 2).
    fn about(axis: usize, angle: &Angle) -> Self {
        let mut rotation = Self::identity();
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        rotation.0[i][i] = angle.cosine.clone();
        rotation.0[j][j] = angle.cosine.clone();
        rotation.0[i][j] = -angle.sine.clone();
        rotation.0[j][i] = angle.sine.clone();
        rotation
    }

    /// The product: `other` first, then this one.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| &self.0[i][k] * &other.0[k][j]).sum())))
    }

    /// The inverse.
    #[must_use]
    pub fn transposed(&self) -> Self {
        Self(std::array::from_fn(|i| std::array::from_fn(|j| self.0[j][i].clone())))
    }

    /// Whether an axis of the rotated frame is parallel to an axis of the original frame.
    #[must_use]
    pub fn keeps_axis(&self, axis: usize) -> bool {
        frame_axis(&[0, 1, 2].map(|row| self.entry(row, axis).clone())).is_some()
    }

    /// The entry of a row and a column, both from 0.
    #[must_use]
    pub fn entry(&self, row: usize, column: usize) -> &Rational {
        &self.0[row][column]
    }
}

/// The axis of the frame (0, 1, 2) to which a unit vector is parallel, in either direction; `None` when there is none.
#[must_use]
pub fn frame_axis(direction: &[Rational; 3]) -> Option<usize> {
    let mut present = (0..3).filter(|&k| !direction[k].is_zero());
    let axis = present.next()?;
    present.next().is_none().then_some(axis)
}

/// The direction of a vector as a unit vector, where that is rational; `None` for the zero vector and where the length is not
/// rational.
#[must_use]
pub fn unit_vector(direction: &[Rational; 3]) -> Option<[Rational; 3]> {
    let square: Rational = direction.iter().map(|component| component * component).sum();
    if square.is_zero() {
        return None;
    }
    let length = Rational::new(square.numer().sqrt(), square.denom().sqrt());
    (&length * &length == square).then(|| direction.clone().map(|component| component / &length))
}

#[cfg(test)]
mod tests {
    use super::{Angle, Rotation, unit_vector};
    use crate::number::rational::{integer, ratio};

    #[test]
    fn rotations_are_orthogonal_and_in_the_order_of_descriptions() {
        let angles = [Angle::half_tangent(&ratio(1, 3)), Angle::quarter_turns(-1), Angle::half_tangent(&ratio(-2, 7))];
        let rotation = Rotation::roll_pitch_yaw(&angles);
        assert_eq!(rotation.times(&rotation.transposed()), Rotation::identity());
        // A quarter turn about x takes y to z, and a quarter turn about z then leaves it there.
        let turned =
            Rotation::roll_pitch_yaw(&[Angle::quarter_turns(1), Angle::quarter_turns(0), Angle::quarter_turns(1)]);
        assert_eq!([0, 1, 2].map(|row| turned.entry(row, 1).clone()), [0, 0, 1].map(integer));
    }

    #[test]
    fn a_direction_has_a_rational_unit_vector_or_none() {
        let direction = [3, 0, -4].map(integer);
        assert_eq!(unit_vector(&direction), Some([ratio(3, 5), integer(0), ratio(-4, 5)]));
        assert_eq!(unit_vector(&[1, 1, 0].map(integer)), None);
        assert_eq!(unit_vector(&[0, 0, 0].map(integer)), None);
    }
}
