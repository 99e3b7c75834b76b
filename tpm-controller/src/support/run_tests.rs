use super::{
    CampaignEnd, CampaignOrder, CampaignPhase, CampaignRules, Phasor, Real, RunEstimate, RunFault, RunLinearisation,
    RunLines, RunLumping, RunModel, RunNumerical, RunPassed, RunPhysical, RunPool, RunReference, RunSampling,
    RunWorkspace, SquareRoot, passing,
};

/// m x'' + k x^3 + d |x'| x' + b = u; the last parameter, of x'' + w^2 x with the w of this motion, is not shown.
struct Oscillator;

/// Samples of a period, periods and seconds of a sample.
const SHAPE: (u32, u32, f64) = (200, 6, 0.01);
const W: f64 = core::f64::consts::PI;
const TRUTH: [f64; 4] = [2.0, 30.0, 1.5, 0.25];

impl<T: Real> RunModel<T, 1, 1, 5, 3> for Oscillator {
    const COORDINATES: [usize; 3] = [0; 3];
    const ORDERS: [u32; 3] = [0, 1, 2];
    const POINTS: usize = 512;

    fn rows(&self, motion: &[T; 3], regressor: &mut [[T; 5]; 1], _: &mut [T; 1], map: &mut [[T; 1]; 1]) {
        let [x, rate, acceleration] = *motion;
        let w = T::from_f64(W);
        regressor[0] = [acceleration, x * x * x, rate.abs() * rate, T::ONE, acceleration + w * w * x];
        map[0][0] = T::ONE;
    }
}

/// All lines of a whole run.
fn lines_of<const C: usize, const L: usize>(run: &RunLines<f64, C, L>) -> [[Phasor<f64>; L]; C] {
    run.finished().expect("whole");
    core::array::from_fn(|channel| core::array::from_fn(|line| run.line(channel, line)))
}

/// The lines of a run with one coordinate and one input, and what the input holds above them.
type Played<T> = (RunLines<T, 2, 26>, RunPassed<T, 1>);

/// A run with x = 0.3 cos(w t) and the force that belongs to it so many seconds later.
fn run<T: Real>(later: f64) -> Played<T> {
    let (samples, periods, step) = SHAPE;
    let mut lines = RunLines::new(samples, periods).expect("a shape");
    let mut passed = RunPassed::new(samples, 26);
    for number in 0..samples * periods {
        let at = |time: f64| (0.3 * libm::cos(W * time), -0.3 * W * libm::sin(W * time));
        let time = f64::from(number) * step;
        let (x, rate) = at(time + later);
        let force = -TRUTH[0] * W * W * x + TRUTH[1] * x * x * x + TRUTH[2] * rate * rate.abs() + TRUTH[3];
        lines.push(number, &[T::from_f64(at(time).0), T::from_f64(force)]).expect("finite");
        passed.push(&[T::from_f64(force)]);
    }
    (lines, passed)
}

fn estimate<T: Real>((lines, passed): &Played<T>, delay: f64) -> Result<RunEstimate<T, 1, 5>, RunFault> {
    let sampling = RunSampling { sample_time: T::from_f64(SHAPE.2), held: false, delay: T::from_f64(delay) };
    let prior = [1.0, 10.0, 0.0, 0.0, 0.0].map(T::from_f64);
    RunWorkspace::<T, 1, 1, 1, 5, 3, 26, 25, 325>::default().estimate(
        &Oscillator,
        (lines, passed),
        sampling,
        &prior,
        None,
    )
}

#[test]
fn a_run_without_noise_shows_what_it_can_and_nothing_else() {
    for delay in [0.0, 0.007] {
        let found = estimate(&run::<f64>(delay), delay).expect("a run");
        assert_eq!(found.rank, 4, "{found:?}");
        for (value, truth) in found.values.into_iter().zip(TRUTH) {
            // The harmonics of |x'| x' beyond those that are kept come in through the grid.
            assert!((value.expect("shown") - truth).abs() < 1e-3 * truth, "{found:?}");
        }
        assert_eq!((found.values[4], found.deviations[4]), (None, None));
    }
    let single = estimate(&run::<f32>(0.0), 0.0).expect("a run");
    assert!(single.values[0].is_some_and(|mass| (mass.to_f64() - 2.0).abs() < 1e-3), "{single:?}");
}

