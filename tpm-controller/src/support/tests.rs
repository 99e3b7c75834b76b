use super::{
    Label, MonitorRules, MonitorState, Monitoring, Real, SampleFault, SingularMass, Solution, SolveError, SquareRoot,
    accelerations, factors_hold, least_squares, weighted_least_squares,
};

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

/// A row of some motion: the columns have sizes 1e-6 to 1e3.
fn row(i: usize) -> [f64; 4] {
    let t = i as f64 * 0.37;
    [1e-6 * t.sin(), (2.1 * t).cos(), 30.0 * (0.7 * t).sin(), 1e3 * ((0.7 * t).sin() + 0.05 * (1.3 * t).cos())]
}

const TRUTH: [f64; 4] = [4e5, -1.5, 0.02, 3e-3];

fn force(row: &[f64; 4], noise: f64) -> f64 {
    row.iter().zip(TRUTH).map(|(a, b)| a * b).sum::<f64>() + noise
}

/// Deterministic noise in (-1, 1).
fn noise(i: usize) -> f64 {
    ((i * 7919 % 1009) as f64 / 504.5) - 1.0
}

#[test]
fn rows_one_by_one_give_least_squares_of_all_rows() {
    const ROWS: usize = 60;
    let matrix: [[f64; 4]; ROWS] = core::array::from_fn(row);
    let right: [f64; ROWS] = core::array::from_fn(|i| force(&row(i), 0.1 * noise(i)));
    let whole = weighted_least_squares(&matrix, &right, None, &labels(["a", "b", "c", "d"])).expect("full rank");
    let mut sums = SquareRoot::default();
    matrix.iter().zip(right).for_each(|(row, right)| sums.push(*row, right).expect("finite"));
    let found = sums.solution();
    assert_eq!((found.rank, sums.rows()), (4, ROWS as f64));
    for c in 0..4 {
        let (value, deviation) = (found.solution[c].expect("shown"), found.deviations[c].expect("shown"));
        assert!((value / whole.solution[c] - 1.0).abs() < 1e-11, "{found:?} {whole:?}");
        assert!((deviation / whole.covariance[c][c].sqrt() - 1.0).abs() < 1e-11, "{found:?} {whole:?}");
    }
    assert!(
        (found.residual / whole.residual - 1.0).abs() < 1e-11 && (found.condition / whole.condition - 1.0).abs() < 1e-9
    );
}

#[test]
fn single_precision_keeps_its_digits_over_many_rows() {
    let mut sums = SquareRoot::default();
    for i in 0..20_000 {
        let row = row(i);
        sums.push(row.map(|entry| entry as f32), force(&row, 0.0) as f32).expect("finite");
    }
    let found = sums.solution();
    for (value, truth) in found.solution.iter().zip(TRUTH) {
        let value = f64::from(value.expect("shown"));
        assert!((value / truth - 1.0).abs() < 3e-3, "{found:?}");
    }
}

#[test]
fn what_the_rows_do_not_show_has_no_value() {
    // The third column is the second plus twice the first; the last one is zero.
    let mut sums = SquareRoot::default();
    assert_eq!(sums.solution().rank, 0);
    assert_eq!(sums.solution().solution, [None; 5]);
    for i in 0..5_000 {
        let [a, b, c, _] = row(i).map(|entry| entry as f32);
        let row = [a, b, b + 2e6 * a, c, 0.0];
        sums.push(row, 2.0 * b + 0.5 * c).expect("finite");
    }
    assert_eq!(sums.push([1.0, f32::NAN, 0.0, 0.0, 0.0], 0.0), Err(SampleFault::NotFinite));
    assert_eq!(sums.push([0.0; 5], f32::INFINITY), Err(SampleFault::NotFinite));
    let found = sums.solution();
    assert_eq!(found.rank, 3);
    assert_eq!(found.solution.map(|value| value.is_some()), [false, false, false, true, false]);
    assert_eq!(found.deviations.map(|value| value.is_some()), [false, false, false, true, false]);
    assert!((found.solution[3].expect("shown") - 0.5).abs() < 1e-4, "{found:?}");
}

