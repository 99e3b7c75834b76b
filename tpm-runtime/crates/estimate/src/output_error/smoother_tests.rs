//! The smoother against a dense twin: the same least squares with all unknowns at once, and the marginal likelihood of its readings.

use crate::output_error::chain::Chain;
use crate::output_error::noise::Noise;
use crate::output_error::smoother::Smoothed;
use crate::output_error::solution::Solution;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tpm_numerics::{DMatrix, DVector};

const SAMPLES: usize = 20;
const COLUMNS: usize = 2;
/// Two states and two columns, one input, one switch.
const ORDER: usize = 2;
/// Agreement of the two, beside which the weight of what is exact is negligible.
const BOUND: f64 = 1e-6;

/// What is special about a record.
#[derive(Clone, Copy, Default)]
struct Case {
    /// One state of two coordinates each, instead of position and velocity of one.
    two_sensors: bool,
    colour: f64,
    input: f64,
    missing: bool,
    broken: bool,
    loose: bool,
    /// Whether a column acts on a reading.
    reading: bool,
    /// Whether the inputs are exact but where a coordinate turns.
    only_at_turns: bool,
}

fn chain(case: Case) -> Chain {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let transitions = SAMPLES - 1;
    let outputs = if case.two_sensors { vec![0, 1] } else { vec![0] };
    let width = COLUMNS + 2;
    let mut chain = Chain {
        samples: SAMPLES,
        sample_time: 0.1,
        order: ORDER,
        columns: COLUMNS,
        inputs: 1,
        switches: 1,
        states: if case.two_sensors { vec![(0, 0), (1, 0)] } else { vec![(0, 0), (0, 1)] },
        scale: vec![0.05; outputs.len()],
        breaks: vec![false; transitions],
        transition: Vec::new(),
        forcing: (0..transitions * ORDER * width).map(|_| 0.1 * normal()).collect(),
        defect: (0..transitions * ORDER).map(|_| 0.01 * normal()).collect(),
        errors: (0..SAMPLES * outputs.len()).map(|_| 0.2 * normal()).collect(),
        reading_columns: Vec::new(),
        loose: vec![0.0; transitions],
        disturbed: (0..SAMPLES).map(|_| if case.input > 0.0 { 0.3 * case.input * normal() } else { 0.0 }).collect(),
        turns: (0..transitions).map(|k| k % 3 == 1).collect(),
        nothing: vec![0.0; COLUMNS],
        outputs,
    };
    for k in 0..transitions {
        let k = k as f64;
        chain.transition.extend([0.99, 0.1, -0.4 - 0.01 * k, 0.95 + 0.002 * k]);
    }
    if case.broken {
        chain.breaks[8] = true;
    }
    if case.loose {
        chain.loose[3..6].fill(1.7);
    }
    if case.reading {
        chain.reading_columns = vec![0.0; SAMPLES * chain.outputs.len() * COLUMNS];
        chain.reading_columns.iter_mut().skip(1).step_by(COLUMNS).for_each(|value| *value = normal());
    }
    chain
}

fn noise(case: Case) -> Noise {
    let outputs = if case.two_sensors { 2 } else { 1 };
    // Under white noise every reading has a size of its own.
    let size = |i: usize| if case.colour > 0.0 { 0.05 } else { 0.04 + 0.002 * (i % 7) as f64 };
    let mut readings: Vec<f64> = (0..SAMPLES * outputs).map(size).collect();
    if case.missing {
        readings[5 * outputs] = f64::INFINITY;
        readings[13 * outputs] = f64::INFINITY;
    }
    Noise { readings, colour: vec![case.colour; outputs], inputs: vec![case.input], only_at_turns: case.only_at_turns }
}

/// The solution with all unknowns at once.
struct Dense {
    step: Vec<f64>,
    covariance: DMatrix<f64>,
    states: Vec<f64>,
    inputs: Vec<f64>,
    squares: f64,
    /// Twice the negative logarithm of the likelihood of the readings, free of the starting states, at the best columns.
    likelihood: f64,
}