#[test]
fn a_sample_that_cannot_be_used_ends_the_run() {
    let begun = || RunLines::<f64, 2, 26>::new(SHAPE.0, SHAPE.1).expect("a shape");
    let estimate = |lines: &RunLines<f64, 2, 26>| estimate(&(*lines, RunPassed::new(SHAPE.0, 26)), 0.0);
    assert_eq!(RunLines::<f64, 2, 26>::new(200, 5).err(), Some(RunFault::Periods));
    assert_eq!(RunLines::<f64, 2, 26>::new(26, 4).err(), Some(RunFault::Samples));
    assert_eq!(RunLines::<f64, 2, 26>::new(u32::MAX, 4).err(), Some(RunFault::Samples));
    let mut lines = begun();
    assert_eq!(estimate(&lines).err(), Some(RunFault::Unfinished { samples: 0 }));
    assert_eq!(lines.push(1, &[0.0, 0.0]), Err(RunFault::Missed { sample: 0 }));
    assert_eq!(lines.push(0, &[0.0, 0.0]), Err(RunFault::Missed { sample: 0 }), "a fault stays");
    let mut lines = begun();
    assert_eq!(lines.push(0, &[f64::NAN, 0.0]), Err(RunFault::NotFinite { sample: 0 }));
    let mut still = begun();
    (0..still.samples()).for_each(|number| still.push(number, &[0.0, 0.0]).expect("finite"));
    assert!(estimate(&still).is_err() || estimate(&still).is_ok_and(|found| found.rank < 5));
    assert!(still.push(0, &[0.0, 0.0]).is_err() && still.finished().is_err(), "a sample that came twice");
}

/// m x'' + k x + c x^3 = u: smooth, so that nothing but the order of a linearisation is left.
struct Spring;

const SPRING: [f64; 3] = [2.0, 30.0, 50.0];

impl RunModel<f64, 1, 1, 3, 2> for Spring {
    const COORDINATES: [usize; 2] = [0; 2];
    const ORDERS: [u32; 2] = [0, 2];
    const POINTS: usize = 128;

    fn rows(&self, motion: &[f64; 2], regressor: &mut [[f64; 3]; 1], _: &mut [f64; 1], map: &mut [[f64; 1]; 1]) {
        let [x, acceleration] = *motion;
        regressor[0] = [acceleration, x, x * x * x];
        map[0][0] = 1.0;
    }
}

/// The largest relative error of an update by a run whose tracking error is so large, from these parameters of the feed-forward.
fn update_about(which: Option<RunLinearisation>, size: f64, prior: &[f64; 3]) -> f64 {
    let (samples, periods, step) = SHAPE;
    let mut lines = RunLines::<f64, 2, 26>::new(samples, periods).expect("a shape");
    let mut passed = RunPassed::new(samples, 26);
    let mut reference = RunReference::<f64, 1, 26>::new(samples).expect("a shape");
    let at = |terms: &[(f64, f64, f64)], time: f64, order: i32| {
        let term = |&(cosine, sine, harmonic): &(f64, f64, f64)| {
            let (turn, rate) = (harmonic * W * time, (harmonic * W).powi(order));
            rate * if order == 0 {
                cosine * libm::cos(turn) + sine * libm::sin(turn)
            } else {
                -cosine * libm::cos(turn) - sine * libm::sin(turn)
            }
        };
        terms.iter().map(term).sum::<f64>()
    };
    let pattern = [(0.3, 0.0, 1.0), (-0.05, 0.0, 3.0)];
    let error =
        [(size, -0.5 * size, 1.0), (0.3 * size, 0.2 * size, 3.0), (0.1 * size, 0.0, 2.0), (0.05 * size, 0.0, 0.0)];
    for number in 0..samples * periods {
        let time = f64::from(number) * step;
        let [x, acceleration] = [0, 2].map(|order| at(&pattern, time, order) + at(&error, time, order));
        let force = SPRING[0] * acceleration + SPRING[1] * x + SPRING[2] * x * x * x;
        reference.push(number, &[at(&pattern, time, 0)]).expect("finite");
        lines.push(number, &[x, force]).expect("finite");
        passed.push(&[force]);
    }
    let sampling = RunSampling { sample_time: step, held: false, delay: 0.0 };
    let about = which.map(|which| (which, &reference));
    let mut workspace = RunWorkspace::<f64, 1, 1, 1, 3, 2, 26, 25, 325>::default();
    let found = workspace.estimate(&Spring, (&lines, &passed), sampling, prior, about).expect("a run");
    let apart = found.values.iter().zip(SPRING).map(|(value, truth)| (value.expect("shown") - truth).abs() / truth);
    apart.fold(0.0, f64::max)
}

