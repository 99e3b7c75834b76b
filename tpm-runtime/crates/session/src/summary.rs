//! What every result says in the same way, wherever its data come from.

use crate::identification::{Identification, Provenance, Source};
use crate::refine::Refined;
use crate::warning::{Data, Warning};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use tpm_campaign::{Campaign, Contradiction, RunReport};
use tpm_controller::model::Model;
use tpm_estimate::named::{EstimateReport, ParameterReport};
use tpm_estimate::{Estimate, LARGE_RESIDUAL, ResidualOf, Status, Weights};
use tpm_log::Lone;
use tpm_motion::RunEnding;
use tpm_numerics::{alarm, tolerance};
use tpm_physical::{
    PhysicalError, PhysicalSettings, gives_energy, has_inertia, is_lumped, negative_inertias, physical, takes_energy,
};
use tpm_plant::stability::LoopStability;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::Prepared;

/// Instants of a period at which the speeds of an experiment are looked at.
const INSTANTS: usize = 64;
/// A step of more than so many of its own deviations went where its linearisation does not hold.
const LONGEST_LAST_STEP: f64 = 3.0;

/// One warning for every coordinate of which readings were replaced or left out.
pub(super) fn lone_readings<'a>(model: &'a dyn Model<f64>, lone: &'a [Lone]) -> impl Iterator<Item = Warning> + 'a {
    (0..model.dims().coordinates).filter_map(|c| {
        let own = || lone.iter().filter(move |lone| lone.coordinate == c);
        own().next().map(|first| Warning::LoneReadings {
            coordinate: model.coordinate(c).name.into(),
            count: own().count(),
            line: first.line,
            farthest: own().map(|lone| lone.by.abs()).fold(0.0, f64::max),
            unit: model.coordinate(c).unit.map(Into::into),
        })
    })
}

/// Name and version of the program.
pub(super) fn provenance() -> Provenance {
    Provenance { tool: format!("tpm {}", env!("CARGO_PKG_VERSION")), ..Provenance::default() }
}

/// What was asked for, by name.
pub(super) fn options(request: &impl serde::Serialize) -> BTreeMap<String, serde_json::Value> {
    match serde_json::to_value(request) {
        Ok(serde_json::Value::Object(fields)) => fields.into_iter().collect(),
        _ => BTreeMap::new(),
    }
}

/// The result of a campaign so far, in the parameters that its estimator gives; `stability` is what its loop was found to be.
#[must_use]
pub fn of_campaign(campaign: &Campaign<'_>, stability: LoopStability, source: Source, seed: u64) -> Identification {
    of_estimated(campaign, stability, source, seed).judged()
}

/// The result of a campaign so far as its estimator gives it, before it is judged.
pub(super) fn of_estimated(
    campaign: &Campaign<'_>,
    stability: LoopStability,
    source: Source,
    seed: u64,
) -> Identification {
    of_estimate(campaign, campaign.estimate(), stability, source, seed)
}

/// The result of a campaign so far whose estimate was refined, before it is judged.
pub(super) fn of_refined(
    campaign: &Campaign<'_>,
    refined: Refined,
    stability: LoopStability,
    source: Source,
    seed: u64,
) -> Identification {
    let mut result = of_estimate(campaign, Some(&refined.estimate), stability, source, seed);
    if refined.report.as_ref().is_some_and(|report| report.used) {
        (result.residual, result.residual_of) = (refined.estimate.residual, refined.estimate.residual_of);
    }
    result.current = refined.estimate.values;
    result.refinement = refined.report;
    result.warnings.extend(refined.warnings);
    result
}

/// Weights other than the usual ones, which a result of a model that leaves something out depends on.
fn equal_weights(weights: Weights) -> Option<(String, serde_json::Value)> {
    (weights == Weights::Equal).then(|| ("weights".to_string(), "equal".into()))
}