/// Unknowns: starting states of both segments, disturbances in units of their size, columns.
fn dense(chain: &Chain, noise: &Noise) -> Dense {
    let outputs = chain.outputs.len();
    let disturbances: Vec<(usize, usize, f64)> = (0..SAMPLES - 1)
        .filter(|&k| !chain.breaks[k])
        .flat_map(|k| {
            let free = noise.inputs[0] > 0.0 && (!noise.only_at_turns || chain.turns[k]);
            let input = free.then_some((k, COLUMNS, noise.inputs[0]));
            let switch = (chain.loose[k] > 0.0).then_some((k, COLUMNS + 1, chain.loose[k]));
            input.into_iter().chain(switch)
        })
        .collect();
    let segments = 1 + chain.breaks.iter().filter(|broken| **broken).count();
    let starts = segments * ORDER;
    let first_column = starts + disturbances.len();
    let unknowns = first_column + COLUMNS;
    // States as affine functions of the unknowns.
    let mut states: Vec<(DMatrix<f64>, DVector<f64>)> = Vec::new();
    let mut segment_of = Vec::new();
    let mut segment = 0;
    for k in 0..SAMPLES {
        if k == 0 || chain.breaks[k - 1] {
            segment += usize::from(k > 0);
            let mut begin = DMatrix::zeros(ORDER, unknowns);
            (0..ORDER).for_each(|s| begin[(s, segment * ORDER + s)] = 1.0);
            states.push((begin, DVector::zeros(ORDER)));
        } else {
            let transition = DMatrix::from_fn(ORDER, ORDER, |r, c| chain.transition(k - 1, r)[c]);
            let (by, fixed) = &states[k - 1];
            let (mut by, mut fixed) = (&transition * by, &transition * fixed);
            for s in 0..ORDER {
                fixed[s] += chain.defect(k - 1)[s];
                let forcing = chain.forcing(k - 1, s);
                (0..COLUMNS).for_each(|j| by[(s, first_column + j)] += forcing[j]);
                for (w, &(at, column, size)) in disturbances.iter().enumerate() {
                    if at == k - 1 {
                        by[(s, starts + w)] += forcing[column] * size;
                    }
                }
            }
            states.push((by, fixed));
        }
        segment_of.push(segment);
    }
    // Readings, and the covariance of their noise.
    let places: Vec<(usize, usize)> = (0..SAMPLES)
        .flat_map(|k| (0..outputs).map(move |c| (k, c)))
        .filter(|&(k, c)| noise.readings[k * outputs + c].is_finite())
        .collect();
    let covariance = DMatrix::from_fn(places.len(), places.len(), |i, j| {
        let ((k, c), (l, d)) = (places[i], places[j]);
        if c != d || segment_of[k] != segment_of[l] {
            return 0.0;
        }
        let own = if k == l { noise.readings[k * outputs + c].powi(2) } else { 0.0 };
        match noise.colour[c] {
            colour if colour > 0.0 => noise.typical(c, outputs).powi(2) * colour.powi(k.abs_diff(l) as i32),
            _ => own,
        }
    });
    let mut jacobian = DMatrix::zeros(places.len(), unknowns);
    let mut right = DVector::zeros(places.len());
    for (i, &(k, c)) in places.iter().enumerate() {
        let (by, fixed) = &states[k];
        jacobian.set_row(i, &by.row(chain.outputs[c]));
        right[i] = chain.error(k, c) - fixed[chain.outputs[c]];
        (0..COLUMNS).for_each(|j| jacobian[(i, first_column + j)] += chain.readings(k, c)[j]);
    }
    let root = covariance.clone().cholesky().expect("positive").l();
    let rows = places.len() + disturbances.len();
    let mut whole = DMatrix::zeros(rows, unknowns);
    let mut target = DVector::zeros(rows);
    let white = root.solve_lower_triangular(&jacobian).expect("regular");
    whole.view_mut((0, 0), (places.len(), unknowns)).copy_from(&white);
    target.rows_mut(0, places.len()).copy_from(&root.solve_lower_triangular(&right).expect("regular"));
    let mut expected = DVector::zeros(disturbances.len());
    for (w, &(k, column, size)) in disturbances.iter().enumerate() {
        whole[(places.len() + w, starts + w)] = 1.0;
        expected[w] = -chain.disturbance(k, column) / size;
        target[places.len() + w] = expected[w];
    }
    let information = whole.tr_mul(&whole).cholesky().expect("all unknowns show");
    let solved = information.solve(&whole.tr_mul(&target));
    let inverse = information.inverse();
    let mut inputs = vec![0.0; SAMPLES];
    for (w, &(k, column, size)) in disturbances.iter().enumerate() {
        if column == COLUMNS {
            inputs[k] = solved[starts + w] * size;
        }
    }
    let marginal = {
        let spread = jacobian.columns(starts, disturbances.len());
        let all = &covariance + spread * spread.transpose();
        let root = all.cholesky().expect("positive").l();
        let begin = root.solve_lower_triangular(&jacobian.columns(0, starts).into_owned()).expect("regular");
        let gram = begin.tr_mul(&begin).cholesky().expect("states show").l();
        let mean = &right - spread * &expected;
        let beside = DMatrix::from_fn(places.len(), starts + COLUMNS, |r, c| {
            jacobian[(r, if c < starts { c } else { first_column + c - starts })]
        });
        let beside = root.solve_lower_triangular(&beside).expect("regular");
        let mean = root.solve_lower_triangular(&mean).expect("regular");
        let best = beside.tr_mul(&beside).cholesky().expect("regular").solve(&beside.tr_mul(&mean));
        let logarithm = |m: &DMatrix<f64>| 2.0 * m.diagonal().iter().map(|d| d.ln()).sum::<f64>();
        (&mean - &beside * best).norm_squared() + logarithm(&root) + logarithm(&gram)
    };
    Dense {
        step: solved.rows(first_column, COLUMNS).iter().copied().collect(),
        covariance: inverse.view((first_column, first_column), (COLUMNS, COLUMNS)).into_owned(),
        states: states
            .iter()
            .flat_map(|(by, fixed)| (by * &solved + fixed).iter().copied().collect::<Vec<_>>())
            .collect(),
        inputs,
        squares: (&target - &whole * &solved).norm_squared(),
        likelihood: marginal,
    }
}

