//! The minimum where its conditions can be written down.

use crate::nearest::{Evidence, Problem};
use tpm_numerics::{Cholesky, DMatrix, DVector};

const BODY: [f64; 10] = [2.0, 0.2, 0.0, 0.1, 0.1, 0.01, 0.0, 0.12, 0.0, 0.12];

/// A body and a friction, of which the data show the mass and the friction with these deviations.
fn problem(mass: (f64, f64), friction: (f64, f64)) -> Problem {
    let rows = DMatrix::from_fn(2, 11, |row, column| if column == 10 * row { 1.0 } else { 0.0 });
    let covariance = DMatrix::from_diagonal(&DVector::from_vec(vec![mass.1 * mass.1, friction.1 * friction.1]));
    let reference = BODY.into_iter().chain([0.5]);
    Problem {
        evidence: Evidence {
            rows,
            values: DVector::from_vec(vec![mass.0, friction.0]),
            covariance: Cholesky::new(covariance).expect("positive"),
        },
        bodies: vec![std::array::from_fn(|k| k)],
        positive: vec![10],
        loose: Vec::new(),
        reference: DVector::from_iterator(11, reference),
        weight: 1.0,
    }
}

#[test]
fn what_agrees_with_the_reference_leaves_it() {
    let found = problem((2.0, 0.1), (0.5, 0.1)).solve().expect("a minimum");
    let wanted = BODY.into_iter().chain([0.5]);
    assert!(found.parameters.iter().zip(wanted).all(|(own, wanted)| (own - wanted).abs() < 1e-12), "{found:?}");
    // A mass that is known within five percent, by a reference that knows it within a hundred.
    assert!((found.from_data[0] - 1.0 / 1.0025).abs() < 1e-9, "{:?}", found.from_data);
    assert!(found.from_data[4] < 1.0 && found.from_data[10] > 0.9);
}

#[test]
fn impossible_estimates_end_inside_at_every_deviation() {
    for size in [1.0, 0.1, 1e-2, 1e-3] {
        let found = problem((-2.0, size), (-1.0, size)).solve().expect("a minimum");
        assert!(found.parameters[0] > 0.0 && found.parameters[10] > 0.0, "{size}: {found:?}");
        // The condition of the minimum of the friction by itself: (f + 1) / s^2 + 1/r - 1/f = 0.
        let (f, r) = (found.parameters[10], 0.5);
        let slope = (f + 1.0) / (size * size) + 1.0 / r - 1.0 / f;
        assert!(slope.abs() * f < 1e-8, "{size}: {slope}");
    }
}

#[test]
fn a_reference_that_no_body_has_is_refused() {
    let mut own = problem((2.0, 0.1), (0.5, 0.1));
    own.reference[9] = 1.0;
    assert!(own.solve().is_none());
    let mut own = problem((2.0, 0.1), (0.5, 0.1));
    own.reference[10] = 0.0;
    assert!(own.solve().is_none());
}

/// A rotor of which the data show only its sum with a moment of the body.
#[test]
fn a_rotor_seen_with_its_link_takes_what_leaves_the_link_nearest_to_its_reference() {
    let of = |sum: f64| {
        let mut own = problem((2.0, 0.1), (sum, 1e-4));
        own.evidence.rows[(1, 9)] = 1.0;
        (own.positive, own.loose) = (Vec::new(), vec![10]);
        own.reference[10] = sum;
        own.solve().expect("a minimum").parameters
    };
    // Far more than the body has: the rotor is the rest.
    let found = of(2.5 + BODY[9]);
    assert!((found[10] - 2.5).abs() < 1e-3 && (found[9] - BODY[9]).abs() < 1e-3, "{found:?}");
    // Where the sum is what the body alone has, a rotor is next to nothing.
    let found = of(BODY[9]);
    assert!(found[10] > 0.0 && found[10] < 0.01 * BODY[9], "{found:?}");
    // Where it is less, the body gives way.
    let found = of(0.8 * BODY[9]);
    assert!(found[10] > 0.0 && (found[9] + found[10] - 0.8 * BODY[9]).abs() < 1e-3, "{found:?}");
}
