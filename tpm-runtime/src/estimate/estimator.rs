//! The estimators behind one trait, each pooling the runs of a campaign.
//!
//! Invariant: what an estimator has learnt from earlier runs is kept and pooled by information; a later run, which tracks
//! better and therefore shows less, never replaces it. Two things reduce what a linearised run counts: residuals beyond its
//! noise (its covariance is inflated by them), and a start farther from the truth than that of a later run, since the error
//! of a linearisation grows with the distance.
//!
//! A run is taken in by two steps. [`Estimator::reduce`] needs the record: it works out harmonics, the rows along the motion
//! and the noise in what is formed of them, read bin by bin at a first estimate; it takes as long as the record does.
//! [`Estimator::update`] goes from there to new parameters and needs harmonics alone.

use crate::estimate::along::Along;
use crate::estimate::applied::{noise_along, refine_last};
use crate::estimate::equations::Equations;
use crate::estimate::first_order::{FirstOrder, Reduced};
use crate::estimate::information::Information;
use crate::estimate::measured_motion::estimate_measured_motion;
use crate::estimate::measured_motion::{EstimateError, MeasuredMotion, Settings};
use crate::estimate::numerical::Numerical;
use crate::estimate::{Estimate, Status};
use crate::run::Spectra;
use crate::run::Trial;
use crate::run::trajectory::{HarmonicSeries, Trajectory};
use num_complex::Complex;
use std::borrow::Cow;
use std::boxed::Box;
use std::string::String;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::Model;

/// A deviation beyond this share of the value makes a parameter poorly determined.
const POOR: f64 = 0.25;
/// A change within so many standard deviations is noise.
const INSIGNIFICANT: f64 = 3.0;
/// A measured line belongs to the motion when its power is this many times that of its noise.
const CERTAIN: f64 = 100.0;

/// One run as an estimator sees it.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// What was played.
    pub trial: &'a Trial,
    /// Spectra of the coordinates, then the inputs, over whole periods that start at phase zero.
    pub spectra: &'a Spectra,
    /// The same with every measured rate, integrated, in place of its coordinate (whose mean it does not show); nothing when
    /// no rate was measured.
    pub rates: Option<&'a Spectra>,
    /// How the recorded inputs became forces.
    pub hold: Hold,
}

impl Run<'_> {
    /// The motion that tells which parameters the run can show: the reference, in which errors of the tracking show nothing.
    ///
    /// Estimates of zero leave open coordinates at rest in the reference, while the machine moves them. The motion is then
    /// the measured one, of all coordinates: rows without an input hold on a motion as a whole, not on a mixture.
    fn judged_motion(&self) -> Cow<'_, Trajectory> {
        let reference = &self.trial.trajectory;
        let rests = |&c: &usize| reference.coordinates[c].highest_harmonic() == 0;
        let measured = self.spectra.lines.len() >= reference.coordinates.len();
        if !(measured && self.trial.open.iter().any(rests)) {
            return Cow::Borrowed(reference);
        }
        let reach = reach(reference).max(1);
        let series = |c: usize| {
            let certain =
                |k: usize, z: &Complex<f64>| k <= reach && z.norm_sqr() > CERTAIN * self.spectra.noise[k][(c, c)].re;
            HarmonicSeries::from_phasors(&self.spectra.lines[c], certain)
        };
        let coordinates = (0..reference.coordinates.len()).map(series).collect();
        Cow::Owned(Trajectory { frequency: self.spectra.fundamental, coordinates })
    }
}

/// From runs to parameters.
pub trait Estimator: Send {
    /// The name in experiment files and reports.
    fn name(&self) -> &'static str;

    /// The parameters that the next run's feed-forward uses, given the present estimates.
    fn play(&self, current: &[f64]) -> Vec<f64> {
        current.to_vec()
    }

    /// Reduces a run to harmonics, with the noise in the equations that are formed of them.
    ///
    /// # Errors
    /// [`EstimateError`]; what was learnt before is kept.
    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError>;

    /// The estimate from all runs that were reduced, or nothing while further runs are needed for it. Asked again, it is the
    /// same.
    ///
    /// # Errors
    /// [`EstimateError`]; the last run is then forgotten.
    fn update(&mut self) -> Result<Option<Estimate>, EstimateError>;

