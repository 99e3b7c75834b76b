//! Optional parts of the code that are emitted on request, and their plans.

use thiserror::Error;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::tree::mechanism::Mechanism;
use tpm_symbolic::plan::base::{BasePlan, BasePlanError};
use tpm_symbolic::plan::dynamics::Dynamics;
use tpm_symbolic::plan::estimator::{EstimatorPlan, TooLong};
use tpm_symbolic::plan::forces;
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::regressor::form::RegressorForm;

/// The least and the most harmonics that the estimator of a run has memory for.
pub(super) const RUN_HARMONICS: [usize; 2] = [12, 32];

/// An optional part of the code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Part {
    /// The feed-forward split into its motion-independent and its motion-dependent part, even where the equations must
    /// be multiplied out for it.
    Split,
    /// The forces at rest.
    Gravity,
    /// The mass matrix: the factors of the highest derivatives of the coordinates.
    MassMatrix,
    /// The highest derivatives of the coordinates from the inputs.
    ForwardDynamics,
    /// The regressor in base parameters, and the base parameters from the estimated ones.
    BaseRegressor,
    /// A recursive estimator of the base parameters; it includes [`Self::BaseRegressor`].
    Estimator,
    /// An estimator of the declared parameters from the samples of one run of a periodic motion.
    Run,
    /// Estimators of a run that are linearised about its reference (`error` and `hill`), over the estimator of a run, which they include.
    Linearised,
    /// An estimator from differences of runs (`numerical`), over the estimator of a run, which it includes.
    Numerical,
    /// A whole campaign, run by run, over the estimator of a run, which it includes.
    Campaign,
    /// A test whether the machine is still the one that was identified, over the estimator of base parameters, which it includes.
    Monitor,
}

impl Part {
    /// All of them, in the order of the code.
    pub const ALL: [Self; 11] = [
        Self::Split,
        Self::Gravity,
        Self::MassMatrix,
        Self::ForwardDynamics,
        Self::BaseRegressor,
        Self::Estimator,
        Self::Run,
        Self::Linearised,
        Self::Numerical,
        Self::Campaign,
        Self::Monitor,
    ];

    /// The name of the part in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Split => "split",
            Self::Gravity => "gravity",
            Self::MassMatrix => "mass_matrix",
            Self::ForwardDynamics => "forward_dynamics",
            Self::BaseRegressor => "base_regressor",
            Self::Estimator => "estimator",
            Self::Run => "run",
            Self::Linearised => "linearised",
            Self::Numerical => "numerical",
            Self::Campaign => "campaign",
            Self::Monitor => "monitor",
        }
    }

    /// The part of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|part| part.name() == name)
    }
}

/// Why a part cannot be derived from the equations.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PartError {
    /// The equations are too long for the feed-forward to be split.
    #[error(transparent)]
    TooLong(#[from] TooLong),
    /// Parts take inputs that stand alone.
    #[error(
        "the part `{part}` takes inputs that stand alone, and `{input}` stands in a function; without parts there is a feed-forward that solves for it"
    )]
    InputInFunction {
        /// The part.
        part: &'static str,
        /// The input.
        input: String,
    },
    /// The equations do not determine the accelerations.
    #[error(
        "there is no mass matrix: the equations must be as many as the coordinates in them, and affine in the highest derivatives; write an equation for every coordinate, its highest derivative outside of functions"
    )]
    NoDynamics,
    /// No run shows the parameters.
    #[error("there is no estimator of a run: {0}")]
    NoRun(String),
    /// A pattern states more harmonics than the estimator of a run has memory for.
    #[error(
        "a pattern states {stated} harmonics, and the estimator of a run has memory for {most}: state at most so many"
    )]
    Harmonics {
        /// The harmonics that are stated.
        stated: usize,
        /// The most that there is memory for.
        most: usize,
    },
    /// No pattern has strokes.
    #[error("there are no strokes: no pattern of the model gives the motion of its coordinates; declare one that does")]
    NoStrokes,
    /// Nothing is accumulated that could be forgotten.
    #[error(
        "there is nothing to forget: no pattern has accumulators of harmonics, and the part `estimator` was not asked for"
    )]
    NothingForgets,
    /// No campaign can be played.
    #[error("there is no campaign: {0}")]
    NoCampaign(String),
    /// There are no base parameters.
    #[error(transparent)]
    Base(#[from] BasePlanError),
}

/// The plan of the accelerations that inputs give.
#[derive(Clone, Debug)]
pub(super) struct ForwardDynamics {
    /// M row by row and the right-hand side; behind them, where M is symmetric, the pivots of its factors and the accelerations.
    pub(super) plan: Plan,
    /// Whether pivots and accelerations are there.
    pub(super) factored: bool,
}

impl ForwardDynamics {
    fn of(dynamics: Dynamics) -> Self {
        match dynamics.factored() {
            Some(plan) => Self { plan, factored: true },
            None => Self { plan: dynamics.plan, factored: false },
        }
    }
}

/// The plans of the requested parts.
#[derive(Clone, Debug, Default)]
pub(super) struct Parts {
    pub(super) gravity: Option<Plan>,
    pub(super) mass_matrix: Option<Plan>,
    pub(super) forward_dynamics: Option<ForwardDynamics>,
    pub(super) base: Option<BasePlan>,
    pub(super) estimator: bool,
    pub(super) monitor: bool,
    pub(super) linearised: bool,
    pub(super) numerical: bool,
}

impl Parts {
    /// Makes the plans of a part other than [`Part::Split`] and those of runs, whose plans belong to those of every model.
    pub(super) fn add(
        &mut self,
        part: Part,
        model: &ExactModel,
        form: &RegressorForm,
        plan: &EstimatorPlan,
        mechanism: Option<&Mechanism>,
    ) -> Result<(), PartError> {
        let dynamics = || forces::dynamics(model, form, mechanism).ok_or(PartError::NoDynamics);
        match part {
            Part::Split | Part::Run | Part::Linearised | Part::Numerical | Part::Campaign => {}
            Part::Gravity => self.gravity = Some(forces::at_rest(model, form, mechanism)),
            Part::MassMatrix => self.mass_matrix = Some(dynamics()?.mass_matrix()),
            Part::ForwardDynamics => self.forward_dynamics = Some(ForwardDynamics::of(dynamics()?)),
            Part::BaseRegressor | Part::Estimator | Part::Monitor => {
                if self.base.is_none() {
                    self.base = Some(BasePlan::new(model, form, &plan.evaluation)?);
                }
                self.estimator |= part != Part::BaseRegressor;
                self.monitor |= part == Part::Monitor;
            }
        }
        Ok(())
    }

    pub(super) fn plans(&self) -> impl Iterator<Item = &Plan> {
        let dynamics = self.forward_dynamics.iter().map(|dynamics| &dynamics.plan);
        let base = self.base.iter().flat_map(|base| [&base.regressor, &base.lumping]);
        self.gravity.iter().chain(&self.mass_matrix).chain(dynamics).chain(base)
    }
}
