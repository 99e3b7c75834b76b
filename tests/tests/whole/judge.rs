//! One rule for trust: whatever was noticed, the text, the JSON, the page and the exit code of a result say the same of it.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tpm_runtime::campaign::{NearMode, Outcome};
use tpm_runtime::document::Document;
use tpm_runtime::estimate::{PhysicalRemark, ResidualOf, Term, TermKind};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::log::{Repeated, Samples};
use tpm_runtime::motion::RunEnding;
use tpm_runtime::session::{
    Calibration, Data, DeclaredModel, Exchange, Identification, LogRequest, LongSimulation, MissingTerm, NotRefined,
    Severity, UnseenFaultReport, Warning, from_log, from_logs,
};

const MODEL: &str = "model Cart { coordinate x [m]; input u [N]; parameter m [kg], c [N*s/m], k [N/m];
    m*ddot(x) + c*dot(x) + k*x = u; }";

/// Five periods of a cart with m = 1, c = 0.5 and k = 20 under exact forces, times `scale`.
fn samples(scale: f64) -> Samples {
    with_noise(scale, || 0.0)
}

/// The same with noise of the position.
fn with_noise(scale: f64, mut noise: impl FnMut() -> f64) -> Samples {
    let (mut time, mut x, mut u) = (Vec::new(), Vec::new(), Vec::new());
    for n in 0..2500 {
        let t = f64::from(n) * 4e-3;
        let (mut q, mut v, mut a) = (0.0, 0.0, 0.0);
        for (w, size) in [(std::f64::consts::PI, 0.1), (3.0 * std::f64::consts::PI, 0.04)] {
            let (sin, cos) = (w * t).sin_cos();
            (q, v, a) = (q + size * sin, v + size * w * cos, a - size * w * w * sin);
        }
        time.push(t);
        x.push(q + noise());
        u.push(scale * (a + 0.5 * v + 20.0 * q));
    }
    Samples::new(vec![("t_s".into(), time), ("x".into(), x), ("u".into(), u)])
}

fn sound() -> Identification {
    let model = DeclaredModel::parse("cart", MODEL).expect("a model");
    from_log(&model, LogRequest::of_samples("cart.csv", samples(1.0))).expect("identifies")
}

/// A term that a model may lack.
fn term() -> MissingTerm {
    MissingTerm {
        of: Term { kind: TermKind::Power(3), row: Some(0), of: 0, other: None },
        term: "x^3".into(),
        row: Some("u".into()),
        value: 1.0,
        std: 0.1,
        gain: 0.5,
        meaning: "a spring that stiffens".into(),
    }
}