    /// Takes in a run: reduces it and updates.
    ///
    /// # Errors
    /// As those; what was learnt before is kept.
    fn take(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<Option<Estimate>, EstimateError> {
        self.reduce(model, run)?;
        self.update()
    }

    /// Highest harmonic used in the last run.
    fn harmonics(&self) -> usize;

    /// What was estimated on the way, in the parameters of another form of the model (lumped ones of a model with
    /// coordinates eliminated); nothing for most.
    fn lumped(&self) -> Option<(&dyn Model<f64>, &Estimate)> {
        None
    }

    /// What the user should know about the last estimate.
    fn warnings(&self) -> &[String] {
        &[]
    }
}

/// Which estimator to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Inverse dynamics on the measured motion; exact in one run without noise.
    #[default]
    MeasuredMotion,
    /// Harmonics of the tracking error with the exact phase (Feng, Eqns 3.22, 4.29).
    Error,
    /// The same with harmonics coupled.
    Hill,
    /// Harmonics of the feedback's effort on the table.
    Effort,
    /// Harmonics of the tracking error and one extra run per parameter (Feng, Eqn 3.28).
    Numerical,
}

impl Method {
    /// All of them.
    pub const ALL: [Method; 5] =
        [Method::MeasuredMotion, Method::Error, Method::Hill, Method::Effort, Method::Numerical];

    /// The name in experiment files and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Method::MeasuredMotion => "measured-motion",
            Method::Error => "error",
            Method::Hill => "hill",
            Method::Effort => "effort",
            Method::Numerical => "numerical",
        }
    }

    /// The estimator, with everything still to learn.
    #[must_use]
    pub fn estimator(self, settings: &Settings) -> Box<dyn Estimator> {
        let first_order = |kind| Box::new(Linearised::new(kind, settings));
        match self {
            Method::MeasuredMotion => {
                Box::new(PooledMotion { settings: settings.clone(), records: Vec::new(), design: Vec::new() })
            }
            Method::Error => first_order(FirstOrder::Error),
            Method::Hill => first_order(FirstOrder::Hill),
            Method::Effort => first_order(FirstOrder::Effort),
            Method::Numerical => Box::new(Numerical::new(settings)),
        }
    }
}

/// Measured motion over all runs.
struct PooledMotion {
    settings: Settings,
    records: Vec<MeasuredMotion>,
    /// What the references of the runs up to each one show, and the directions that they do not.
    design: Vec<(Information, Vec<Vec<f64>>)>,
}

impl PooledMotion {
    /// What the references up to a run show, this one being its motion, and the directions that they do not.
    fn design(
        &self,
        model: &dyn Model<f64>,
        constants: &[f64],
        motion: &Trajectory,
    ) -> Result<(Information, Vec<Vec<f64>>), EstimateError> {
        let free = self.settings.free(model.dims().parameters)?;
        let own = Along::design(model, constants, motion, reach(motion).max(1), &free.indices)?;
        let whole = self.design.last().map_or_else(|| own.clone(), |(before, _)| before.pool(&own));
        let found = whole.solve(&vec![0.0; free.indices.len()], None).unobservable;
        let hidden = found.iter().map(|direction| free.spread(direction)).collect();
        Ok((whole, hidden))
    }

    /// The settings with the directions that these references do not show.
    fn with(&self, hidden: &[Vec<f64>]) -> Settings {
        Settings { hidden: hidden.to_vec(), ..self.settings.clone() }
    }
}

impl Estimator for PooledMotion {
    fn name(&self) -> &'static str {
        "measured-motion"
    }

    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        let motion = run.judged_motion();
        let design = self.design(model, &run.trial.constants, &motion)?;
        let settings = Settings { reach: reach(&motion), ..self.with(&design.1) };
        let record = MeasuredMotion::new(model, &run.trial.constants, run.spectra, run.hold, &settings)?;
        self.records.push(record);
        let mut first = |records: &mut [MeasuredMotion]| Ok(estimate_measured_motion(records, &settings)?.values);
        let refined = refine_last(&mut self.records, model, &run.trial.constants, run.spectra, run.hold, &mut first);
        if refined.is_err() {
            self.records.pop();
        } else {
            self.design.push(design);
        }
        refined
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        let settings = self.with(self.design.last().map_or(&[], |(_, hidden)| hidden));
        let estimate = estimate_measured_motion(&mut self.records, &settings);
        if estimate.is_err() {
            self.records.pop();
            self.design.pop();
        }
        estimate.map(Some)
    }

    fn harmonics(&self) -> usize {
        self.records.last().map_or(0, MeasuredMotion::harmonics)
    }
}