#[test]
fn what_a_linearisation_leaves_out_is_of_its_order() {
    // Along the measured motion nothing is left out.
    assert!(update_about(None, 0.05, &[1.0, 20.0, 20.0]) < 1e-9);
    // With the true derivatives `hill` leaves out the square of the tracking error, `error` what couples harmonics too.
    let [large, small] = [2e-3, 1e-3].map(|size| update_about(Some(RunLinearisation::Hill), size, &SPRING));
    assert!((3.0..5.0).contains(&(large / small)) && small < 1e-3, "{large} {small}");
    let [large, small] = [2e-3, 1e-3].map(|size| update_about(Some(RunLinearisation::Error), size, &SPRING));
    assert!((1.6..2.6).contains(&(large / small)) && small > 1e-4, "{large} {small}");
    // Where the error vanishes, the derivatives do not count, whatever the parameters are.
    for which in [RunLinearisation::Error, RunLinearisation::Hill] {
        assert!(update_about(Some(which), 0.0, &[1.0, 20.0, 20.0]) < 1e-9);
    }
}

#[test]
fn a_reference_that_cannot_be_used_gives_no_parameter() {
    type Reference = RunReference<f64, 1, 26>;
    assert_eq!(Reference::new(26).err(), Some(RunFault::Samples));
    let mut reference = Reference::new(200).expect("a shape");
    assert_eq!(reference.fits(200).err(), Some(RunFault::Unfinished { samples: 0 }));
    assert_eq!(reference.push(1, &[0.0]), Err(RunFault::Missed { sample: 0 }));
    assert_eq!(reference.push(0, &[0.0]), Err(RunFault::Missed { sample: 0 }), "a fault stays");
    let mut reference = Reference::new(200).expect("a shape");
    assert_eq!(reference.push(0, &[f64::INFINITY]), Err(RunFault::NotFinite { sample: 0 }));
    let mut reference = Reference::new(200).expect("a shape");
    for number in 0..200 {
        assert_eq!(reference.push(number, &[0.0]), Ok(()));
        assert_eq!(reference.is_whole(), number == 199);
    }
    assert_eq!(reference.push(7, &[f64::NAN]), Ok(()), "what is behind the period is not used");
    assert_eq!(reference.fits(100).err(), Some(RunFault::Samples));
}

/// a = p q, b = q, c = p + q from p and q; r is in none of them.
struct Products;

impl<T: Real> RunLumping<T, 3, 3> for Products {
    fn lump(&self, physical: &[T; 3], parameters: &mut [T; 3], slopes: &mut [[T; 3]; 3]) {
        let [p, q, _] = *physical;
        *parameters = [p * q, q, p + q];
        *slopes = [[q, p, T::ZERO], [T::ZERO, T::ONE, T::ZERO], [T::ONE, T::ONE, T::ZERO]];
    }
}