/// Of columns that go together their combination is shown, with its deviation, and a step leaves what is hidden as it is.
#[test]
fn combinations_are_kept_and_stepped_along() {
    // The second column is half of the first, which is as long as the third: a + c/2 is shown, and b.
    let mut sums = SquareRoot::<f64, 3>::default();
    for i in 0..400 {
        let [a, b, ..] = row(i);
        sums.push([a, b, a / 2.0], 3.0 * a - 1.5 * b).expect("finite");
    }
    let mut found = Solution::default();
    sums.solve(&mut found);
    assert_eq!((found.rank, found.shown), (2, [false, true, false]));
    let lead = if found.combinations[0][0] > 0.0 { 0 } else { 2 };
    let [one, other] = if lead == 0 { [1.0, 0.5] } else { [2.0, 1.0] };
    assert_eq!(found.combinations[2 - lead], [0.0; 3], "{found:?}");
    assert!((found.combinations[lead][0] - one).abs() < 1e-9 && (found.combinations[lead][2] - other).abs() < 1e-9);
    assert!((found.values[lead] - if lead == 0 { 3.0 } else { 6.0 }).abs() < 1e-9, "{found:?}");
    assert!(found.deviations[lead] > 0.0 && found.combinations[1] == [0.0, 1.0, 0.0]);
    // In the size of their columns both move by as much.
    assert!((found.steps[0] - 1.5).abs() < 1e-9 && (found.steps[2] - 3.0).abs() < 1e-9, "{found:?}");
    assert!((found.steps[1] + 1.5).abs() < 1e-9);
    // About other parameters the combination has their share.
    assert!((found.combined(&[1.0, 5.0, 4.0], lead) - if lead == 0 { 6.0 } else { 12.0 }).abs() < 1e-9);
}

/// One wrong number among thousands does not decide; a machine that has changed is followed.
#[test]
fn a_row_that_stands_out_is_left_out_as_long_as_such_rows_are_rare() {
    let mut state = 5_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 11) as f64 / 2_f64.powi(53) - 0.5) * 0.1
    };
    let mut sums = SquareRoot::<f64, 2>::default();
    let mut left_out = 0;
    for i in 0..6000 {
        let (a, b) = (libm::sin(0.7 * f64::from(i)), libm::cos(1.3 * f64::from(i)));
        let (mut given, mut force) = ([a, b], 2.0 * a + 3.0 * b + noise());
        match i {
            2000 => force = 1e6,
            3000 => given[0] = 1e20,
            _ => {}
        }
        let odd = sums.stands_out(&mut given.clone(), force) && sums.leaves_out();
        assert_eq!(odd, i == 2000 || i == 3000, "{i}");
        if !odd {
            sums.push(given, force).expect("finite");
        }
    }
    let found = sums.solution().solution.map(|value| value.expect("shown"));
    assert!((found[0] - 2.0).abs() < 0.01 && (found[1] - 3.0).abs() < 0.01, "{found:?}");
    for i in 0..60_000 {
        let (a, b) = (libm::sin(0.7 * f64::from(i)), libm::cos(1.3 * f64::from(i)));
        let force = 200.0 * a + 3.0 * b + noise();
        if sums.stands_out(&mut [a, b], force) && sums.leaves_out() {
            left_out += 1;
        } else {
            sums.push([a, b], force).expect("finite");
        }
    }
    assert!((1..=660).contains(&left_out), "{left_out}");
    assert!(sums.solution().solution[0].is_some_and(|found| found > 150.0));
}

#[test]
fn the_past_fades() {
    let mut sums = SquareRoot::default();
    for i in 0..400 {
        let row = row(i);
        let mut machine = TRUTH;
        machine[1] = if i < 200 { 7.0 } else { -1.5 };
        let force: f64 = row.iter().zip(machine).map(|(a, b)| a * b).sum();
        sums.push(row, force).expect("finite");
        if i % 20 == 19 {
            sums.fade(0.1);
        }
    }
    let found = sums.solution();
    assert!((found.solution[1].expect("shown") + 1.5).abs() < 1e-6, "{found:?}");
    assert!(sums.rows() < 23.0);
}