/// `error`, `effort` and `hill`.
struct Linearised {
    kind: FirstOrder,
    settings: Settings,
    pools: Pools,
    /// The last run, reduced.
    last: Option<Reduced>,
    /// The rows along the last reference, which the next run of a stage has too.
    reference: Option<Reference>,
    harmonics: usize,
}

impl Linearised {
    /// With everything still to learn.
    fn new(kind: FirstOrder, settings: &Settings) -> Self {
        let (settings, pools) = (settings.clone(), Pools::default());
        Linearised { kind, settings, pools, last: None, reference: None, harmonics: 0 }
    }
}

/// The rows along a reference, up to a harmonic.
struct Reference {
    trajectory: Trajectory,
    constants: Vec<f64>,
    highest: usize,
    along: Along,
}

impl Reference {
    fn new(model: &dyn Model<f64>, trial: &Trial, highest: usize) -> Result<Self, EstimateError> {
        let (trajectory, constants) = (trial.trajectory.clone(), trial.constants.clone());
        let along = Along::new(model, &constants, &trajectory, highest)?;
        Ok(Reference { trajectory, constants, highest, along })
    }

    fn is_of(&self, trial: &Trial, highest: usize) -> bool {
        self.highest == highest && self.trajectory == trial.trajectory && self.constants == trial.constants
    }
}

impl Estimator for Linearised {
    fn name(&self) -> &'static str {
        match self.kind {
            FirstOrder::Error => "error",
            FirstOrder::Effort => "effort",
            FirstOrder::Hill => "hill",
        }
    }

    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        self.pools.close();
        self.last = None;
        let highest = highest_harmonic(&self.settings, run);
        let reference = match self.reference.take().filter(|reference| reference.is_of(run.trial, highest)) {
            Some(reference) => reference,
            None => Reference::new(model, run.trial, highest)?,
        };
        let along = &self.reference.insert(reference).along;
        let mut reduced = match run.rates {
            None => self.kind.reduce(run.trial, along, run.spectra, run.hold, highest)?,
            Some(_) => self.kind.reduce_applied(run.trial, along, run.spectra, run.hold, (0, highest))?,
        };
        let own = reduced.equations.len();
        // The effort is the same with either error.
        if let Some(rates) = run.rates.filter(|_| self.kind != FirstOrder::Effort) {
            reduced.append(self.kind.reduce_applied(run.trial, along, rates, run.hold, (1, highest))?);
        }
        self.harmonics = highest;
        // What noise does to the equations depends on the parameters: how much of it the rows feel, and how far the mean of a term
        // that is even in the velocity lies above that along the reference.
        let first = reduced.update(self.pools.before.as_ref(), &self.settings)?.0.values;
        if let Some(noise) = noise_along(model, run, along, &first, highest)? {
            if self.kind != FirstOrder::Effort {
                reduced.equations.set_variance(own, &noise.variance);
            }
            if let Some((shifts, uncertainty)) = &noise.shifts {
                reduced.shift_means(shifts, &first, *uncertainty);
            }
        }
        self.last = Some(reduced);
        Ok(())
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        let Some(reduced) = &mut self.last else { return Ok(None) };
        match reduced.update(self.pools.before.as_ref(), &self.settings) {
            Ok((estimate, pool)) => {
                self.pools.after = Some(pool);
                Ok(Some(estimate))
            }
            Err(error) => {
                self.last = None;
                Err(error)
            }
        }
    }

    fn harmonics(&self) -> usize {
        self.harmonics
    }
}

impl Reduced {
    /// The estimate from these equations beside a pool, and the pool with them.
    fn update(&mut self, before: Option<&Pool>, settings: &Settings) -> Result<(Estimate, Pool), EstimateError> {
        self.complete();
        pool_run(before, &self.equations, settings, &self.parameters)
    }
}

/// The harmonics that belong to an experiment with this motion: up to four times its highest.
fn reach(motion: &Trajectory) -> usize {
    4 * motion.highest_harmonic() as usize
}