fn likelihood(smoothed: &Smoothed) -> f64 {
    smoothed.root.last().map_or(f64::NAN, |z| z * z) + smoothed.determinant
}

fn near(found: f64, expected: f64, size: f64) {
    assert!((found - expected).abs() <= BOUND * size, "{found} {expected} ({size})");
}

fn largest(values: &[f64]) -> f64 {
    values.iter().map(|value| value.abs()).fold(0.0, f64::max)
}

fn cases() -> Vec<Case> {
    let plain = Case::default();
    vec![
        plain,
        Case { two_sensors: true, ..plain },
        Case { input: 0.5, ..plain },
        Case { input: 0.5, only_at_turns: true, ..plain },
        Case { missing: true, reading: true, ..plain },
        Case { broken: true, input: 0.5, ..plain },
        Case { loose: true, input: 0.5, missing: true, ..plain },
        Case { colour: 0.8, ..plain },
        Case { colour: 0.8, two_sensors: true, input: 0.5, reading: true, ..plain },
        Case { colour: 0.8, broken: true, missing: true, input: 0.5, loose: true, ..plain },
    ]
}

#[test]
fn one_pass_is_the_whole_least_squares() {
    for case in cases() {
        let (chain, noise) = (chain(case), noise(case));
        let expected = dense(&chain, &noise);
        let smoothed = Smoothed::new(&chain, &noise, COLUMNS, true);
        let found = Solution::of_columns(&smoothed, COLUMNS, &[]).expect("both columns show");
        let size = largest(&expected.step);
        found.step.iter().zip(&expected.step).for_each(|(f, e)| near(*f, *e, size));
        let size = expected.covariance.amax();
        found.covariance.iter().zip(expected.covariance.iter()).for_each(|(f, e)| near(*f, *e, size));
        near(smoothed.root.last().expect("rows").powi(2), expected.squares, expected.squares);
        if case.colour > 0.0 {
            continue;
        }
        let (states, inputs) = smoothed.corrections(&chain, &noise, &found.step).expect("finite");
        let size = largest(&expected.states);
        states.iter().zip(&expected.states).for_each(|(f, e)| near(*f, *e, size));
        let size = largest(&expected.inputs);
        inputs.iter().zip(&expected.inputs).for_each(|(f, e)| near(*f, *e, size));
    }
}

