use super::{
    CampaignEnd, CampaignOrder, CampaignPhase, CampaignRules, Phasor, Real, RunEstimate, RunFault, RunLines, RunModel,
    RunPool, RunSampling, RunWorkspace, passing,
};

/// m x'' + k x^3 + d |x'| x' + b = u; the last parameter, of x'' + w^2 x with the w of this motion, is not shown.
struct Oscillator;

/// Samples of a period, periods and seconds of a sample.
const SHAPE: (u32, u32, f64) = (200, 6, 0.01);
const W: f64 = core::f64::consts::PI;
const TRUTH: [f64; 4] = [2.0, 30.0, 1.5, 0.25];

impl<T: Real> RunModel<T, 1, 1, 5, 3> for Oscillator {
    const MOTION: [(usize, u32); 3] = [(0, 0), (0, 1), (0, 2)];
    const POINTS: usize = 512;

    fn rows(&self, motion: &[T; 3], regressor: &mut [[T; 5]; 1], _: &mut [T; 1], map: &mut [[T; 1]; 1]) {
        let [x, rate, acceleration] = *motion;
        let w = T::from_f64(W);
        regressor[0] = [acceleration, x * x * x, rate.abs() * rate, T::ONE, acceleration + w * w * x];
        map[0][0] = T::ONE;
    }
}

/// A run with x = 0.3 cos(w t) and the force that belongs to it so many seconds later.
fn run<T: Real>(later: f64) -> RunLines<T, 2, 26> {
    let (samples, periods, step) = SHAPE;
    let mut lines = RunLines::new(samples, periods).expect("a shape");
    for number in 0..samples * periods {
        let at = |time: f64| (0.3 * libm::cos(W * time), -0.3 * W * libm::sin(W * time));
        let time = f64::from(number) * step;
        let (x, rate) = at(time + later);
        let force = -TRUTH[0] * W * W * x + TRUTH[1] * x * x * x + TRUTH[2] * rate * rate.abs() + TRUTH[3];
        lines.push(number, &[T::from_f64(at(time).0), T::from_f64(force)]).expect("finite");
    }
    lines
}

fn estimate<T: Real>(lines: &RunLines<T, 2, 26>, delay: f64) -> Result<RunEstimate<T, 1, 5>, RunFault> {
    let sampling = RunSampling { sample_time: T::from_f64(SHAPE.2), held: false, delay: T::from_f64(delay) };
    let prior = [1.0, 10.0, 0.0, 0.0, 0.0].map(T::from_f64);
    RunWorkspace::<T, 1, 1, 5, 3, 26, 25, 325>::default().estimate::<_, 1, 2>(&Oscillator, lines, sampling, &prior)
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
    assert_eq!(RunLines::<f64, 2, 26>::new(200, 5).err(), Some(RunFault::Periods));
    assert_eq!(RunLines::<f64, 2, 26>::new(26, 4).err(), Some(RunFault::Samples));
    assert_eq!(RunLines::<f64, 2, 26>::new(u32::MAX, 4).err(), Some(RunFault::Samples));
    let mut lines = begun();
    assert_eq!(estimate(&lines, 0.0).err(), Some(RunFault::Unfinished { samples: 0 }));
    assert_eq!(lines.push(1, &[0.0, 0.0]), Err(RunFault::Missed { sample: 0 }));
    assert_eq!(lines.push(0, &[0.0, 0.0]), Err(RunFault::Missed { sample: 0 }), "a fault stays");
    let mut lines = begun();
    assert_eq!(lines.push(0, &[f64::NAN, 0.0]), Err(RunFault::NotFinite { sample: 0 }));
    let mut still = begun();
    (0..still.samples()).for_each(|number| still.push(number, &[0.0, 0.0]).expect("finite"));
    assert!(estimate(&still, 0.0).is_err() || estimate(&still, 0.0).is_ok_and(|found| found.rank < 5));
    assert!(still.push(0, &[0.0, 0.0]).is_err() && still.lines().is_err(), "a sample that came twice");
}

#[test]
fn lines_are_those_of_the_signal_and_nothing_stands_halfway() {
    let lines = run::<f64>(0.0).lines().expect("whole");
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
        let lines = run.lines().expect("whole");
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
    let first = pool.take(&found.equations, &found.about, 1.0);
    let second = pool.take(&found.equations, &found.about, 1.0);
    let (once, deviation, twice, smaller) = (first.values, first.deviations, second.values, second.deviations);
    for i in 0..4 {
        let (once, twice) = (once[i].expect("shown"), twice[i].expect("shown"));
        assert!((once - twice).abs() < 1e-9 * once.abs(), "{once} {twice}");
        let ratio = smaller[i].expect("shown") / deviation[i].expect("shown");
        assert!((ratio - 0.5_f64.sqrt()).abs() < 1e-6, "{ratio}");
    }
    assert_eq!(twice[4], None);
}

#[test]
fn a_passage_is_smooth_at_both_ends() {
    // Position and four derivatives of one coordinate, between rest at 1 and a motion of constant speed.
    let (before, now) = ([1.0, 0.0, 0.0, 0.0, 0.0], [3.0, 0.5, 0.0, 0.0, 0.0]);
    let near = |found: [f64; 5], wanted: [f64; 5]| {
        assert!(found.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-9), "{found:?}");
    };
    near(passing(&before, &now, 1, 0.0, 2.0), before);
    near(passing(&before, &now, 1, core::f64::consts::PI, 2.0), now);
    near(passing(&before, &now, 1, core::f64::consts::PI - 1e-12, 2.0), now);
    // The derivatives are those of the position.
    let motion = |time: f64| passing(&before, &[3.0 + 0.5 * time, 0.5, 0.0, 0.0, 0.0], 1, 2.0 * time, 2.0);
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
        let (now, _, _) = order.plays();
        if order.phase() == CampaignPhase::Measuring {
            measured += 1;
            if measured == 4 * now.samples_per_period {
                order.run_is_whole();
                order.updated(|stage| [50, 40][stage]);
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
