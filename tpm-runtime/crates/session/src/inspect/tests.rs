//! Records whose truth is known.

use crate::inspect::finding::Finding;
use crate::inspect::plateau::End;
use crate::inspect::relation::RelationKind;
use crate::inspect::report::Inspection;
use crate::inspect::survey::measure;
use crate::options::LogOptions;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use tpm_log::{Log, Role, Survey, Surveyed};
use tpm_report::Remedy;

const SAMPLE_TIME: f64 = 2e-3;

fn extremes(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::NAN; 2], |[low, high], &x| [low.min(x), high.max(x)])
}

/// Looks at channels in memory.
fn inspected(channels: &[(&str, Vec<f64>)]) -> Inspection {
    let log = Log::from_samples("run.csv", SAMPLE_TIME, channels.iter().map(|(_, values)| values.clone()).collect());
    let of = |(name, _): &(&str, Vec<f64>)| Surveyed { name: (*name).into(), unit: None, role: Role::Column };
    let survey = Survey {
        recording: log.expect("finite").into(),
        channels: channels.iter().map(of).collect(),
        extremes: channels.iter().map(|(_, values)| extremes(values)).collect(),
        unread: Vec::new(),
    };
    measure(&survey, &LogOptions::default(), 0).expect("a record")
}

fn sampled(samples: usize, of: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..samples).map(|k| of(k as f64 * SAMPLE_TIME)).collect()
}

fn noisy(mut signal: Vec<f64>, deviation: f64, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for value in &mut signal {
        let random: f64 = StandardNormal.sample(&mut rng);
        *value += deviation * random;
    }
    signal
}

/// A motion of period 1.6 s, and its rate.
fn motion(t: f64) -> f64 {
    let w = 2.0 * PI / 1.6;
    (w * t).cos() + 0.4 * (3.0 * w * t + 1.0).cos()
}

fn rate(t: f64) -> f64 {
    let w = 2.0 * PI / 1.6;
    -w * (w * t).sin() - 1.2 * w * (3.0 * w * t + 1.0).sin()
}

/// A sweep, which does not repeat.
fn sweep(t: f64) -> f64 {
    (2.0 * PI * (0.3 * t + 0.03 * t * t)).sin()
}

#[test]
fn noise_counts_and_the_shortest_period_are_read() {
    let fine = noisy(sampled(8000, motion), 2e-3, 1);
    let counts: Vec<f64> = noisy(sampled(8000, motion), 1e-3, 2).iter().map(|x| (x / 0.02).round() * 0.02).collect();
    let slow = sampled(8000, |t| (2.0 * PI * t / 3.2).sin());
    let found = inspected(&[("fine", fine), ("counts", counts), ("slow", slow), ("sweep", sampled(8000, sweep))]);
    let [fine, counts, slow, sweep] = found.channels.as_slice() else { panic!("four channels") };
    assert!((fine.noise.expect("noise") / 2e-3 - 1.0).abs() < 0.05, "{:?}", fine.noise);
    assert_eq!(fine.step, None);
    assert!((counts.step.expect("counts") / 0.02 - 1.0).abs() < 1e-9, "{:?}", counts.step);
    assert!(slow.noise.is_none() && sweep.noise.is_none(), "{:?} {:?}", slow.noise, sweep.noise);
    let periods: Vec<Option<f64>> = found.channels.iter().map(|channel| channel.period).collect();
    for (found, truth) in periods.iter().zip([1.6, 1.6, 3.2]) {
        assert!((found.expect("a period") / truth - 1.0).abs() < 1e-4, "{found:?} {truth}");
    }
    assert_eq!(sweep.period, None);
    // Both together repeat with the longer one.
    let repeats = found.repeats.expect("three channels repeat");
    assert!((repeats.period / 3.2 - 1.0).abs() < 1e-3 && repeats.periods >= 4, "{repeats:?}");
    assert_eq!(repeats.channels, ["fine", "counts", "slow"]);
    // The fastest part of a motion stands out, and nothing above it.
    let highest = fine.highest.expect("a frequency");
    assert!((1.6..3.0).contains(&highest), "{highest}");
    let rounded = found.findings.iter().find_map(|finding| match finding {
        Finding::Counts { channel, counts, .. } => Some((channel.as_str(), *counts)),
        _ => None,
    });
    let (channel, number) = rounded.expect("counts are a finding");
    assert!(channel == "counts" && (100.0..160.0).contains(&number), "{channel} {number}");
}

