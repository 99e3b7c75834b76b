//! Refined results of logs, right ones and spoilt ones: what is named, and whether deviations hold the truth.

use crate::log_report::Way;
use crate::{DeclaredModel, Identification, LogRequest, RefinementReport, SessionError, Warning, from_log};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::fmt::Write as _;
use tpm_controller::harmonics::Hold;
use tpm_estimate::{Domain, Refine};
use tpm_test_support::rig::{MODEL, Recorded, Rig, SAMPLE_TIME, TRUTH};

/// Logs of every spoilt machine.
const SEEDS: u64 = 4;

fn draw(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

fn written(recorded: &Recorded) -> tempfile::NamedTempFile {
    let mut text = String::from("t_s,x,u\n");
    for (i, (x, u)) in recorded.position.iter().zip(&recorded.force).enumerate() {
        writeln!(text, "{:.6},{x:.9e},{u:.9e}", i as f64 * SAMPLE_TIME).expect("a string takes everything");
    }
    saved(&text)
}

fn saved(text: &str) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    file
}

fn try_identify(recorded: &Recorded, refine: Refine, period: Option<f64>) -> Result<Identification, SessionError> {
    let model = DeclaredModel::parse("S", MODEL).expect("a model");
    let file = written(recorded);
    let mut request = LogRequest::new(file.path()).hold(Hold::Zoh);
    request.estimation.refine = refine;
    request.reading.period = period;
    from_log(&model, request)
}

fn identify(rig: Rig, seed: u64) -> Identification {
    try_identify(&rig.play(seed), Refine::OutputError, None).expect("identifies")
}

fn refinement(result: &Identification) -> &RefinementReport {
    result.log.as_ref().and_then(|log| log.refinement.as_ref()).expect("a refined log")
}

/// Errors in units of the stated deviation.
fn scores(result: &Identification, truth: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|j| {
        let parameter = &result.parameters[j];
        (parameter.value.expect("seen") - truth[j]) / parameter.std.expect("seen")
    })
}

fn texts(result: &Identification) -> Vec<String> {
    result.warnings.iter().map(|warning| warning.to_string()).collect()
}

/// Plays a spoilt machine over several seeds: its fault must be named first, and widened deviations must hold the truth.
fn names_and_holds(rig: Rig, term: &str, truth: [f64; 3]) {
    for (seed, result) in names(rig, term) {
        let scores = scores(&result, truth);
        assert!(scores.iter().all(|z| z.abs() < 3.0), "{term}, seed {seed}: {scores:?}, {:?}", result.parameters);
    }
}

/// Plays a spoilt machine over several seeds, whose fault must be named first.
fn names(rig: Rig, term: &str) -> Vec<(u64, Identification)> {
    let results: Vec<(u64, Identification)> =
        (0..SEEDS).into_par_iter().map(|seed| (seed, identify(rig, seed))).collect();
    for (seed, result) in &results {
        let report = refinement(result);
        let first = report.missing.first().map(|missing| missing.term.as_str());
        let warnings = texts(result);
        assert!(
            first.is_some_and(|found| found.starts_with(term)),
            "{term}, seed {seed}: {:?}, {warnings:?}",
            report.missing
        );
        let named = result.warnings.iter().any(|warning| match warning {
            Warning::MissingTerm { term: missing } | Warning::Limited { term: missing } => {
                missing.term.starts_with(term)
            }
            _ => false,
        });
        assert!(named, "{term}, seed {seed}: {warnings:?}");
    }
    results
}

#[test]
fn a_cubic_spring_is_named_in_words_and_numbers() {
    let rig = Rig { force: |x, _| 60.0 * x.powi(3), ..Rig::default() };
    names_and_holds(rig, "x^3", TRUTH);
    let result = identify(rig, 9);
    let json = serde_json::to_value(&result).expect("serialises");
    let finding = json["findings"].as_array().expect("a list").iter().find(|finding| finding["kind"] == "missing_term");
    let finding = finding.expect("named");
    assert_eq!((finding["term"].as_str(), finding["row"].as_str()), (Some("x^3"), Some("u")));
    let (value, std) = (finding["value"].as_f64().expect("a number"), finding["std"].as_f64().expect("a number"));
    assert!((value - 60.0).abs() < (4.0 * std).min(15.0), "{finding}");
    assert!(finding["gain"].as_f64().is_some_and(|gain| gain > 0.5), "{finding}");
}