#[test]
fn physical_parameters_follow_with_deviations_by_gauss_newton() {
    // Equations for the step from about: p q = 6, q = 2 and p + q = 5, of the deviations 0.1, 0.2 and 0.05.
    let about = [5.0, 2.5, 4.0];
    let deviations = [0.1, 0.2, 0.05];
    let truth = [6.0, 2.0, 5.0];
    let mut run = SquareRoot::<f64, 3>::default();
    for (i, deviation) in deviations.iter().enumerate() {
        let mut row = [0.0; 3];
        row[i] = 1.0 / deviation;
        run.push(row, (truth[i] - about[i]) / deviation).expect("finite");
    }
    let found = RunPhysical::of(&Products, &run, &about, &[10.0, 4.0, 7.0]).expect("near enough");
    let [p, q] = [0, 1].map(|i| found.values[i].expect("shown"));
    assert!((p - 3.0).abs() < 1e-9 && (q - 2.0).abs() < 1e-9, "{found:?}");
    assert_eq!((found.rank, found.values[2], found.deviations[2]), (2, None, None));
    // The covariance is the inverse of J' W J at the solution.
    let weights = deviations.map(|deviation: f64| deviation.powi(-2));
    let slopes = [[2.0, 3.0], [0.0, 1.0], [1.0, 1.0]];
    let entry = |i: usize, j: usize| (0..3).map(|k| weights[k] * slopes[k][i] * slopes[k][j]).sum::<f64>();
    let (a, b, c) = (entry(0, 0), entry(0, 1), entry(1, 1));
    let size = a * c - b * b;
    for (found, wanted) in [(found.covariance[0][0], c / size), (found.covariance[0][1], -b / size)] {
        assert!((found / wanted - 1.0).abs() < 1e-9, "{found} {wanted}");
    }
    // Equations that contradict each other still have a nearest p, and say so; nothing shows p where there is no row.
    let mut odd = run;
    odd.push([0.0, 1e3, 0.0], 1e3 * (4.0 - about[1])).expect("finite");
    let chi_squared = RunPhysical::of(&Products, &odd, &about, &[3.0, 2.0, 0.0]).expect("a nearest one").chi_squared;
    assert!(chi_squared > 1.0, "{chi_squared}");
    let none = RunPhysical::of(&Products, &SquareRoot::<f64, 3>::default(), &about, &[1.0; 3]);
    assert_eq!(none.err(), Some(RunFault::Still));
    assert_eq!(RunPhysical::of(&Products, &run, &about, &[f64::NAN; 3]).err(), Some(RunFault::Equations));
}

/// A run whose tracking error is linear in the parameters of the feed-forward, less those of the machine, with its reference.
fn tracked(parameters: [f64; 2], noise: f64) -> (RunLines<f64, 1, 26>, RunReference<f64, 1, 26>) {
    bent(parameters, parameters, noise)
}