/// The result of a campaign so far with an estimate that its runs gave.
fn of_estimate(
    campaign: &Campaign<'_>,
    estimate: Option<&Estimate>,
    stability: LoopStability,
    source: Source,
    seed: u64,
) -> Identification {
    let model = campaign.model();
    let setup = campaign.setup();
    // A step that no run has confirmed is as uncertain as it is long.
    let widened = estimate.zip(campaign.unsettled()).map(|(found, moved)| found.moving(&moved, &setup.estimation));
    let estimate = widened.as_ref().or(estimate);
    let own = EstimateReport::new(model, &setup.stated_prior(), estimate);
    // With coordinates eliminated the machine's parameters are the physical ones behind lumped ones.
    let (linear, found, report, physical, physical_covariance) = match campaign.estimator().lumped() {
        Some((lumped, found)) => {
            let report = EstimateReport::new(lumped, &[], Some(found));
            (lumped, Some(found), report, own.parameters, own.covariance)
        }
        None => (model, estimate, own, Vec::new(), Vec::new()),
    };
    let EstimateReport { parameters, unobservable, combinations, covariance, combination_covariance } = report;
    let mut result = Identification {
        source,
        model: model.name().into(),
        estimator: setup.method,
        frequency_name: setup.pattern.frequency.clone(),
        outcome: campaign.outcome(),
        stop: campaign.stop().cloned(),
        advice: estimate.filter(|_| campaign.outcome().is_some()).and_then(|estimate| campaign.advice(estimate)),
        seed: Some(seed),
        hold: setup.procedure.hold,
        harmonics: campaign.runs().iter().rev().find_map(|run| run.harmonics).unwrap_or(0),
        parameters,
        physical,
        unobservable,
        combinations,
        covariance,
        combination_covariance,
        physical_covariance,
        rank: found.map_or(0, |e| e.rank),
        invisible: 0,
        condition: found.map(|e| e.condition).filter(|c| c.is_finite()),
        residual: found.map_or(0.0, |e| e.residual),
        residual_of: found.map_or(ResidualOf::Force, |e| e.residual_of),
        runs: campaign.runs().to_vec(),
        stability: Some(stability),
        refinement: None,
        method: None,
        log: None,
        pool: None,
        warnings: campaign_warnings(linear, found, campaign),
        provenance: Provenance {
            seed: (source == Source::SimulatedPlant).then_some(seed),
            options: equal_weights(setup.estimation.weights).into_iter().collect(),
            ..provenance()
        },
        current: campaign.current().to_vec(),
        estimate: estimate.cloned(),
        completed_model: None,
        shortfall: None,
    };
    if estimate.is_some() {
        let mut position = vec![0.0; model.dims().motion_len()];
        if let Some(stage) = setup.procedure.stages.first() {
            stage.trajectory(&setup.pattern, 1.0).motion(0.0, &mut position);
        }
        let n = model.dims().coordinates;
        let mut speed = vec![0.0_f64; n];
        for stage in &setup.procedure.stages {
            let trajectory = stage.trajectory(&setup.pattern, 1.0);
            let mut motion = position.clone();
            for instant in 0..INSTANTS {
                trajectory.motion(2.0 * PI * instant as f64 / INSTANTS as f64, &mut motion);
                speed.iter_mut().zip(&motion[n..]).for_each(|(most, v)| *most = most.max(v.abs()));
            }
        }
        position.truncate(n);
        warn_of_impossible_values(&mut result, model, &setup.constants, (&position, &speed));
    }
    result
}

fn campaign_warnings(model: &dyn Model<f64>, estimate: Option<&Estimate>, campaign: &Campaign<'_>) -> Vec<Warning> {
    let runs = campaign.runs();
    let stopped = runs.iter().filter(|run| run.ending != RunEnding::Complete);
    let goes_on = |run: &RunReport| campaign.outcome().is_none() || run.run < runs.len();
    let mut warnings: Vec<Warning> =
        stopped.map(|run| Warning::Run { run: run.run, ending: run.ending, goes_on: goes_on(run) }).collect();
    warnings.extend(contradictions(runs));
    warnings.extend(runs.iter().filter_map(|run| {
        let mode = run.near_mode.clone()?;
        Some(Warning::NearMode { run: run.run, fundamental: run.frequency, mode })
    }));
    if let Some(outcome) = campaign.outcome().filter(|outcome| !outcome.is_normal()) {
        warnings.push(Warning::EndedEarly { outcome, limit: campaign.stop().cloned() });
    }
    let moves = |(moved, estimate): (Vec<f64>, &Estimate)| {
        moved.iter().zip(&estimate.std).any(|(moved, std)| std.is_finite() && moved.abs() > LONGEST_LAST_STEP * std)
    };
    // A schedule may end as planned, or by its share of effort, before the updates have settled. What the estimator knows of how its
    // response bends comes from steps along other combinations, and the one that hardly shows is longest off: only another run confirms it.
    if campaign.unsettled().zip(campaign.estimate()).is_some_and(moves) {
        warnings.push(Warning::FarFromLinear { estimator: campaign.estimator().name() });
    }
    let plant = campaign.model();
    for (i, mounted) in campaign.setup().procedure.motors.iter().enumerate() {
        if let Some(mounted) = mounted.filter(|mounted| mounted.motor.rotor_inertia > 0.0) {
            warnings.push(Warning::RotorIncluded {
                coordinate: plant.coordinate(mounted.coordinate).name.to_string(),
                input: plant.input(i).name.to_string(),
                inertia: mounted.motor.rotor_inertia * mounted.motor.ratio.powi(2),
            });
        }
    }
    match estimate {
        None => warnings.push(Warning::NothingAccepted),
        Some(estimate) => warnings.extend(doubts(model, estimate, Data::Runs)),
    }
    let said = campaign.estimator().remarks();
    warnings.extend(said.iter().map(|remark| Warning::Physical { remark: remark.clone() }));
    warnings
}

