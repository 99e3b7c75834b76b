//! What a campaign's model lacks, asked of the lines of the rows of its runs.
//!
//! Harmonics give parameters, and no more than a residual of what the model lacks; a simulation that follows the runs says what that is. Where
//! none does, the lines say it, as they do of a log. Every run is whole periods of a motion that repeats, so that nothing is lost at its ends.
//!
//! The values stay those of the runs, whose deviations contain how far the terms that are named would move them.

use crate::lines_log::{late_by_hold, unexplained};
use crate::log::state_mechanism;
use crate::model::DeclaredModel;
use crate::options::LogOptions;
use crate::reading::RecordSettings;
use crate::record;
use crate::refine::Refined;
use crate::refinement_report::MissingTerm;
use crate::term_words::lacking;
use crate::warning::Warning;
use tpm_campaign::{Campaign, Setup, SteadyRun};
use tpm_controller::model::Model;
use tpm_estimate::{Estimate, Settings, Status, Stretch, estimate_any_motion};
use tpm_numerics::tolerance;

/// What is known of the runs of a campaign as of logs.
pub(super) fn options(setup: &Setup, estimation: Settings) -> LogOptions {
    LogOptions {
        reading: RecordSettings { hold: setup.procedure.hold, ..RecordSettings::default() },
        actuators: setup.control.actuators.clone(),
        constants: setup.constants.clone(),
        estimation,
        ..LogOptions::default()
    }
}

/// The estimate of a campaign with what the lines of its runs say that the model lacks; `refined` as it is where a simulation has named it,
/// and where nothing is lacking.
pub(super) fn asked(
    declared: &DeclaredModel,
    plant: &dyn Model<f64>,
    campaign: &Campaign<'_>,
    refined: Option<Refined>,
) -> Option<Refined> {
    let names = |refined: &Refined| refined.report.as_ref().is_some_and(|report| !report.missing.is_empty());
    if refined.as_ref().is_some_and(names) {
        return refined;
    }
    let settings = &campaign.setup().estimation;
    let estimate = campaign.estimate()?;
    // Parameters that drift are a misfit of any one model, and a motion that is explained but for rounding lacks nothing.
    if settings.forgets() || estimate.residual <= tolerance::EXPLAINED_FORCE {
        return refined;
    }
    let Some((beside, warnings)) = named(declared, plant, campaign) else { return refined };
    let mut refined = refined.unwrap_or_else(|| Refined::none(estimate.clone()));
    let own = &refined.estimate;
    let shown = |j: usize| [own, &beside].iter().all(|estimate| estimate.status[j] != Status::Unobservable);
    let moved = |j: usize| if shown(j) { beside.values[j] - own.values[j] } else { 0.0 };
    let moved: Vec<f64> = (0..own.values.len()).map(moved).collect();
    refined.estimate = own.moving(&moved, settings);
    refined.warnings.extend(warnings);
    Some(refined)
}

/// The estimate of the lines beside what they say that the model leaves unexplained; nothing where it leaves nothing.
fn named(
    declared: &DeclaredModel,
    plant: &dyn Model<f64>,
    campaign: &Campaign<'_>,
) -> Option<(Estimate, Vec<Warning>)> {
    let setup = campaign.setup();
    let mut settings = setup.estimation.clone();
    // With coordinates eliminated the parameters of the plant are others than those of the text's equations.
    if declared.eliminated().is_empty() {
        let constant = |(i, value): (usize, &f64)| (plant.constant(i).name.to_string(), *value);
        state_mechanism(&mut settings, declared, plant, &setup.constants.iter().enumerate().map(constant).collect());
    }
    let options = options(setup, settings);
    let stretches = last_of_stages(campaign).map(|run| whole_periods(run, plant.dims().coordinates)).collect();
    let record = record::record(setup.control.sample_time, &options, stretches);
    let found = estimate_any_motion(plant, &options.constants, &record, true, &options.estimation).ok()?;
    let missing: Vec<MissingTerm> = found.lacking.iter().map(|own| lacking(plant, own)).collect();
    let mut warnings: Vec<Warning> = unexplained(plant, &found, &missing).collect();
    warnings.extend(late_by_hold(plant, &record, &found, true, &options));
    (!warnings.is_empty()).then_some((found.estimate, warnings))
}

/// The last of the runs of every stage: the others play the same motion, which costs as much and shows nothing new.
fn last_of_stages<'a>(campaign: &'a Campaign<'_>) -> impl Iterator<Item = &'a SteadyRun> {
    let stage = |run: &SteadyRun| campaign.runs().get(run.run).map(|report| report.stage);
    let is_last = move |run: &&SteadyRun| {
        campaign.steady().filter(|other| other.run > run.run).all(|other| stage(other) != stage(run))
    };
    campaign.steady().filter(is_last)
}

/// The whole periods at the end of a run.
fn whole_periods(run: &SteadyRun, coordinates: usize) -> Stretch<'_> {
    let samples = run.samples() / run.period.max(1) * run.period;
    let channels: Vec<&[f64]> = (0..run.channels.len()).map(|channel| run.last(channel, samples)).collect();
    let (own, inputs) = channels.split_at(coordinates);
    Stretch { coordinates: own.to_vec(), rates: vec![None; coordinates], inputs: inputs.to_vec() }
}