/// The same where the error bends away from those parameters by a parabola: as much as it changes when the first is larger by half.
fn bent(parameters: [f64; 2], about: [f64; 2], noise: f64) -> (RunLines<f64, 1, 26>, RunReference<f64, 1, 26>) {
    let (samples, periods, step) = SHAPE;
    let apart = [parameters[0] - 2.0, parameters[1] - 30.0];
    let mut lines = RunLines::new(samples, periods).expect("a shape");
    let mut reference = RunReference::new(samples).expect("a shape");
    let mut state = (parameters[0] * 1e6) as u64 + (parameters[1] * 1e3) as u64;
    for number in 0..samples * periods {
        let turn = W * f64::from(number) * step;
        let planned = 0.3 * libm::cos(turn);
        let error = apart[0] * (2e-2 * libm::cos(turn) + 1e-2 * libm::sin(3.0 * turn))
            + apart[1] * (1e-3 * libm::sin(turn) - 2e-3 * libm::cos(5.0 * turn))
            + (parameters[0] - about[0]).powi(2) * 4e-2 * libm::cos(turn);
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let random = (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
        reference.push(number, &[planned]).expect("finite");
        lines.push(number, &[planned + error + noise * random]).expect("finite");
    }
    (lines, reference)
}

#[test]
fn differences_of_runs_give_the_parameters() {
    let found = |played: [f64; 2], noise: f64| {
        let mut numerical = RunNumerical::<f64, 1, 2, 26>::default();
        let (run, reference) = tracked(played, noise);
        assert_eq!(numerical.estimate(&played).err(), Some(RunFault::Unfinished { samples: 0 }));
        assert_eq!(numerical.change(0, 0.1, &run, &reference), Err(RunFault::Perturbation), "before the first run");
        numerical.begin(&run, &reference).expect("a run");
        assert_eq!(numerical.estimate(&played).err(), Some(RunFault::Unfinished { samples: 1200 }));
        for (parameter, step) in [(0, 0.1), (1, -2.0)] {
            let mut moved = played;
            moved[parameter] += step;
            let (run, reference) = tracked(moved, noise);
            numerical.change(parameter, step, &run, &reference).expect("a run");
        }
        assert_eq!(numerical.change(2, 0.1, &run, &reference), Err(RunFault::Perturbation));
        assert_eq!(numerical.change(0, 0.0, &run, &reference), Err(RunFault::Perturbation));
        assert_eq!(numerical.change(0, f64::NAN, &run, &reference), Err(RunFault::Perturbation));
        let other = RunLines::<f64, 1, 26>::new(200, 4).expect("a shape");
        assert!(numerical.change(0, 0.1, &other, &reference).is_err(), "a run that was not played");
        numerical.estimate(&played).expect("runs")
    };
    let exact = found([1.0, 45.0], 0.0);
    for (value, truth) in exact.values.iter().zip([2.0, 30.0]) {
        assert!((value.expect("shown") - truth).abs() < 1e-9 * truth, "{exact:?}");
    }
    // Errors are as large as stated, over runs with noise of their own: 60 numbers, whose mean square has a deviation of .18.
    let mut squares = 0.0;
    for run in 0..30 {
        let noisy = found([1.5 + 0.01 * f64::from(run), 28.0], 1e-3);
        for ((value, deviation), truth) in noisy.values.iter().zip(noisy.deviations).zip([2.0, 30.0]) {
            let error = (value.expect("shown") - truth) / deviation.expect("shown");
            squares += error * error / 60.0;
        }
    }
    assert!((0.4..1.6).contains(&squares), "{squares}");
}

/// A parabola through three runs has the slope of a response that bends, in whatever steps; the difference of two runs has not.
#[test]
fn runs_in_opposite_directions_take_out_the_bend() {
    let played = [1.0, 45.0];
    let found = |steps: &[f64]| {
        let mut numerical = RunNumerical::<f64, 1, 2, 26>::default();
        let (run, reference) = tracked(played, 0.0);
        numerical.begin(&run, &reference).expect("a run");
        for (parameter, step) in steps.iter().map(|step| (0, *step)).chain([(1, -2.0)]) {
            let mut moved = played;
            moved[parameter] += step;
            let (run, reference) = bent(moved, played, 0.0);
            numerical.change(parameter, step, &run, &reference).expect("a run");
        }
        let estimate = numerical.estimate(&played).expect("runs");
        [2.0, 30.0]
            .iter()
            .zip(estimate.values)
            .map(|(truth, value)| (value.expect("shown") - truth).abs())
            .fold(0.0, f64::max)
    };
    for steps in [&[0.2, -0.2][..], &[-0.2, 0.3], &[0.4, 0.2, -0.1]] {
        assert!(found(steps) < 1e-9, "{steps:?}: {}", found(steps));
    }
    for steps in [&[0.2][..], &[0.2, -0.2, 0.2]] {
        assert!(found(steps) > 0.1, "{steps:?}: {}", found(steps));
    }
}

#[test]
fn lines_are_those_of_the_signal_and_nothing_stands_halfway() {
    let lines = lines_of(&run::<f64>(0.0).0);
    let apart = |line: Phasor<f64>, re: f64| (line - Phasor::new(re, 0.0)).square().sqrt();
    for (index, line) in lines[0].iter().enumerate() {
        assert!(apart(*line, if index == 2 { 0.3 } else { 0.0 }) < 1e-12, "{index}: {line:?}");
    }
}

#[test]
fn white_noise_has_the_stated_variance_in_every_line_but_the_mean() {
    // With four periods the window is that of Hann, whose variance is 1.5 times that without a window.
    for (periods, window) in [(4, 1.5), (6, 3.5 * 6.0 / 16.0), (24, 21.5 * 24.0 / 22.0 / 22.0)] {
        let samples = 1000_u32;
        let mut run = RunLines::<f64, 1, 400>::new(samples, periods).expect("a shape");
        let behind = run.samples_behind_line();
        let without = f64::from(samples * periods) / 4.0;
        assert!((without / behind - window).abs() < 1e-12, "{periods} periods: {}", without / behind);
        let mut state = 1_u64;
        let mut square = 0.0;
        for number in 0..run.samples() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let noise = (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
            square += noise * noise / f64::from(run.samples());
            run.push(number, &[noise]).expect("finite");
        }
        let lines = lines_of(&run);
        for odd in [0, 1] {
            let own = lines[0].iter().skip(2 + odd).step_by(2);
            let variance = own.clone().map(|line| line.square()).sum::<f64>() / own.count() as f64 * behind;
            // About 200 independent lines of two parts each: 5 % of the level, three of them allowed.
            assert!((variance / square - 1.0).abs() < 0.21, "{periods} periods, {odd}: {variance} of {square}");
        }
    }
}

#[test]
fn runs_are_pooled_by_what_they_show() {
    let found = estimate(&run::<f64>(0.0), 0.0).expect("a run");
    let mut pool = RunPool::new([1.0, 10.0, 0.0, 0.0, 0.0]);
    let mut take = || {
        pool.add(&mut found.equations.clone(), &found.about, 1.0);
        pool.shown([0.0])
    };
    let (first, second) = (take(), take());
    let (once, deviation, twice, smaller) = (first.values, first.deviations, second.values, second.deviations);
    for i in 0..4 {
        let (once, twice) = (once[i].expect("shown"), twice[i].expect("shown"));
        assert!((once - twice).abs() < 1e-9 * once.abs(), "{once} {twice}");
        let ratio = smaller[i].expect("shown") / deviation[i].expect("shown");
        assert!((ratio - 0.5_f64.sqrt()).abs() < 1e-6, "{ratio}");
    }
    assert_eq!(twice[4], None);
}

/// The oscillator with its mass as a sum of a whole and a half one, which no motion tells apart.
struct Halves;

impl RunModel<f64, 1, 1, 5, 3> for Halves {
    const COORDINATES: [usize; 3] = [0; 3];
    const ORDERS: [u32; 3] = [0, 1, 2];
    const POINTS: usize = 512;

    fn rows(&self, motion: &[f64; 3], regressor: &mut [[f64; 5]; 1], _: &mut [f64; 1], map: &mut [[f64; 1]; 1]) {
        let [x, rate, acceleration] = *motion;
        regressor[0] = [acceleration, acceleration / 2.0, x * x * x, rate.abs() * rate, 1.0];
        map[0][0] = 1.0;
    }
}

/// What runs show in combinations alone is kept with its deviation, and the next feed-forward goes along it.
#[test]
fn runs_go_along_the_combinations_that_they_show() {
    let (lines, passed) = run::<f64>(0.0);
    let sampling = RunSampling { sample_time: SHAPE.2, held: false, delay: 0.0 };
    let prior = [1.0, 0.5, 10.0, 0.0, 0.0];
    let mut workspace = RunWorkspace::<f64, 1, 1, 1, 5, 3, 26, 25, 325>::default();
    let mut found = workspace.estimate(&Halves, (&lines, &passed), sampling, &prior, None).expect("a run");
    assert_eq!((found.rank, found.values[0], found.values[1]), (4, None, None), "{found:?}");
    let mut pool = RunPool::new(prior);
    pool.add(&mut found.equations, &found.about, found.chi_squared);
    for (shown, moved) in [(found, workspace.theta), (pool.shown([0.0]), pool.moved())] {
        let lead = if shown.combinations[0][0] > 0.0 { 0 } else { 1 };
        let [value, deviation] = shown.combined[lead].expect("a combination");
        let whole = value / shown.combinations[lead][0];
        assert!((whole - 2.0).abs() < 2e-3 && deviation > 0.0, "{shown:?}");
        assert!((moved[0] + moved[1] / 2.0 - 2.0).abs() < 2e-3, "{moved:?}");
        // Both move from the prior by as much force.
        assert!(((moved[0] - 1.0) - (moved[1] - 0.5) / 2.0).abs() < 1e-6, "{moved:?}");
    }
}

#[test]
fn a_passage_is_smooth_at_both_ends() {
    // Position and four derivatives of one coordinate, between rest at 1 and a motion of constant speed.
    let (before, now) = ([1.0, 0.0, 0.0, 0.0, 0.0], [3.0, 0.5, 0.0, 0.0, 0.0]);
    let near = |found: [f64; 5], wanted: [f64; 5]| {
        assert!(found.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-9), "{found:?}");
    };
    let passed = |mut now: [f64; 5], at: f64| {
        passing(&before, &mut now, 1, at, 2.0);
        now
    };
    near(passed(now, 0.0), before);
    near(passed(now, core::f64::consts::PI), now);
    near(passed(now, core::f64::consts::PI - 1e-12), now);
    // The derivatives are those of the position.
    let motion = |time: f64| passed([3.0 + 0.5 * time, 0.5, 0.0, 0.0, 0.0], 2.0 * time);
    let step = 1e-4;
    for order in 0..4 {
        let difference = (motion(0.5 + step)[order] - motion(0.5 - step)[order]) / (2.0 * step);
        // Every derivative is up to ten times as large as the one before.
        let bound = 1e-5 * [1.0, 10.0, 100.0, 1000.0][order];
        assert!((difference - motion(0.5)[order + 1]).abs() < bound, "{order}");
    }
}