/// The runs that contradict those that are pooled.
fn contradictions(runs: &[RunReport]) -> impl Iterator<Item = Warning> + '_ {
    let pooled: Vec<usize> = runs.iter().filter(|run| run.is_pooled()).map(|run| run.run).collect();
    let outside = runs.iter().filter(|run| run.contradicts.is_some()).count();
    let majority = pooled.len() > outside;
    runs.iter().filter_map(move |run| {
        let Contradiction { parameter, deviations } = run.contradicts.clone()?;
        Some(Warning::Contradicts { run: run.run, parameter, deviations, pooled: pooled.clone(), majority })
    })
}

/// What is unexplained, and which parameters the data do not tell well.
pub(super) fn doubts(model: &dyn Model<f64>, estimate: &Estimate, data: Data) -> Vec<Warning> {
    let name = |j: usize| model.parameter(j).name.to_string();
    let combinations = estimate.combinations();
    let shared = |j: usize| combinations.iter().any(|shown| shown.weights[j].abs() > tolerance::COMPONENT);
    let (mut doubts, mut together) = (Vec::new(), Vec::new());
    if estimate.residual > LARGE_RESIDUAL {
        doubts.push(Warning::Unexplained { residual: estimate.residual, of: estimate.residual_of });
    }
    for (j, status) in estimate.status.iter().enumerate() {
        match status {
            Status::Unobservable if shared(j) => together.push(name(j)),
            Status::Unobservable => doubts.push(Warning::NotVisible { parameter: name(j), data }),
            Status::PoorlyDetermined => doubts.push(Warning::PoorlyDetermined {
                parameter: name(j),
                value: estimate.values[j],
                std: estimate.std[j],
            }),
            Status::Identified | Status::Frozen | Status::Untrusted => {}
        }
    }
    if !together.is_empty() {
        doubts.push(Warning::OnlyInCombinations { parameters: together, data });
    }
    doubts
}

/// Warns of masses and inertias that came out negative, unless the matrix of accelerations at rest at a
/// position is that of some machine: a coupling of inertias may well be negative where the whole matrix is positive definite.
/// Where it is, the rows are a balance of forces, and damping or friction that came out negative would drive the machine.
pub(super) fn warn_of_impossible_values(
    result: &mut Identification,
    model: &dyn Model<f64>,
    constants: &[f64],
    (position, speed): (&[f64], &[f64]),
) {
    if has_inertia(model, &result.current, constants, position) {
        let Some(estimate) = &result.estimate else { return };
        let takes = takes_energy(model, constants, position);
        let drives = gives_energy(model, constants, (position, speed), (&estimate.values, &takes));
        let surely = |j: usize| estimate.values[j] < -alarm::DRIVES * estimate.std[j];
        let gives = (0..takes.len()).filter(|&j| drives[j] && surely(j)).map(|j| Warning::GivesEnergy {
            parameter: model.parameter(j).name.into(),
            value: estimate.values[j],
            std: estimate.std[j],
        });
        result.warnings.extend(gives);
        return;
    }
    let named = if result.physical.is_empty() { &result.parameters } else { &result.physical };
    let negative = negative_inertias(named);
    result
        .warnings
        .extend(negative.into_iter().map(|(parameter, value)| Warning::NegativeInertia { parameter, value }));
}

