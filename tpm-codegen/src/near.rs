//! Rational numbers near floats, for geometry that is written with rounded numbers.

use tpm_symbolic::number::rational::{self, Rational};

/// Largest distance of a rational number from the float that it replaces, relative where the float is above 1.
const WITHIN: f64 = 1e-15;

/// The simplest rational number within 1e-15 of a float (relatively, where the float is above 1): a convergent of its continued
/// fraction. `None` for infinities and NaN.
pub(crate) fn rational(value: f64) -> Option<Rational> {
    let exact = rational::from_f64(value)?;
    let tolerance = rational::from_f64(WITHIN * value.abs().max(1.0))?;
    let mut rest = exact.clone();
    // Numerators and denominators of the last two convergents.
    let (mut before, mut last) =
        ((rational::integer(0), rational::integer(1)), (rational::integer(1), rational::integer(0)));
    loop {
        let whole = Rational::from_integer(floor(&rest));
        let next = (&whole * &last.0 + &before.0, &whole * &last.1 + &before.1);
        let convergent = &next.0 / &next.1;
        let distance = rational::abs(&(&convergent - &exact));
        if distance <= tolerance {
            return Some(convergent);
        }
        (before, last) = (last, next);
        // The distance is not zero, so the remainder is not a whole number and has an inverse.
        rest = (rest - whole).recip();
    }
}

fn floor(value: &Rational) -> num_bigint::BigInt {
    num_integer::Integer::div_floor(&value.numer(), &value.denom())
}

/// A rational unit vector along a direction, within 1e-15, by stereographic projection from the axis opposite to its largest
/// component; `None` for the zero vector.
pub(crate) fn unit_vector(direction: [f64; 3]) -> Option<[Rational; 3]> {
    let length = direction.iter().map(|component| component * component).sum::<f64>().sqrt();
    let largest = (0..3).max_by(|&a, &b| direction[a].abs().total_cmp(&direction[b].abs()))?;
    if length == 0.0 || !length.is_finite() {
        return None;
    }
    let (i, j) = ((largest + 1) % 3, (largest + 2) % 3);
    let sign = direction[largest].signum();
    let projected =
        |component: usize| rational(direction[component] / length / (1.0 + direction[largest].abs() / length));
    let (u, v) = (projected(i)?, projected(j)?);
    let square = &u * &u + &v * &v;
    let divisor = (rational::integer(1) + &square).recip();
    let mut unit = std::array::from_fn(|_| rational::integer(0));
    unit[largest] = (rational::integer(1) - square) * &divisor * rational::from_f64(sign)?;
    unit[i] = u * rational::integer(2) * &divisor;
    unit[j] = v * rational::integer(2) * divisor;
    Some(unit)
}

#[cfg(test)]
mod tests {
    use super::{rational, unit_vector};
    use tpm_symbolic::number::rational::{integer, ratio, to_f64};

    #[test]
    fn simple_numbers_are_found_and_others_are_close() {
        assert_eq!(rational(1.0 / 3.0), Some(ratio(1, 3)));
        assert_eq!(rational(-2.5), Some(ratio(-5, 2)));
        assert_eq!(rational(0.0), Some(integer(0)));
        let near = rational(std::f64::consts::PI).expect("finite");
        assert!((to_f64(&near) - std::f64::consts::PI).abs() < 1e-14 && near.denom().bits() < 28);
        assert_eq!(rational(f64::NAN), None);
    }

    #[test]
    fn unit_vectors_have_length_one_exactly() {
        let direction = [1.0, -1.0, 0.3];
        let unit = unit_vector(direction).expect("a direction");
        assert_eq!(
            unit.iter().map(|component| component * component).sum::<tpm_symbolic::number::rational::Rational>(),
            integer(1)
        );
        let length = direction.iter().map(|component| component * component).sum::<f64>().sqrt();
        for (found, wanted) in unit.iter().zip(direction) {
            assert!((to_f64(found) - wanted / length).abs() < 1e-14);
        }
        assert_eq!(unit_vector([0.0; 3]), None);
    }
}