/// Plays a campaign of two stages; updates come at once, limits are met where `beyond` says so by phase, run and amplitude.
fn played(beyond: impl Fn(CampaignPhase, u32, f64) -> bool) -> CampaignOrder<f64> {
    let rules = CampaignRules { settle_periods: 2, periods: 4, runs_per_stage: 2, most_runs: 12, effort: 0.9 };
    let mut order = CampaignOrder::new(rules, 2, 50);
    let mut measured = 0;
    for _ in 0..20_000 {
        let (now, _) = order.plays();
        if order.phase() == CampaignPhase::Measuring {
            measured += 1;
            if measured == 4 * now.samples_per_period {
                order.run_is_whole();
                order.updated(40);
            }
        }
        if order.advance(0.5, beyond(order.phase(), order.runs(), now.share)) {
            measured = 0;
        }
    }
    order
}

#[test]
fn a_campaign_ends_with_a_reason_at_rest() {
    let ended = |order: &CampaignOrder<f64>, end: CampaignEnd, runs: u32| {
        assert_eq!((order.phase(), order.runs()), (CampaignPhase::Ended(end), runs));
        assert_eq!((order.plays().0.share, order.passage_step()), (0.0, 0.0), "at rest");
    };
    ended(&played(|_, _, _| false), CampaignEnd::Stages, 4);
    // A limit of measured motion makes the run smaller until it is not met.
    ended(&played(|phase, _, share| phase == CampaignPhase::Measuring && share > 0.6), CampaignEnd::Stages, 8);
    ended(&played(|phase, _, _| phase == CampaignPhase::Measuring), CampaignEnd::Limit, 5);
    // On the way to the second stage.
    ended(&played(|phase, runs, _| phase == CampaignPhase::Settling && runs == 3), CampaignEnd::Limit, 3);
}

