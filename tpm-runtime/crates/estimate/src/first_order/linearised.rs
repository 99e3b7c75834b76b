//! `error`, `effort` and `hill` over all runs of a campaign.

use crate::along::Along;
use crate::applies::{check_inputs, check_reference};
use crate::damping::Damping;
use crate::designs::Designs;
use crate::error::EstimateError;
use crate::estimator::Estimator;
use crate::first_order::reduce::{FirstOrder, Reduced};
use crate::noise::noise_along;
use crate::result::Estimate;
use crate::run::Run;
use crate::settings::Settings;
use crate::stack::solve_reweighted;
use crate::table::LineTable;
use std::sync::Arc;
use tpm_controller::model::Model;
use tpm_motion::Trial;
use tpm_motion::trajectory::Trajectory;

/// One of the estimators `error`, `effort` and `hill`, over all runs.
///
/// The latest run is linearised at the parameters of its feed-forward, earlier ones and a run that got worse at the estimate, so that
/// what a run far from the truth left out of its linearisation does not stay.
pub(crate) struct Linearised {
    kind: FirstOrder,
    /// Nothing moves along the directions that are hidden here, those that no reference shows so far.
    settings: Settings,
    designs: Designs,
    table: Option<Arc<dyn LineTable>>,
    /// The runs so far, reduced.
    runs: Vec<Reduced>,
    /// Whether the last run was reduced.
    ready: bool,
    /// The last estimate.
    estimate: Option<Estimate>,
    damping: Damping,
    /// Whether the last run tracks best so far on its reference.
    better: bool,
    /// The rows along the reference of the last run, which is often that of the next run too.
    reference: Option<Reference>,
    harmonics: usize,
}

impl Linearised {
    /// The estimator before any run.
    pub(crate) fn new(kind: FirstOrder, settings: &Settings, table: Option<Arc<dyn LineTable>>) -> Self {
        Linearised {
            kind,
            settings: settings.clone(),
            designs: Designs::default(),
            table,
            runs: Vec::new(),
            ready: false,
            estimate: None,
            damping: Damping::default(),
            better: true,
            reference: None,
            harmonics: 0,
        }
    }

    /// The estimate from all runs, `latest` behind the others.
    ///
    /// What a linearisation leaves out follows from the parameters, so that the equations are weighted at their own solution.
    fn solve(&self, latest: Option<&Reduced>) -> Result<Estimate, EstimateError> {
        let runs: Vec<&Reduced> = self.runs.iter().chain(latest).collect();
        let current = runs.last().map_or(&[][..], |run| run.parameters.as_slice());
        let others = |run: &&Reduced| runs.iter().filter(|other| other.repeats(run)).count() - 1;
        let others: Vec<usize> = runs.iter().map(others).collect();
        solve_reweighted(&self.settings, current, |theta| {
            let of = |(i, (run, others)): (usize, (&&Reduced, &usize))| {
                run.weighted(theta, self.better && i + 1 == runs.len(), *others)
            };
            runs.iter().zip(&others).enumerate().map(of).collect()
        })
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
    fn new(
        model: &dyn Model<f64>,
        trial: &Trial,
        highest: usize,
        table: Option<&dyn LineTable>,
    ) -> Result<Self, EstimateError> {
        let along = Along::of_trial(model, trial, highest, table)?;
        let (trajectory, constants) = (trial.trajectory.clone(), trial.constants.clone());
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

    fn check(&self, model: &dyn Model<f64>, first: &Trial, _runs: usize) -> Result<(), EstimateError> {
        if self.kind == FirstOrder::Effort {
            return check_inputs(model, first);
        }
        check_reference(model, first, self.name())
    }

    fn play(&self, current: &[f64]) -> Vec<f64> {
        self.damping.towards(current)
    }

    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        self.ready = false;
        let highest = run.highest_harmonic(&self.settings);
        let reference = match self.reference.take().filter(|reference| reference.is_of(run.trial, highest)) {
            Some(reference) => reference,
            None => {
                let reference = Reference::new(model, run.trial, highest, self.table.as_deref())?;
                self.settings = self.designs.take(model, run.trial, &self.settings)?;
                reference
            }
        };
        let along = &self.reference.insert(reference).along;
        let mut reduced = match run.rates {
            None => self.kind.reduce(model, run.trial, along, run.spectra, run.hold, highest)?,
            Some(_) => self.kind.reduce_applied(model, run.trial, along, run.spectra, run.hold, (0, highest))?,
        };
        let own = reduced.equations.len();
        // `effort` does not use the error, so that an error from rates adds no equation.
        if let Some(rates) = run.rates.filter(|_| self.kind != FirstOrder::Effort) {
            reduced.append(self.kind.reduce_applied(model, run.trial, along, rates, run.hold, (1, highest))?);
        }
        self.harmonics = highest;
        let (size, noise) = reduced.tracking();
        self.better = self.damping.judge(run.trial, size, noise);
        // Noise is worked out at a first estimate: the parameters say how strongly the rows feel it, and how far it shifts the mean
        // of a term that is even in the velocity.
        let first = self.solve(Some(&reduced))?.values;
        let along = &self.reference.as_ref().expect("invariant: the reference was just kept").along;
        if let Some(noise) = noise_along(model, run, along, &first, highest)? {
            if self.kind != FirstOrder::Effort {
                reduced.set_noise(own, &noise.variance, &noise.repeated);
            }
            if let Some((shifts, uncertainty)) = &noise.shifts {
                reduced.shift_means(shifts, &first, *uncertainty);
            }
        }
        // Older runs count less and less where runs are forgotten.
        let kept = self.settings.kept(self.runs.len());
        self.runs.drain(..self.runs.len() - kept);
        self.runs.push(reduced);
        self.ready = true;
        Ok(())
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        if !self.ready {
            return Ok(None);
        }
        match self.solve(None) {
            Ok(estimate) => {
                self.estimate = Some(estimate.clone());
                Ok(Some(estimate))
            }
            Err(error) => {
                self.runs.pop();
                self.ready = false;
                Err(error)
            }
        }
    }

    fn take_back(&mut self) -> bool {
        self.damping.take_back()
    }

    fn is_final(&self) -> bool {
        let of_noise = |(run, estimate): (&Reduced, &Estimate)| run.is_of_noise(&estimate.values);
        !self.damping.is_damped() && self.runs.last().zip(self.estimate.as_ref()).is_none_or(of_noise)
    }

    fn harmonics(&self) -> usize {
        self.harmonics
    }
}