/// Harmonics to use: as asked, or those of the experiment, as far as the record resolves them.
pub(super) fn highest_harmonic(settings: &Settings, run: &Run<'_>) -> usize {
    settings.harmonics.unwrap_or(reach(&run.trial.trajectory)).min(run.spectra.highest()).max(1)
}

/// What linearised runs have taught.
#[derive(Clone)]
pub(super) struct Pool {
    information: Information,
    /// Relative distance from the parameters of the last run's feed-forward to its estimate.
    distance: f64,
}

/// What all runs but the last one have taught, and what all have.
#[derive(Default)]
pub(super) struct Pools {
    pub(super) before: Option<Pool>,
    pub(super) after: Option<Pool>,
}

impl Pools {
    /// Another run follows.
    pub(super) fn close(&mut self) {
        if let Some(after) = self.after.take() {
            self.before = Some(after);
        }
    }
}

/// Distance between the start of a run and its estimate relative to the values: the size of what was linearised. It is
/// never taken below what noise alone makes of it, so that converged runs count alike.
fn distance(start: &[f64], found: &[f64], covariance: &crate::numerics::DMatrix<f64>, inflation: f64) -> f64 {
    start
        .iter()
        .zip(found)
        .enumerate()
        .map(|(j, (before, now))| {
            let noise = INSIGNIFICANT * (inflation * covariance[(j, j)]).max(0.0).sqrt();
            (now - before).abs().max(noise) / now.abs().max(f64::MIN_POSITIVE)
        })
        .fold(0.0, f64::max)
}

/// Adds a run's equations to the pool and solves it.
pub(super) fn pool_run(
    pool: Option<&Pool>,
    equations: &Equations,
    settings: &Settings,
    current: &[f64],
) -> Result<(Estimate, Pool), EstimateError> {
    let p = equations.parameters;
    let free = settings.free(p)?;
    let mut prior = if settings.prior.len() == p { settings.prior.clone() } else { current.to_vec() };
    settings.hold(&mut prior);
    let information = Information::of(equations.weighted(&free.indices, &settings.frozen));
    let start = free.of(&prior);
    let alone = information.solve(&start, None);
    let freedom = equations.real_len().saturating_sub(alone.rank);
    let chi_squared = if freedom > 0 { alone.remainder / freedom as f64 } else { 0.0 };
    let inflation = chi_squared.max(1.0);
    let own = information.forget(1.0 / inflation);
    let distance = distance(&free.of(current), &alone.values, &alone.covariance, inflation);
    let pooled = match pool {
        Some(before) => {
            let trust = (distance / before.distance).powi(2);
            let trust = if trust.is_finite() { trust.min(1.0) } else { 1.0 };
            before.information.clone().forget(trust * settings.memory(1)).pool(&own)
        }
        None => own,
    };
    let scaled = pooled.scaled();
    let solution = scaled.solve(&start, None, &[]);
    let mut values = prior;
    let mut std = vec![0.0; p];
    let mut status = vec![Status::Frozen; p];
    let covariance = free.spread_square(&solution.covariance);
    let touched = scaled.touched(&solution.unobservable);
    free.put(&solution.values, &mut values);
    for (a, &j) in free.indices.iter().enumerate() {
        (std[j], status[j]) = if touched[a] {
            (f64::INFINITY, Status::Unobservable)
        } else {
            let std = covariance[(j, j)].max(0.0).sqrt();
            (std, if std > POOR * values[j].abs() { Status::PoorlyDetermined } else { Status::Identified })
        };
    }
    let unobservable = solution.unobservable.iter().map(|direction| free.spread(direction)).collect();
    let (left, whole) = (0..equations.len()).fold((0.0, 0.0), |(left, whole), e| {
        (left + equations.residual(e, &values).norm_sqr(), whole + equations.right[e].norm_sqr())
    });
    let estimate = Estimate {
        values,
        std,
        covariance,
        status,
        rank: solution.rank,
        unobservable,
        condition: scaled.condition(&[]),
        residual: if whole > 0.0 { (left / whole).sqrt() } else { 0.0 },
        chi_squared,
        model_error: vec![0.0; equations.row.iter().max().map_or(0, |r| r + 1)],
    };
    Ok((estimate, Pool { information: pooled, distance }))
}