#[test]
fn a_cubic_spring_that_mass_and_spring_explain_nearly_is_named_too() {
    // A motion of two harmonics lets mass and spring take all of this force but for a thousandth.
    names_and_holds(Rig { force: |x, _| 20.0 * x.powi(3), periods: 8, ..Rig::default() }, "x^3", TRUTH);
}

#[test]
fn drag_is_named() {
    names_and_holds(Rig { force: |_, v| v * v.abs(), ..Rig::default() }, "dot(x)*abs(dot(x))", TRUTH);
}

#[test]
fn dry_friction_is_named() {
    names_and_holds(Rig { force: |_, v| 1.5 * (v / 1e-3).tanh(), steps: 20, ..Rig::default() }, "sign(dot(x))", TRUTH);
}

#[test]
fn an_offset_is_named() {
    names_and_holds(Rig { offset: 1.0, ..Rig::default() }, "1", TRUTH);
}

#[test]
fn drifting_damping_is_named() {
    let rig = Rig { drift: 0.3, ..Rig::default() };
    // The damping in the middle of the record.
    names_and_holds(rig, "d * time", [TRUTH[0], 1.15 * TRUTH[1], TRUTH[2]]);
}

#[test]
fn a_delay_by_a_sample_is_named() {
    let rig = Rig { delay: 1, ..Rig::default() };
    names(rig, "rate of u");
    let report = identify(rig, 5);
    // Command and delay are known by what they do to the motion alone, so that only the size is told.
    let delay = refinement(&report).missing[0].value.abs() / SAMPLE_TIME;
    assert!((0.3..5.0).contains(&delay), "{delay}");
}

#[test]
fn deviations_under_a_delay_by_a_sample_hold_the_truth() {
    names_and_holds(Rig { delay: 1, ..Rig::default() }, "rate of u", TRUTH);
}

/// A wheel on a held torque that steps: without its hold the torque seems to act half a sample late, which is not what is wrong.
#[test]
fn an_input_that_is_held_is_told_from_one_that_is_late() {
    let (inertia, damping, sample_time) = (1.5e-3, 3e-3, 5e-3);
    let decay = f64::exp(-damping / inertia * sample_time);
    let model =
        "model Wheel { coordinate q [rad]; input u [N*m]; parameter J [kg*m^2], d [N*m*s]; J*ddot(q) + d*dot(q) = u; }";
    let model = DeclaredModel::parse("Wheel", model).expect("a model");
    for seed in 0..SEEDS {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut angle, mut rate, mut torque, mut text) = (0.0, 0.0, 0.0, String::from("t_s,q,u\n"));
        for i in 0..3000 {
            if i % 80 == 0 {
                torque = 0.2 * draw(&mut rng);
            }
            let read = angle + 3e-4 * draw(&mut rng);
            writeln!(text, "{:.3},{read:.6},{torque:.4}", f64::from(i) * sample_time)
                .expect("a string takes everything");
            let settled = torque / damping;
            angle += settled * sample_time + (rate - settled) * (1.0 - decay) * inertia / damping;
            rate = settled + (rate - settled) * decay;
        }
        let file = saved(&text);
        let held = |hold| from_log(&model, LogRequest::new(file.path()).hold(hold)).expect("identifies");
        let other = |result: &Identification| {
            result.warnings.iter().any(|warning| {
                matches!(
                    warning,
                    Warning::OtherHold { better: Hold::Zoh, .. } | Warning::LateByHold { better: Hold::Zoh, .. }
                )
            })
        };
        let (none, zoh) = (held(Hold::None), held(Hold::Zoh));
        assert!(other(&none) && !other(&zoh), "{seed}: {:?} {:?}", texts(&none), texts(&zoh));
    }
}