/// One finding of every kind.
fn findings() -> Vec<Warning> {
    let m = || "m".to_owned();
    let x = || "x".to_owned();
    let all = vec![
        Warning::OtherHold {
            stated: Hold::None,
            left: 0.1,
            better: Hold::Zoh,
            left_by_better: 0.01,
            of: ResidualOf::Force,
        },
        Warning::LateByHold { input: "u".into(), late: 5e-4, better: Hold::Zoh },
        Warning::Exchanged {
            exchange: Exchange::Columns { signals: vec![x(), "u".into()] },
            left: 0.5,
            left_by_exchange: 0.01,
        },
        Warning::Astray { coordinate: x(), unit: Some("rad".into()), missed: 0.3, last_reading: 0.1 },
        Warning::BeyondNoise { signal: x(), left: 0.3, noise: 0.01 },
        Warning::ScaleUnknown { inputs: vec!["u".into(), "w".into()] },
        Warning::UnseenFaults {
            faults: vec![UnseenFaultReport {
                signal: x(),
                quantity: Calibration::Zero,
                size: 0.02,
                std: Some(0.1),
                unit: Some(m()),
                deviations: 5.0,
            }],
        },
        Warning::LongSimulation(LongSimulation { work: 1e12, most: 1e11 }),
        Warning::OnePeriod,
        Warning::PeriodNotUsed { period: 2.0, stretches: 2 },
        Warning::AllCoordinates { coordinates: vec![x()] },
        Warning::RepeatedReadings { repeated: Repeated { signal: x(), count: 3, line: 7 } },
        Warning::LoneReadings { coordinate: x(), count: 2, line: 5, farthest: 0.1, unit: Some(m()) },
        Warning::OnlyTogether { parameters: vec![m(), "c".into()] },
        Warning::RateDiffers { coordinate: x(), gain: 1.1 },
        Warning::InLog {
            path: "a.csv".into(),
            warning: Box::new(Warning::Halves { parameter: m(), moved: 0.5, deviation: 0.1 }),
        },
        Warning::LogsDisagree { path: "a.csv".into(), parameter: m(), deviations: 300.0 },
        Warning::OddLog { path: "a.csv".into(), parameter: m(), deviations: 300.0, factor: None },
        Warning::Unsteady { mismatch: 0.1 },
        Warning::MostlyLeftOut { left_out: 100, samples: 150 },
        Warning::HarmonicsLeftOut { from: 5, to: 7 },
        Warning::Unexplained { residual: 0.5, of: ResidualOf::Force },
        Warning::NotVisible { parameter: m(), data: Data::Log },
        Warning::PoorlyDetermined { parameter: m(), value: 1.0, std: 0.9 },
        Warning::OnlyInCombinations { parameters: vec![m(), "c".into()], data: Data::Log },
        Warning::CommonFactor { inputs: vec!["u".into()], factor: 0.08, std: 0.01, count: 7 },
        Warning::GoesAgainst { parameter: m(), value: -2.0, std: 0.1 },
        Warning::NegativeInertia { parameter: m(), value: -1.0 },
        Warning::GivesEnergy { parameter: m(), value: -1.0, std: 0.1 },
        Warning::Run { run: 1, ending: RunEnding::Unsettled, goes_on: true },
        Warning::Contradicts { run: 2, parameter: m(), deviations: 5.0, pooled: vec![1, 3], majority: true },
        Warning::Contradicts { run: 2, parameter: m(), deviations: 5.0, pooled: vec![1], majority: false },
        Warning::NearMode { run: 1, fundamental: 3.0, mode: NearMode { signal: x(), harmonic: 3, frequency: 9.1 } },
        Warning::EndedEarly { outcome: Outcome::Aborted, limit: None },
        Warning::RotorIncluded { coordinate: x(), input: "u".into(), inertia: 0.1 },
        Warning::NothingAccepted,
        Warning::MissingTerm { term: term() },
        Warning::Halves { parameter: m(), moved: 0.5, deviation: 0.1 },
        Warning::Limited { term: term() },
        Warning::Repeats { power: 5.0, beside_terms: false },
        Warning::Vibration { frequency: 20.0 },
        Warning::Unsettled { reason: NotRefined::Moving { parameter: m() } },
        Warning::FarFromLinear { estimator: "error" },
        Warning::EndOfInterval { parameter: m(), end: 1.0, interval: [0.0, 1.0] },
        Warning::SeveralMinima { parameter: m(), value: 1.0, other: 2.0, left: 1.1 },
        Warning::TakenAsKnown { parameter: m(), value: 1.0 },
        Warning::NotRefined { reason: NotRefined::WithoutTerm },
        Warning::AskedInVain { reason: NotRefined::WithoutTerm },
        Warning::Physical { remark: PhysicalRemark::NotDetermined { parameters: vec![m()] } },
    ];
    // Whoever adds a kind of finding adds it above.
    for finding in &all {
        match finding {
            Warning::OtherHold { .. }
            | Warning::LateByHold { .. }
            | Warning::Exchanged { .. }
            | Warning::Astray { .. }
            | Warning::BeyondNoise { .. }
            | Warning::ScaleUnknown { .. }
            | Warning::UnseenFaults { .. }
            | Warning::LongSimulation(_)
            | Warning::OnePeriod
            | Warning::PeriodNotUsed { .. }
            | Warning::AllCoordinates { .. }
            | Warning::RepeatedReadings { .. }
            | Warning::LoneReadings { .. }
            | Warning::OnlyTogether { .. }
            | Warning::RateDiffers { .. }
            | Warning::InLog { .. }
            | Warning::LogsDisagree { .. }
            | Warning::OddLog { .. }
            | Warning::Unsteady { .. }
            | Warning::MostlyLeftOut { .. }
            | Warning::HarmonicsLeftOut { .. }
            | Warning::Unexplained { .. }
            | Warning::NotVisible { .. }
            | Warning::PoorlyDetermined { .. }
            | Warning::OnlyInCombinations { .. }
            | Warning::NegativeInertia { .. }
            | Warning::CommonFactor { .. }
            | Warning::GoesAgainst { .. }
            | Warning::GivesEnergy { .. }
            | Warning::Run { .. }
            | Warning::Contradicts { .. }
            | Warning::NearMode { .. }
            | Warning::EndedEarly { .. }
            | Warning::RotorIncluded { .. }
            | Warning::NothingAccepted
            | Warning::MissingTerm { .. }
            | Warning::Halves { .. }
            | Warning::Limited { .. }
            | Warning::Repeats { .. }
            | Warning::Vibration { .. }
            | Warning::Unsettled { .. }
            | Warning::FarFromLinear { .. }
            | Warning::EndOfInterval { .. }
            | Warning::SeveralMinima { .. }
            | Warning::TakenAsKnown { .. }
            | Warning::NotRefined { .. }
            | Warning::AskedInVain { .. }
            | Warning::Physical { .. } => {}
        }
    }
    all
}