#[test]
fn states_under_coloured_noise_are_those_of_the_whole_least_squares() {
    for case in cases().into_iter().filter(|case| case.colour > 0.0) {
        let (chain, noise) = (chain(case), noise(case));
        let expected = dense(&chain, &noise);
        let smoothed = Smoothed::new(&chain, &noise, COLUMNS, true);
        let (states, inputs) = smoothed.corrections(&chain, &noise, &expected.step).expect("finite");
        // Readings have white noise of a ten thousandth of the coloured one.
        let size = largest(&expected.states);
        states.iter().zip(&expected.states).for_each(|(f, e)| near(*f, *e, 10.0 * size));
        let size = largest(&expected.inputs);
        inputs.iter().zip(&expected.inputs).for_each(|(f, e)| near(*f, *e, 10.0 * size));
    }
}

#[test]
fn innovations_are_uncorrelated_rows_of_the_same_sum_of_squares() {
    for case in cases() {
        let (chain, noise) = (chain(case), noise(case));
        let smoothed = Smoothed::new(&chain, &noise, COLUMNS, false);
        let found = Solution::of_columns(&smoothed, COLUMNS, &[]).expect("both columns show");
        let left = smoothed.remaining(&found.step);
        let squares: f64 = left.iter().map(|e| e * e).sum();
        let expected = smoothed.root.last().expect("rows").powi(2);
        // Innovations of readings; what the disturbances were taken to be already is part of the whole sum.
        assert_eq!(left.len(), smoothed.places.len());
        near(squares, expected, expected);
    }
}

#[test]
fn parameters_beside_a_column_of_known_value_are_those_of_both_together() {
    for case in cases() {
        let (chain, noise) = (chain(case), noise(case));
        let smoothed = Smoothed::new(&chain, &noise, COLUMNS, false);
        let both = Solution::of_columns(&smoothed, 2, &[]).expect("both columns show");
        let first = Solution::of_columns(&smoothed, 1, &[]).expect("the first column shows");
        let beside = first.step_beside(&smoothed, &[(0, both.step[1])]);
        near(beside[0], both.step[0], largest(&both.step));
        // Fewer columns of the same record are the first ones.
        let narrow = Smoothed::new(&chain, &noise, 1, false);
        let alone = Solution::of_columns(&narrow, 1, &[]).expect("the first column shows");
        near(alone.step[0], first.step[0], largest(&both.step));
        // A direction that nothing moves along holds the first column.
        let held = Solution::of_columns(&smoothed, 1, &[vec![1.0]]).expect("one column");
        assert!(held.step_beside(&smoothed, &[(0, both.step[1])])[0].abs() < 1e-2 * largest(&both.step).max(1.0));
    }
}

#[test]
fn the_determinant_makes_the_likelihood_that_of_the_readings() {
    for case in cases() {
        let chain = chain(case);
        let first = noise(case);
        let sizes = if case.input > 0.0 { vec![0.05, 2.0] } else { vec![0.0] };
        for input in sizes {
            for factor in [1.0, 0.5] {
                let mut second = first.clone();
                second.inputs = vec![input];
                second.readings.iter_mut().for_each(|sigma| *sigma *= factor);
                second.colour.iter_mut().for_each(|colour| *colour *= factor);
                let [a, b] = [&first, &second]
                    .map(|noise| (likelihood(&Smoothed::new(&chain, noise, COLUMNS, false)), dense(&chain, noise)));
                near(a.0 - b.0, a.1.likelihood - b.1.likelihood, a.1.likelihood.abs() + b.1.likelihood.abs());
            }
        }
    }
}

#[test]
fn noise_of_inputs_and_of_sensors_may_be_compared_with_none() {
    // The noise of a record is found by the likelihood of kinds of noise with other numbers of unknowns.
    let case = Case::default();
    let mut chain = chain(case);
    chain.disturbed.fill(0.0);
    let white = noise(case);
    let expected = dense(&chain, &white).likelihood;
    let found = likelihood(&Smoothed::new(&chain, &white, COLUMNS, false));
    for (input, colour) in [(0.5, 0.0), (0.0, 0.8), (0.5, 0.8)] {
        let readings = vec![0.05; SAMPLES];
        let other = Noise { inputs: vec![input], colour: vec![colour], readings, only_at_turns: false };
        let difference = likelihood(&Smoothed::new(&chain, &other, COLUMNS, false)) - found;
        let truth = dense(&chain, &other).likelihood - expected;
        near(difference, truth, 10.0 * (1.0 + truth.abs()));
    }
}