/// A pendulum on an encoder whose counts are written in radians, in a periodic motion, and a cosine where the sine belongs: the harmonics name
/// powers of the angle that would take a part, the rows the sine that takes all.
#[test]
fn what_takes_most_is_named_where_nothing_explains() {
    let (inertia, damping, friction, weight) = (0.012, 0.01, 0.013, 0.45);
    let model = "model P { coordinate q [rad]; input u [N*m]; parameter J [kg*m^2], d [N*m*s], f [N*m], mgl [N*m];
        J*ddot(q) + d*dot(q) + f*sign(dot(q)) + mgl*cos(q) = u; }";
    let model = DeclaredModel::parse("P", model).expect("a model");
    for seed in 0..SEEDS / 2 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut text = String::from("t_s,q,u\n");
        for i in 0..25_000 {
            let t = 1e-3 * f64::from(i);
            let of = |amplitude: f64, harmonic: f64, phase: f64| {
                let (w, at) = (0.2 * PI * harmonic, 0.2 * PI * harmonic * t + phase);
                [amplitude * at.sin(), amplitude * w * at.cos(), -amplitude * w * w * at.sin()]
            };
            let parts = [of(0.75, 3.0, 1.2), of(0.53, 7.0, 3.1), of(0.33, 11.0, 3.3)];
            let [q, v, a] = [0, 1, 2].map(|order| parts.iter().map(|part| part[order]).sum::<f64>());
            let u = inertia * a
                + damping * v
                + friction * v.signum()
                + 9e-3 * v * v.abs()
                + weight * q.sin()
                + 4e-3 * draw(&mut rng);
            let count = 2.0 * PI / 4096.0;
            writeln!(text, "{t:.3},{:.6},{u:.6}", (q / count).round() * count).expect("a string takes everything");
        }
        let file = saved(&text);
        let result = from_log(&model, LogRequest::new(file.path())).expect("identifies");
        let named = texts(&result).into_iter().find(|text| text.contains("of which a term"));
        assert!(named.as_ref().is_some_and(|text| text.contains("sin(q)")), "{seed}: {:?}", texts(&result));
        assert!(result.shortfall.is_some(), "{seed}");
    }
}

#[test]
fn a_clipped_input_is_named_with_its_limit() {
    // The last is a hundredth of the largest command: the input is at its limit but for 50 of 8000 samples.
    for (limit, tolerance) in [(20.0, 0.01), (12.0, 0.01), (1.2, 0.1)] {
        let rig = Rig { limit, ..Rig::default() };
        names_and_holds(rig, "u beyond", TRUTH);
        for seed in 0..2 {
            let result = identify(rig, seed);
            let limited = result.warnings.iter().find_map(|warning| match warning {
                Warning::Limited { term } => Some(term.term.clone()),
                _ => None,
            });
            let found = limited.and_then(|term| term.trim_start_matches("u beyond ").parse::<f64>().ok());
            assert!(
                found.is_some_and(|found| (found / limit - 1.0).abs() < tolerance),
                "{limit}: {:?}",
                texts(&result)
            );
        }
    }
}

#[test]
fn the_limit_in_a_long_record_is_found_by_a_part_of_it() {
    names_and_holds(Rig { periods: 72, limit: 20.0, ..Rig::default() }, "u beyond", TRUTH);
}

#[test]
fn the_limit_of_a_loop_that_swings_within_seven_samples_is_named() {
    // The sampled loop has no stability of its own, and only the limit holds it: nearly all of the motion is its swinging.
    for (limit, white) in [(2600.0, 5e-4), (3000.0, 1e-4)] {
        let swinging = Rig { gains: [5e3, 1e3], smoothing: 0.4, steps: 4, ..Rig::default() };
        names_and_holds(Rig { limit, white, ..swinging }, "u beyond", TRUTH);
    }
}

/// Two carts on springs, joined by a third one; the command of the second one acts up to a limit.
const CARTS: &str =
    "model Carts { coordinate x [m], y [m]; input u [N], v [N]; parameter m1 [kg], m2 [kg], k1 [N/m], k2 [N/m];
    constant d1 = 6 [N*s/m], d2 = 2 [N*s/m], k = 30 [N/m];
    m1*ddot(x) + d1*dot(x) + k1*x + k*(x - y) = u; m2*ddot(y) + d2*dot(y) + k2*y + k*(y - x) = v; }";