#[test]
fn rests_are_told_from_turns() {
    // To and fro over a second each, with rests of .75 s between.
    let stroke = |t: f64| {
        let phase = t.rem_euclid(3.5);
        let s = |x: f64| x * x * (3.0 - 2.0 * x);
        match phase {
            p if p < 1.0 => s(p),
            p if p < 1.75 => 1.0,
            p if p < 2.75 => 1.0 - s(p - 1.75),
            _ => 0.0,
        }
    };
    for noise in [0.0, 1e-4, 2e-3] {
        let found = inspected(&[("x", noisy(sampled(9000, stroke), noise, 3)), ("sweep", sampled(9000, sweep))]);
        let rest = found.channels[0].rest.expect("rests");
        assert!((rest.share - 1.5 / 3.5).abs() < 0.04, "{noise}: {rest:?}");
        assert!((rest.longest - 0.75).abs() < 0.1, "{noise}: {rest:?}");
        assert_eq!(found.channels[1].rest, None, "{noise}");
    }
}

#[test]
fn a_channel_that_is_cut_off_is_told_from_one_that_turns_rests_or_switches() {
    let force = |t: f64| 12.0 * motion(t) + 0.5 * sweep(t);
    let clipped = sampled(9000, |t| force(t).clamp(-9.0, 11.0));
    let share = clipped.iter().filter(|u| **u >= 11.0).count() as f64 / 9000.0;
    let counts = sampled(9000, |t| (motion(t) / 0.02).round() * 0.02);
    let rests = sampled(9000, |t| (motion(t) * 3.0).tanh());
    let switches = sampled(9000, |t| motion(t).signum());
    let held = sampled(9000, |t| force((t / 0.02).floor() * 0.02));
    let found =
        inspected(&[("u", clipped), ("counts", counts), ("rests", rests), ("switches", switches), ("held", held)]);
    let plateaus = &found.channels[0].plateaus;
    assert_eq!(
        plateaus.iter().map(|of| (of.end, of.level)).collect::<Vec<_>>(),
        [(End::Least, -9.0), (End::Largest, 11.0)]
    );
    assert!((plateaus[1].share - share).abs() < 1e-3, "{} {share}", plateaus[1].share);
    for channel in &found.channels[1..] {
        assert!(channel.plateaus.is_empty(), "{}: {:?}", channel.name, channel.plateaus);
    }
}

#[test]
fn a_noisy_channel_that_is_cut_off_is_told_from_one_that_turns_rests_or_switches() {
    // From end to end at a constant speed, slowing down over a tenth of the way, and a rest of half a second.
    let trapezoid = |t: f64| {
        let x = (t.rem_euclid(3.0)).min(2.5);
        let stroke = |s: f64| match s {
            s if s <= 0.0 => 0.0,
            s if s < 0.2 => 2.5 * s * s,
            s if s < 0.8 => 0.1 + (s - 0.2),
            s if s < 1.0 => 0.8 - 2.5 * (1.0 - s).powi(2),
            _ => 0.8,
        };
        stroke(x) - stroke(x - 1.5)
    };
    for (seed, noise) in (0..3).flat_map(|seed| [1e-4, 1e-3, 1e-2].map(|noise| (seed, noise))) {
        let of = |signal: Vec<f64>, number: u64| noisy(signal, noise, 10 * seed + number);
        let shape = |t: f64| motion(t) + 0.1 * sweep(t);
        let clipped = sampled(9000, |t| shape(t).clamp(-0.9, 0.8));
        let share = clipped.iter().filter(|x| **x >= 0.8).count() as f64 / 9000.0;
        let found = inspected(&[
            ("clipped", of(clipped, 0)),
            ("turns", of(sampled(9000, shape), 1)),
            ("sweep", of(sampled(9000, sweep), 2)),
            ("rests", of(sampled(9000, |t| (motion(t) * 3.0).tanh()), 3)),
            ("switches", of(sampled(9000, |t| motion(t).signum()), 4)),
            ("trapezoid", of(sampled(9000, trapezoid), 5)),
            ("held", of(sampled(9000, |t| shape((t / 0.02).floor() * 0.02)), 6)),
        ]);
        let plateaus = &found.channels[0].plateaus;
        assert!(plateaus.len() == 2, "{noise} {seed}: {plateaus:?}");
        assert!((plateaus[0].level + 0.9).abs() < noise && (plateaus[1].level - 0.8).abs() < noise, "{plateaus:?}");
        assert!((plateaus[1].share - share).abs() < 0.02, "{noise}: {} {share}", plateaus[1].share);
        for channel in &found.channels[1..] {
            assert!(channel.plateaus.is_empty(), "{noise} {seed} {}: {:?}", channel.name, channel.plateaus);
        }
    }
}

