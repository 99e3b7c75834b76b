//! Products of parameters with known values.
//!
//! With k2 and k2 m2/k3 also m2/k3 is known, and its powers: the exponent vectors of known products form a lattice.
//!
//! Invariant of [`Lattice`]: its basis is in echelon form with positive pivots.

use crate::algebra::fraction::Fraction;
use crate::regressor::inverse::Variable;

/// Exponents of the atoms.
pub(super) type Exponents = Vec<i32>;

/// Products whose values are known, as a basis in echelon form of the lattice of their exponents.
#[derive(Default)]
pub(super) struct Lattice {
    pub(super) basis: Vec<(Exponents, Fraction<Variable>)>,
}

fn pivot_of(exponents: &[i32]) -> Option<usize> {
    exponents.iter().position(|e| *e != 0)
}

impl Lattice {
    /// `exponents` modulo the lattice, and the value of the subtracted product.
    pub(super) fn reduce(&self, mut exponents: Exponents) -> (Exponents, Fraction<Variable>) {
        let mut factor = Fraction::one();
        for (vector, value) in &self.basis {
            let Some(pivot) = pivot_of(vector) else { continue };
            let times = exponents[pivot].div_euclid(vector[pivot]);
            if times != 0 {
                subtract(&mut exponents, vector, times);
                factor = factor.mul(&value.pow(times).expect("invariant: values of products are not zero"));
            }
        }
        (exponents, factor)
    }

    /// Adds a product; Euclid's algorithm on the pivots keeps the echelon form.
    pub(super) fn insert(&mut self, mut exponents: Exponents, mut value: Fraction<Variable>) {
        let power =
            |value: &Fraction<Variable>, e: i32| value.pow(e).expect("invariant: values of products are not zero");
        for (vector, known) in &mut self.basis {
            let Some(pivot) = pivot_of(vector) else { continue };
            match pivot_of(&exponents) {
                None => return,
                Some(own) if own < pivot => break,
                Some(own) if own > pivot => continue,
                Some(_) => {}
            }
            while exponents[pivot] != 0 {
                let times = vector[pivot].div_euclid(exponents[pivot]);
                subtract(vector, &exponents, times);
                *known = known.mul(&power(&value, -times));
                std::mem::swap(vector, &mut exponents);
                std::mem::swap(known, &mut value);
            }
            if vector[pivot] < 0 {
                vector.iter_mut().for_each(|e| *e = -*e);
                *known = power(known, -1);
            }
        }
        let Some(pivot) = pivot_of(&exponents) else { return };
        if exponents[pivot] < 0 {
            exponents.iter_mut().for_each(|e| *e = -*e);
            value = power(&value, -1);
        }
        self.basis.push((exponents, value));
        self.basis.sort_by_key(|(vector, _)| pivot_of(vector));
    }
}

fn subtract(exponents: &mut [i32], vector: &[i32], times: i32) {
    for (e, v) in exponents.iter_mut().zip(vector) {
        *e -= times * v;
    }
}