#[test]
fn the_one_of_two_inputs_that_is_clipped_is_named() {
    let (truth, limit) = ([5.0, 0.5, 200.0, 40.0], 6.0);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut text = String::from("t_s,x,y,u,v\n");
    let mut state = [0.0; 4];
    let steps = 4;
    for i in 0..16_000 {
        let t = f64::from(i) * SAMPLE_TIME;
        let wave = |harmonics: [f64; 3]| harmonics.iter().map(|k| (k * 2.0 * PI * t + k).sin()).sum::<f64>();
        let (u, v) = (20.0 * wave([1.0, 2.0, 3.0]), 4.0 * wave([1.0, 3.0, 4.0]));
        if i >= 8000 {
            let mut read = |x: f64| x + 1e-5 * Distribution::<f64>::sample(&StandardNormal, &mut rng);
            let (x, y) = (read(state[0]), read(state[1]));
            writeln!(text, "{:.6},{x:.9e},{y:.9e},{u:.9e},{v:.9e}", t - 8.0).expect("a string takes everything");
        }
        let rates = |[x, y, dx, dy]: [f64; 4]| {
            let own = u - 6.0 * dx - truth[2] * x - 30.0 * (x - y);
            let other = v.clamp(-limit, limit) - 2.0 * dy - truth[3] * y - 30.0 * (y - x);
            [dx, dy, own / truth[0], other / truth[1]]
        };
        for _ in 0..steps {
            let h = SAMPLE_TIME / f64::from(steps);
            let along = |by: f64, rates: [f64; 4]| [0, 1, 2, 3].map(|j| state[j] + by * h * rates[j]);
            let first = rates(state);
            let second = rates(along(0.5, first));
            let third = rates(along(0.5, second));
            let last = rates(along(1.0, third));
            let mean = [0, 1, 2, 3].map(|j| (first[j] + 2.0 * second[j] + 2.0 * third[j] + last[j]) / 6.0);
            state = along(1.0, mean);
        }
    }
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    let model = DeclaredModel::parse("Carts", CARTS).expect("a model");
    let result = from_log(&model, LogRequest::new(file.path()).hold(Hold::Zoh)).expect("identifies");
    let named = result.warnings.iter().any(|warning| match warning {
        Warning::Limited { term } => term.term.starts_with("v beyond 6.0") || term.term.starts_with("v beyond 5.9"),
        _ => false,
    });
    assert!(named, "{:?}", texts(&result));
    for (parameter, truth) in result.parameters.iter().zip(truth) {
        let (value, std) = (parameter.value.expect("seen"), parameter.std.expect("seen"));
        assert!((value - truth).abs() < 3.0 * std && std < 1e-3 * truth, "{parameter:?}");
    }
}

#[test]
fn right_records_are_rarely_warned_about_and_covered() {
    let right = Rig::default();
    let rigs = [
        right,
        Rig { white: 1e-3, ..right },
        Rig { force_noise: 0.5, ..right },
        Rig { white: 0.0, coloured: 1e-4, ..right },
    ];
    let (seeds, mut warned, mut covered) = (20_u64, Vec::new(), 0);
    for rig in rigs {
        let results: Vec<Identification> = (100..100 + seeds).into_par_iter().map(|seed| identify(rig, seed)).collect();
        for result in &results {
            assert!(refinement(result).used, "{:?}", texts(result));
            covered += scores(result, TRUTH).iter().filter(|z| z.abs() < 1.96).count();
            if !result.warnings.is_empty() {
                warned.push(texts(result));
            }
        }
    }
    let logs = rigs.len() * seeds as usize;
    assert!(20 * warned.len() <= logs, "{} of {logs}: {warned:#?}", warned.len());
    let covered = covered as f64 / (3 * logs) as f64;
    assert!((0.9..0.99).contains(&covered), "{covered}");
}

#[test]
fn refinement_may_be_left_out_and_says_what_it_changed() {
    let recorded = Rig::default().play(3);
    let plain = try_identify(&recorded, Refine::None, None).expect("identifies");
    let refined = try_identify(&recorded, Refine::OutputError, None).expect("identifies");
    assert!(plain.log.as_ref().is_some_and(|log| log.refinement.is_none()));
    let report = refinement(&refined);
    assert!(report.used && report.note.is_none() && report.averaged == 1 && report.steps > 1);
    let values = |result: &Identification| result.parameters.iter().filter_map(|p| p.value).collect::<Vec<f64>>();
    assert_eq!(report.before, values(&plain));
    assert_ne!(report.before, values(&refined));
    assert!((0.9..1.1).contains(&(report.sensor_noise[0] / 1e-4)), "{:?}", report.sensor_noise);
    // Both see the truth; the refined deviations are not larger.
    for j in 0..3 {
        assert!(scores(&plain, TRUTH)[j].abs() < 4.0 && scores(&refined, TRUTH)[j].abs() < 4.0);
        assert!(refined.parameters[j].std <= plain.parameters[j].std, "{j}");
    }
}

#[test]
fn of_a_long_record_means_are_simulated_or_its_end_and_both_are_said() {
    let short = identify(Rig { periods: 40, ..Rig::default() }, 3);
    for (period, shown) in [(250.0, "means of 5 stretches each"), (250.4, "the last 23788")] {
        let long = identify(Rig { periods: 241, period, ..Rig::default() }, 3);
        let report = refinement(&long);
        assert!(report.used && report.samples < 25_000 && report.of > 60_000, "{report:?}");
        let scores = scores(&long, TRUTH);
        assert!(scores.iter().all(|z| z.abs() < 4.0), "{scores:?}");
        for (of_long, of_short) in long.parameters.iter().zip(&short.parameters) {
            assert!(of_long.std < of_short.std, "{of_long:?} {of_short:?} {:#?} {report:?}", texts(&long));
        }
        let text = long.to_string();
        assert!(text.contains(shown), "{text}");
    }
}