/// Warns of gains of inputs that came out negative where nobody stated that they are: those of forces, in a machine of the given order. A
/// coolant, a brake and a rudder have negative gains as often as not, and a first-order model of a process says nothing of them.
pub(super) fn warn_of_negative_gains(result: &mut Identification, model: &ExactModel, order: usize) {
    let named = if result.physical.is_empty() { &result.parameters } else { &result.physical };
    let gains = model.input_gains();
    let is_gain = |own: &&ParameterReport| gains.iter().any(|gain| *model.quantity(*gain).name == own.name);
    let stated = |own: &&ParameterReport| own.prior.is_some_and(|prior| prior < 0.0);
    let of_force = |own: &&ParameterReport| order > 1 || own.unit.as_ref().is_some_and(|unit| unit.contains('N'));
    let known = named.iter().filter(is_gain).filter(of_force).filter(|own| !stated(own));
    let known = known.filter_map(|own| Some((own.name.clone(), own.value?, own.std?)));
    let against = known.filter(|(_, value, std)| *value < -alarm::DRIVES * std);
    let said = against.map(|(parameter, value, std)| Warning::GoesAgainst { parameter, value, std });
    result.warnings.extend(said.collect::<Vec<_>>());
}

/// A model whose parameters were lumped.
pub(super) struct Lumped<'a>(&'a Prepared);

impl<'a> Lumped<'a> {
    /// The model, when it is one whose parameters were lumped.
    pub(super) fn of(prepared: &'a Prepared) -> Option<Self> {
        is_lumped(prepared).then_some(Self(prepared))
    }

    /// Names of the physical parameters.
    pub(super) fn names(&self) -> Vec<String> {
        let quantities = self.0.model.symbols.iter().filter(|quantity| quantity.kind == Kind::Parameter);
        quantities.map(|quantity| quantity.name.to_string()).collect()
    }

    /// States the priors of columns that are sums of parameters of which every one has a prior in `physical`.
    pub(super) fn state(
        &self,
        prior: &mut Vec<Option<f64>>,
        physical: &BTreeMap<String, f64>,
        constants: &BTreeMap<String, f64>,
    ) {
        let map = ParameterMap::new(self.0);
        if physical.is_empty() || !map.is_linear() {
            return;
        }
        let of = |name: &str| physical.get(name).or_else(|| constants.get(name)).copied().unwrap_or(f64::NAN);
        let columns = map.evaluate(|symbol| of(&self.0.model.quantity(symbol).name));
        prior.resize(columns.len(), None);
        for (prior, sum) in prior.iter_mut().zip(columns) {
            *prior = prior.or(Some(sum).filter(|sum| sum.is_finite()));
        }
    }

    /// Adds the physical parameters that explain a result's lumped ones best, and what there is to say of them. The prior and the
    /// frozen values of `settings` may name other parameters too, which are left out.
    pub(super) fn complete(
        &self,
        result: &mut Identification,
        (model, prior): (&dyn Model<f64>, &[Option<f64>]),
        mut settings: PhysicalSettings,
    ) -> Result<(), PhysicalError> {
        let Some(estimate) = &result.estimate else { return Ok(()) };
        let names = self.names();
        for values in [&mut settings.prior, &mut settings.frozen] {
            values.retain(|name, _| names.contains(name));
        }
        let own = estimate.of_first(self.0.form.columns.len());
        let found = physical(self.0, &own, &settings)?;
        let is_whole = own.values.len() == estimate.values.len() && own.scales.len() == estimate.scales.len();
        if is_whole && !own.scales.is_empty() && found.unobservable.is_empty() {
            // What is held of the machine tells the scales that the log does not show.
            let told = own.with_scales_known(found.lumped.clone(), found.lumped_covariance.clone());
            result.tell(EstimateReport::new(model, prior, Some(&told)));
            (result.rank, result.current) = (told.rank, told.values.clone());
            result.estimate = Some(told);
            let of_scales =
                |own: &Warning| matches!(own, Warning::OnlyTogether { .. } | Warning::OnlyInCombinations { .. });
            result.warnings.retain(|own| !of_scales(own));
        }
        // A value at a bound has no deviation, and so no covariance.
        let known = |i: usize| found.parameters[i].std.is_some();
        let count = found.parameters.len();
        let entry = |r: usize, c: usize| (known(r) && known(c)).then(|| found.covariance[(r, c)]);
        result.physical_covariance = (0..count).map(|r| (0..count).map(|c| entry(r, c)).collect()).collect();
        result.physical = found.parameters;
        result.warnings.extend(found.remarks.into_iter().map(|remark| Warning::Physical { remark }));
        Ok(())
    }
}