#[cfg(test)]
mod tests {
    use crate::{DeclaredModel, Identification, Session};
    use std::collections::BTreeMap;
    use tpm_estimate::LARGE_RESIDUAL;
    use tpm_experiment::{Experiment, PlantModelSection};

    const MODEL: &str = "model Stage { coordinate x [m]; input u [N]; parameter m [kg], d [N*s/m], k [N/m];
        m*ddot(x) + d*dot(x) + k*x = u;
        pattern { amplitude l [m]; frequency w [rad/s]; x = l*(cos(w*t) - 1/9*cos(3*w*t)); } }";
    const RICHER: &str = "model Richer { coordinate x [m]; input u [N];
        parameter m [kg], d [N*s/m], k [N/m], fc [N], k3 [N/m^3];
        m*ddot(x) + d*dot(x) + k*x + fc*sign(dot(x)) + k3*x^3 = u; }";
    const EXPERIMENT: &str = "[plant]
        parameters = { m = 2.0, d = 3.0, k = 40.0, fc = 0.0, k3 = 0.0 }
        [prior]
        m = 1.0
        d = 0.0
        k = 0.0
        [control]
        sample_time = 1e-3
        derivative_filter = 2e-3
        feedback = [{ input = \"u\", coordinate = \"x\", kp = 2000.0, kd = 120.0 }]
        [limits]
        inputs = { u = 800.0 }
        [schedule]
        measure_time = 4.0
        updates_per_stage = 2
        stages = [{ l = 0.2, w = 3.14 }, { l = 0.4, w = 6.28 }]";
    const TRUTH: [(&str, f64); 3] = [("m", 2.0), ("d", 3.0), ("k", 40.0)];
    /// Readings on the grid of an encoder, which no simulation of a smooth force follows, and readings with noise without a simulation.
    const COUNTED: [(&str, &str); 1] = [("plant.sensors.x.step", "1e-5")];
    const NOISY: [(&str, &str); 2] = [("plant.sensors.x.noise", "1e-4"), ("refine", "none")];

    fn identified(changes: &[(&str, &str)]) -> Identification {
        let model = DeclaredModel::parse("model", MODEL).expect("a model");
        let mut experiment = Experiment::parse(EXPERIMENT).expect("an experiment");
        experiment.plant.model = Some(PlantModelSection::Text { text: RICHER.into() });
        changes.iter().for_each(|(key, value)| experiment.apply_override(key, value).expect("known"));
        let session = Session::new(model, experiment, None, BTreeMap::new()).expect("a session");
        session.identify(None, &mut |_, _, _| true).expect("runs")
    }

    fn named(result: &Identification) -> Vec<(&str, f64)> {
        result.missing_of_runs().into_iter().map(|term| (term.term.as_str(), term.value)).collect()
    }

    #[test]
    fn a_force_that_the_model_lacks_is_named_and_deviations_contain_what_it_does() {
        for (changed, value, term) in [("fc", 1.2, "sign(dot(x))"), ("k3", 60.0, "x^3")] {
            let force = (&*format!("plant.parameters.{changed}"), &*value.to_string());
            for sensor in [COUNTED.as_slice(), NOISY.as_slice()] {
                let result = identified(&[&[force], sensor].concat());
                let found = named(&result);
                let size = found.iter().find(|own| own.0 == term).map(|own| own.1);
                assert!(size.is_some_and(|size| (size / value - 1.0).abs() < 0.02), "{sensor:?}: {found:?}");
                // The residual alone would not say that the result does not hold.
                assert!(result.residual < LARGE_RESIDUAL && !result.is_complete(), "{}", result.residual);
                assert!(result.shortfall().is_some_and(|why| why.contains(term)), "{:?}", result.shortfall());
                for (parameter, (name, truth)) in result.parameters.iter().zip(TRUTH) {
                    let (value, std) = (parameter.value.expect("shown"), parameter.std.expect("shown"));
                    assert!((value - truth).abs() < 1.5 * std, "{name} {value} +- {std}");
                }
            }
        }
    }

    #[test]
    fn nothing_is_named_where_the_model_is_right() {
        for seed in 1..=12 {
            let (seed, m) = (seed.to_string(), (1.5 + 0.1 * f64::from(seed)).to_string());
            let own = [("seed", seed.as_str()), ("plant.parameters.m", m.as_str())];
            for sensor in [COUNTED.as_slice(), NOISY.as_slice()] {
                let result = identified(&[&own, sensor].concat());
                // A first run may have to be played for longer, which is no misfit.
                assert!(result.is_complete(), "{own:?} {sensor:?}: {:?}", result.shortfall());
                assert_eq!(named(&result), [], "{own:?} {sensor:?}");
            }
        }
        let exact = identified(&[]);
        assert!(exact.is_complete() && exact.warnings.is_empty(), "{:?}", exact.warnings);
    }
}