#[test]
fn single_wrong_readings_are_named_and_do_no_harm() {
    let mut recorded = Rig::default().play(3);
    let wrong = [41, 300, 512, 777, 901];
    wrong.iter().for_each(|&k| recorded.position[k] += 0.2);
    let result = try_identify(&recorded, Refine::OutputError, None).expect("identifies");
    let [Warning::LoneReadings { coordinate, count, line, farthest, .. }] = result.warnings.as_slice() else {
        panic!("{:?}", texts(&result));
    };
    // The first sample stands in the second line.
    assert_eq!((coordinate.as_str(), *count, *line), ("x", wrong.len(), wrong[0] as u64 + 2));
    assert!((farthest - 0.2).abs() < 1e-3, "{farthest}");
    let scores = scores(&result, TRUTH);
    assert!(scores.iter().all(|z| z.abs() < 4.0), "{scores:?}");
}

/// What is said of a record that says little, whether it is identified or not.
fn said(recorded: &Recorded, period: Option<f64>) -> (Option<Identification>, String) {
    match try_identify(recorded, Refine::OutputError, period) {
        Ok(result) => {
            let mut text = texts(&result).join("\n");
            let status: Vec<String> = result.parameters.iter().map(|p| format!("{:?}", p.status)).collect();
            let _ = write!(text, "\n{}", status.join(", "));
            (Some(result), text)
        }
        Err(error) => (None, error.to_string()),
    }
}

#[test]
fn one_period_is_said_to_be_one() {
    let recorded = Rig { periods: 1, ..Rig::default() }.play(1);
    let model = DeclaredModel::parse("S", MODEL).expect("a model");
    let file = written(&recorded);
    let mut request = LogRequest::new(file.path()).hold(Hold::Zoh);
    request.estimation.domain = Some(Domain::Harmonics);
    let refused = from_log(&model, request).expect_err("nothing repeats").to_string();
    assert!(refused.contains("record at least two whole periods"), "{refused}");
    // It is too short for lines, and is simulated.
    let (result, unstated) = said(&recorded, None);
    let result = result.expect("any motion will do");
    assert!(result.log.as_ref().is_some_and(|log| matches!(log.way, Way::Samples(_))), "{:?}", result.log);
    let scores_unstated = scores(&result, TRUTH);
    assert!(scores_unstated.iter().all(|z| z.abs() < 4.0), "{scores_unstated:?} {unstated}");
    let (result, stated) = said(&recorded, Some(1.0));
    let result = result.expect("one period is enough when it is stated");
    assert!(result.warnings.contains(&Warning::OnePeriod), "{stated}");
    let scores = scores(&result, TRUTH);
    assert!(scores.iter().all(|z| z.abs() < 4.0), "{scores:?} {stated}");
}

#[test]
fn readings_on_two_counts_do_not_give_sure_numbers() {
    for seed in 0..4 {
        let mut recorded = Rig::default().play(seed);
        recorded.position.iter_mut().for_each(|x| *x = if *x > 0.0 { 0.5 } else { 0.0 });
        for period in [None, Some(1.0)] {
            let (result, said) = said(&recorded, period);
            let Some(result) = result else { continue };
            let scores = scores_where_seen(&result);
            assert!(scores.iter().all(|z| z.abs() < 4.0) || !result.warnings.is_empty(), "{scores:?} {said}");
        }
    }
}

#[test]
fn noise_that_drowns_the_motion_does_not_give_sure_numbers() {
    for seed in 0..4 {
        let mut recorded = Rig::default().play(seed);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        recorded.position.iter_mut().for_each(|x| {
            let noise: f64 = StandardNormal.sample(&mut rng);
            *x += 3.0 * noise;
        });
        for period in [None, Some(1.0)] {
            let (result, said) = said(&recorded, period);
            let Some(result) = result else { continue };
            let scores = scores_where_seen(&result);
            assert!(scores.iter().all(|z| z.abs() < 4.0) || !result.warnings.is_empty(), "{scores:?} {said}");
        }
    }
}

/// Errors in units of the stated deviation of the parameters that have a value.
fn scores_where_seen(result: &Identification) -> Vec<f64> {
    let seen = result.parameters.iter().zip(TRUTH);
    seen.filter_map(|(p, truth)| Some((p.value? - truth) / p.std?)).collect()
}