#[test]
fn the_filter_passes_the_velocity_of_a_mass() {
    let (samples, periods, lines) = (200_u32, 400_u32, 26_usize);
    let mut passed = RunPassed::<f64, 1>::new(samples, lines);
    // The first frequency in radians a sample.
    let first = 0.6 * lines as f64 / 2.0 * 2.0 * core::f64::consts::PI / f64::from(samples);
    let (mut state, mut fast, mut mean, mut count) = (1_u64, 0.0_f64, 0.0_f64, 0.0_f64);
    let mut before = 0.0_f64;
    for number in 0..samples * periods {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let noise = ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * libm::sqrt(12.0);
        // Noise of differences, as a feedback by a derivative makes it: its velocity does not walk.
        let force = noise - before;
        before = noise;
        passed.push(&[force]);
        let next = fast + force;
        if number >= samples {
            mean += (fast * fast + fast * next + next * next) / 3.0;
            count += 1.0;
        }
        fast = next;
    }
    let found = passed.mean(0, 0) / (2.0 * libm::tan(first / 2.0)).powi(2);
    // The velocity has variance one at every low frequency. The filter lacks what it has below its beginning, `pi/8 / sin(pi/8)` of it.
    let lacks = first / 8.0 / libm::sin(core::f64::consts::PI / 8.0);
    let wanted = mean / count - lacks;
    assert!((found / wanted - 1.0).abs() < 0.03, "{found} {wanted}");
}

/// m x'' + k x + d x'^2 = u.
struct Drag;

const DRAG: [f64; 3] = [2.0, 40.0, 1.5];