#[test]
fn the_delay_of_a_measured_rate_is_told_to_a_part_of_a_sample() {
    for delay in [0.0, 0.5 * SAMPLE_TIME, 0.0073] {
        let position = noisy(sampled(9000, motion), 1e-4, 4);
        let measured = noisy(sampled(9000, |t| 0.5 * rate(t - delay)), 1e-2, 5);
        let found = inspected(&[("q", position), ("v", measured)]);
        let relation = found.relations.first().expect("a relation");
        assert_eq!((relation.kind, relation.of.as_str(), relation.channel.as_str()), (RelationKind::Rate, "q", "v"));
        assert!((relation.gain / 0.5 - 1.0).abs() < 2e-3, "{relation:?}");
        assert!((relation.delay - delay).abs() < 5e-5, "{delay}: {relation:?}");
        assert!((relation.delay - delay).abs() < 5.0 * relation.deviation + 1e-5, "{delay}: {relation:?}");
    }
    // At one frequency anything is a gain and a delay away from anything.
    let one = inspected(&[("q", sampled(9000, |t| (4.0 * t).sin())), ("u", sampled(9000, |t| (4.0 * t - 0.3).sin()))]);
    assert!(one.relations.is_empty(), "{:?}", one.relations);
}

#[test]
fn stale_readings_and_lone_ones_are_found() {
    let mut stale = noisy(sampled(8000, motion), 1e-3, 6);
    (0..8000).filter(|k| k % 20 == 7).for_each(|k| stale[k] = stale[k - 1]);
    let mut lone = noisy(sampled(8000, motion), 1e-3, 7);
    [700, 2400, 5100].iter().for_each(|&k| lone[k] += 1.0);
    let steady = noisy(sampled(8000, motion), 1e-3, 9);
    let found = inspected(&[("steady", steady), ("stale", stale), ("lone", lone)]);
    let [steady, stale, lone] = found.channels.as_slice() else { panic!("three channels") };
    assert!((stale.repeated.expect("stale readings") - 0.05).abs() < 5e-3, "{:?}", stale.repeated);
    let spikes = lone.lone.expect("lone readings");
    assert!(spikes.count == 3 && spikes.line == 701 && (spikes.farthest - 1.0).abs() < 0.02, "{spikes:?}");
    assert_eq!((steady.repeated, steady.lone, steady.drift), (None, None, None));
}

#[test]
fn drift_is_told_from_noise_and_from_a_transient() {
    let steady = noisy(sampled(8000, motion), 1e-3, 9);
    let settles = noisy(sampled(8000, |t| motion(t) * (1.0 + 0.2 * (-t / 0.5).exp())), 1e-3, 10);
    let drifts = noisy(sampled(8000, |t| motion(t) * (1.0 + 0.1 * t / 16.0)), 1e-3, 8);
    let found = inspected(&[("steady", steady), ("settles", settles), ("drifts", drifts)]);
    let drift: Vec<Option<f64>> = found.channels.iter().map(|channel| channel.drift).collect();
    // From the first to the last of ten periods it grows by nine tenths of a tenth.
    assert!((drift[2].expect("drift") - 0.09).abs() < 0.02, "{drift:?}");
    assert_eq!(drift[..2], [None, None]);
}

#[test]
fn findings_name_what_to_do() {
    let found = inspected(&[("q", sampled(4000, sweep)), ("dead", vec![2.0; 4000])]);
    let remedies: Vec<Remedy> = found.findings.iter().flat_map(Finding::remedies).collect();
    assert!(remedies.contains(&Remedy::PeriodAndStart), "{remedies:?}");
    let text = found.to_string();
    assert!(text.contains("dead is 2 throughout") && text.contains("nothing repeats"), "{text}");
    let json = serde_json::to_value(&found).expect("JSON");
    assert_eq!(json["schema"], "tpm.inspection/1");
    assert!(json["findings"].as_array().is_some_and(|all| all.len() == found.findings.len()));
}
