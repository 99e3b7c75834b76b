use super::{Label, Real, SolveError, least_squares, weighted_least_squares};

fn labels<const C: usize>(names: [&'static str; C]) -> [Label<'static>; C] {
    names.map(Label::bare)
}

#[test]
fn an_overdetermined_system_gives_the_minimum() {
    // y = a + b t fitted to (0, 1), (1, 3), (2, 4), (3, 4): a = 3/2, b = 1.
    let matrix = [[1.0_f64, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 3.0]];
    let x = least_squares(&matrix, &[1.0, 3.0, 4.0, 4.0], &labels(["a", "b"])).expect("full rank");
    assert!((x[0] - 1.5).abs() < 1e-14 && (x[1] - 1.0).abs() < 1e-14, "{x:?}");
}

#[test]
fn covariance_is_the_inverse_of_the_information() {
    // y = a + b t at t = 0, 1, 2 with deviations 1, 1/2, 1: information [[6, 6], [6, 8]], inverse [[2/3, -1/2], [-1/2, 1/2]].
    let matrix = [[1.0_f64, 0.0], [1.0, 1.0], [1.0, 2.0]];
    let found = weighted_least_squares(&matrix, &[1.0, 3.0, 5.0], Some(&[1.0, 0.5, 1.0]), &labels(["a", "b"]));
    let found = found.expect("full rank");
    let expected = [[2.0 / 3.0, -0.5], [-0.5, 0.5]];
    for (row, expected) in found.covariance.iter().zip(&expected) {
        assert!(row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14), "{found:?}");
    }
    assert!(
        (found.solution[0] - 1.0).abs() < 1e-14 && (found.solution[1] - 2.0).abs() < 1e-14 && found.residual < 1e-14
    );
    // The scaled columns have the Gram matrix [[1, c], [c, 1]] with c^2 = 3/4: condition^2 = 2 * 2 / (1 - c^2).
    assert!((found.condition - 4.0).abs() < 1e-13, "{}", found.condition);
    let plain = weighted_least_squares(&matrix, &[1.0, 3.0, 6.0], None, &labels(["a", "b"])).expect("full rank");
    assert_eq!(least_squares(&matrix, &[1.0, 3.0, 6.0], &labels(["a", "b"])), Ok(plain.solution));
    assert!((plain.residual - 1.0 / 6.0_f64.sqrt()).abs() < 1e-14, "{}", plain.residual);
    let none = weighted_least_squares(&matrix, &[1.0; 3], Some(&[0.0; 3]), &labels(["a", "b"]));
    assert_eq!(none, Err(SolveError::NotFinite));
}

#[test]
fn columns_of_any_size_and_order() {
    // Hilbert-like columns scaled by 1e-200 .. 1e200: the scaling must not cost digits.
    let scales = [1e-200_f64, 1e200, 1.0];
    let truth = [3.0, -2.0, 0.5];
    let mut matrix = [[0.0; 3]; 5];
    let mut right = [0.0; 5];
    for (i, (row, b)) in matrix.iter_mut().zip(&mut right).enumerate() {
        for (j, entry) in row.iter_mut().enumerate() {
            let plain = 1.0 / (i + j + 1) as f64;
            *entry = plain * scales[j];
            *b += plain * truth[j];
        }
    }
    let x = least_squares(&matrix, &right, &labels(["a", "b", "c"])).expect("full rank");
    for ((x, truth), scale) in x.iter().zip(truth).zip(scales) {
        assert!((x * scale - truth).abs() < 1e-12, "{x:e} {scale:e}");
    }
}

#[test]
fn what_is_not_determined_is_named() {
    let matrix = [[1.0_f64, 2.0, 0.0], [2.0, 4.0, 1.0], [3.0, 6.0, 1.0]];
    let error = least_squares(&matrix, &[1.0; 3], &labels(["m", "k1", "k2"]));
    assert!(matches!(error, Err(SolveError::Unobservable { name: "m" | "k1", .. })), "{error:?}");
    let zero = least_squares(&[[1.0_f32, 0.0], [1.0, 0.0]], &[1.0; 2], &labels(["m", "k"]));
    assert_eq!(zero, Err(SolveError::Unobservable { parameter: 1, name: "k" }));
    let few = least_squares(&[[1.0_f64, 2.0]], &[1.0], &labels(["m", "k"]));
    assert!(matches!(few, Err(SolveError::Unobservable { .. })), "{few:?}");
    assert_eq!(least_squares(&[[f64::NAN]], &[1.0], &labels(["m"])), Err(SolveError::NotFinite));
    assert_eq!(least_squares(&[[1.0]], &[f64::INFINITY], &labels(["m"])), Err(SolveError::NotFinite));
}

#[test]
fn sign_is_zero_at_rest_and_keeps_a_fault_visible() {
    assert_eq!(Real::sign(0.0_f64), 0.0);
    assert_eq!(Real::sign(-0.0_f64), 0.0);
    assert_eq!(Real::sign(-3.0_f32), -1.0);
    assert_eq!(Real::sign(1e-300_f64), 1.0);
    assert!(Real::sign(f64::NAN).is_nan());
}

#[test]
fn powers_and_extremes() {
    assert_eq!(Real::powi(3.0_f64, 5), 243.0);
    assert_eq!(Real::powi(0.0_f64, 0), 1.0);
    assert_eq!(Real::max(f64::NAN, 1.0), 1.0);
    assert_eq!(Real::min(1.0, f64::NAN), 1.0);
    assert_eq!(Real::max(2.0_f32, 1.0), 2.0);
}