impl RunModel<f64, 1, 1, 3, 3> for Drag {
    const COORDINATES: [usize; 3] = [0; 3];
    const ORDERS: [u32; 3] = [0, 1, 2];
    const POINTS: usize = 128;

    fn rows(&self, motion: &[f64; 3], regressor: &mut [[f64; 3]; 1], _: &mut [f64; 1], map: &mut [[f64; 1]; 1]) {
        let [x, rate, acceleration] = *motion;
        regressor[0] = [acceleration, x, rate * rate];
        map[0][0] = 1.0;
    }
}

/// A run of that machine under a feedback of its noisy position and its filtered derivative.
fn under_feedback(seed: u64) -> Played<f64> {
    let (samples, settling, periods, step) = (1600_u32, 3_u32, 10_u32, 1e-3);
    let w = 2.0 * core::f64::consts::PI / (f64::from(samples) * step);
    let [m, k, d] = DRAG;
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    };
    let mut normal = || libm::sqrt(-2.0 * libm::log(uniform())) * libm::cos(2.0 * core::f64::consts::PI * uniform());
    let reference = |time: f64| {
        let (first, third) = (w * time, 3.0 * w * time);
        let x = 0.3 * (libm::cos(first) - libm::cos(third) / 9.0);
        let v = -0.3 * w * (libm::sin(first) - libm::sin(third) / 3.0);
        let a = -0.3 * w * w * (libm::cos(first) - libm::cos(third));
        (x, m * a + k * x + d * v * v)
    };
    let pass = 1.0 - libm::exp(-step / 2e-3);
    let (mut position, mut speed) = (reference(0.0).0, 0.0);
    let (mut rate, mut before) = (0.0, 0.0);
    let mut lines = RunLines::new(samples, periods).expect("a shape");
    let mut passed = RunPassed::new(samples, 26);
    for number in 0..samples * (settling + periods) {
        let (x, feed_forward) = reference(f64::from(number) * step);
        let measured = position + 1e-3 * normal();
        let error = measured - x;
        rate += pass * ((error - before) / step - rate);
        before = error;
        let force = feed_forward - 2000.0 * error - 120.0 * rate;
        if number >= samples * settling {
            lines.push(number - samples * settling, &[measured, force]).expect("finite");
            passed.push(&[force]);
        }
        let slope = |[x, v]: [f64; 2]| [v, (force - k * x - d * v * v) / m];
        let along = |from: [f64; 2], by: [f64; 2], h: f64| [from[0] + h * by[0], from[1] + h * by[1]];
        let now = [position, speed];
        let first = slope(now);
        let second = slope(along(now, first, 0.5 * step));
        let third = slope(along(now, second, 0.5 * step));
        let fourth = slope(along(now, third, step));
        let sum = |i: usize| step / 6.0 * (first[i] + 2.0 * second[i] + 2.0 * third[i] + fourth[i]);
        position += sum(0);
        speed += sum(1);
    }
    (lines, passed)
}

#[test]
fn a_mean_is_used_without_what_noise_makes_of_it() {
    let sampling = RunSampling { sample_time: 1e-3, held: true, delay: 0.0 };
    let (mut sum, mut squares, runs) = (0.0, 0.0, 16);
    for seed in 1..=runs {
        let (lines, passed) = under_feedback(seed);
        let mut workspace = RunWorkspace::<f64, 1, 1, 1, 3, 3, 26, 25, 325>::default();
        let of = (&lines, &passed);
        let found = workspace.estimate(&Drag, of, sampling, &[3.0, 20.0, 0.75], None).expect("a run");
        let [value, deviation] = [found.values, found.deviations].map(|of| of[2].expect("shown"));
        assert!(workspace.shifts);
        // Left in, the motion that noise makes would move the parameter by this much.
        let moved = workspace.shifted[0] / workspace.regressor[0][2][0].re;
        assert!(moved.abs() > 2.0 * deviation, "the test tells nothing: {moved} {deviation}");
        let error = (value - DRAG[2]) / deviation;
        sum += error / runs as f64;
        squares += error * error / runs as f64;
    }
    // A mean of 16 deviates by a quarter; three quarters are three deviations of it.
    assert!(sum.abs() < 0.75 && (0.4..1.8).contains(&squares), "{sum} {squares}");
}