#[test]
fn accelerations_solve_and_name_what_is_singular() {
    // a = (1, -2, 3), rows in units 1e12 apart, the second pivot below the first row.
    let matrix = [[0.0, 2e-9, -1e-9], [2.0, 5.0, 1.0], [3e12, 0.0, 1e12]];
    let names = labels(["q1", "q2", "q3"]);
    let found = accelerations(matrix, [-7e-9, -5.0, 6e12], &names).expect("regular");
    for (found, expected) in found.iter().zip([1.0_f64, -2.0, 3.0]) {
        assert!((found - expected).abs() < 1e-13, "{found} {expected}");
    }
    let double = labels(["q1", "q2"]);
    let singular = accelerations([[1.0_f64, 2.0], [2.0, 4.0]], [1.0, 2.0], &double);
    assert_eq!(singular, Err(SingularMass::Undetermined { coordinate: 1, name: "q2" }));
    let zero = accelerations([[0.0_f32; 2]; 2], [1.0; 2], &double);
    assert_eq!(zero, Err(SingularMass::Undetermined { coordinate: 0, name: "q1" }));
    assert_eq!(accelerations([[1.0, f64::NAN], [0.0, 1.0]], [0.0; 2], &double), Err(SingularMass::NotFinite));
    // Factors of [2 1; 1 1], of a singular matrix, and of one that is not definite.
    assert!(factors_hold(&[1.0_f64, 1.0], &[2.0, 1.0], &[1.0, -1.0]));
    for pivots in [[2.0_f64, 0.0], [2.0, -1.0], [f64::NAN, 1.0]] {
        assert!(!factors_hold(&pivots, &[2.0, 1.0], &[1.0, -1.0]));
    }
    assert!(!factors_hold(&[1.0_f64, 1.0], &[2.0, 1.0], &[f64::INFINITY, 1.0]));
    // A small inertia is not a singular one.
    assert!(accelerations([[5.4e-6_f64, 0.0], [0.0, 7.0]], [1.0, 1.0], &double).is_ok());
}

/// A mass on a dry guide, m a + c sign(v) = force, that stands still half of the time; its friction holds anything within its limits then.
/// What its monitor says after so many blocks of 50 samples, of which the mass is `mass` from block 400 on. `zone` says whether it is told
/// of the sign.
fn watched(blocks: usize, mass: f64, zone: bool) -> (usize, MonitorState<f64>) {
    const VELOCITY: f64 = 1e-3;
    const ACCELERATION: f64 = 2e-2;
    let rules = MonitorRules {
        values: [2.0, 1.5],
        spread: [[0.002, 0.0], [0.0, 0.0015]],
        changes: [0.2, 0.15],
        drifts: [0.0, 0.5],
        deviations: [1.0],
        sample_time: 0.02,
        block: 50,
        run_in: 100,
        false_alarms: 1e-3,
    };
    rules.check().expect("good rules");
    let mut state = 7_u64;
    let mut noise = || {
        let mut sum = -6.0;
        for _ in 0..12 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (state >> 11) as f64 / 2_f64.powi(53);
        }
        sum
    };
    let mut watch = Monitoring::<f64, 1, 2, 1>::new(&rules);
    let arguments = |v: f64| [[if zone { v } else { 1.0 }]];
    for _ in 0..1000 {
        let (v, a) = (VELOCITY * noise(), ACCELERATION * noise());
        watch.rest(&mut [[a, Real::sign(v)]], &arguments(v), &[[false, true]]);
    }
    for block in 0..blocks {
        let moves = block % 20 < 10;
        let held = f64::from(block as u32 / 20 % 5) / 2.0 - 1.0;
        for k in 0..50 {
            let t = 0.02 * (block * 50 + k) as f64;
            let (v, a) = if moves { (1.3 * (2.1 * t).sin(), 2.73 * (2.1 * t).cos()) } else { (0.0, 0.0) };
            let sign = if moves { Real::sign(v) } else { held };
            let mass = if block < 400 { 2.0 } else { mass };
            let force = mass * a + 1.5 * (1.0 + 0.3 * (0.01 * t).sin()) * sign + 0.2 * noise();
            let (v, a) = (v + VELOCITY * noise(), a + ACCELERATION * noise());
            let still = watch.is_still(0, &arguments(v));
            let taken = still || watch.block.push([a, Real::sign(v)], force).is_ok();
            let _ = watch.count(taken, u32::from(!still));
        }
        if matches!(watch.state(), MonitorState::Moved(_) | MonitorState::Unexplained(_)) {
            return (block, watch.state());
        }
    }
    (blocks, watch.state())
}

#[test]
fn dry_friction_at_rest_is_neither_noise_nor_a_change() {
    let (_, usual) = watched(3000, 2.0, true);
    assert!(matches!(usual, MonitorState::Watching(_)), "{usual:?}");
    let (block, heavier) = watched(3000, 2.2, true);
    let MonitorState::Moved(moved) = heavier else { panic!("{heavier:?}") };
    assert!((400..430).contains(&block), "{block}");
    assert_eq!(moved.parameter, 0);
    assert!((moved.change - 0.2).abs() < 5.0 * moved.deviation, "{moved:?}");
    // Not told of the sign, it takes what friction holds at rest for something else.
    let (_, untold) = watched(3000, 2.0, false);
    assert!(!matches!(untold, MonitorState::Watching(_)), "{untold:?}");
}