/// The text, the JSON and the page of a result agree with its exit code, which is one where there is a shortfall.
fn says_the_same_everywhere(result: &Identification, said: &Warning) {
    let meaning = said.meaning();
    let is_distrust = meaning.severity == Severity::Distrust;
    assert_eq!(result.is_complete(), !is_distrust, "{said}");
    assert_eq!(result.shortfall().is_some(), is_distrust, "{said}");
    let json = serde_json::to_value(result).expect("serialises");
    assert_eq!(json.get("shortfall").is_some(), is_distrust, "{said}");
    let severities: Vec<&str> =
        json["findings"].as_array().expect("a list").iter().filter_map(|f| f["severity"].as_str()).collect();
    assert_eq!(severities.contains(&"distrust"), is_distrust, "{said}");
    for parameter in json["parameters"].as_array().expect("a list") {
        let name = parameter["name"].as_str().expect("a name");
        let expected = if is_distrust && meaning.concern.includes(name) { "untrusted" } else { "identified" };
        assert_eq!(parameter["status"], expected, "{name}: {said}");
    }
    let text = result.to_string();
    assert!(text.contains(&said.to_string()), "{said}\n{text}");
    // The settings that help are spelled by each front end in its own words.
    assert!(!said.to_string().contains("--"), "{said}");
    let page = Document::of_identification(result, &[], &|_| None).html().expect("a page");
    assert_eq!(page.contains("Not complete"), is_distrust, "{said}");
    let explained = meaning.severity == Severity::Remark;
    assert_eq!(page.contains("The data show everything that was asked for"), explained, "{said}");
    let misfit = meaning.severity == Severity::Misfit;
    assert_eq!(page.contains("has a value, but the model leaves"), misfit, "{said}");
}

#[test]
fn every_kind_of_finding_means_the_same_to_all_who_tell_it() {
    let sound = sound();
    assert!(sound.is_complete() && sound.warnings.is_empty(), "{sound}");
    for finding in findings() {
        let result = sound.clone().with_finding(finding.clone());
        says_the_same_everywhere(&result, &finding);
    }
}

#[test]
fn logs_that_contradict_each_other_identify_nothing() {
    let model = DeclaredModel::parse("cart", MODEL).expect("a model");
    let log = |name: &str, scale: f64| LogRequest::of_samples(name, samples(scale));
    let result = from_logs(&model, [log("a.csv", 1.0), log("b.csv", 1.3)]).expect("identifies");
    let disagree = result.warnings.iter().find(|warning| matches!(warning, Warning::LogsDisagree { .. }));
    says_the_same_everywhere(&result, disagree.expect("the logs are of two machines"));
}

#[test]
fn one_log_of_three_is_blamed_and_its_factor_named() {
    let model = DeclaredModel::parse("cart", MODEL).expect("a model");
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut noise = || 1e-4 * Distribution::<f64>::sample(&StandardNormal, &mut rng);
    let logs = [("a.csv", 1.0), ("b.csv", 1.3), ("c.csv", 1.0)]
        .map(|(name, scale)| LogRequest::of_samples(name, with_noise(scale, &mut noise)));
    let result = from_logs(&model, logs).expect("identifies");
    let odd = result.warnings.iter().find(|warning| matches!(warning, Warning::OddLog { .. })).expect("one is odd");
    let Warning::OddLog { path, factor: Some(factor), .. } = odd else { panic!("{odd:?}") };
    assert!(path == "b.csv" && (factor.value - 1.3).abs() < 1e-3, "{odd:?}");
    assert!(result.is_complete(), "{result}");
    for (name, truth) in [("m", 1.0), ("c", 0.5), ("k", 20.0)] {
        let value = result.parameters.iter().find(|own| own.name == name).and_then(|own| own.value);
        assert!(value.is_some_and(|value| (value - truth).abs() < 1e-3 * truth), "{name} {value:?}");
    }
    says_the_same_everywhere(&result, odd);
}
