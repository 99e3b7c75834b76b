//! The campaign on the controller: what its code needs beside the estimator of a run, and what it says of itself.

use tpm_symbolic::expr::graph::Coordinate;
use tpm_symbolic::plan::straight_line::Plan;

use super::estimator::EstimatorSource;

/// The documentation of a campaign.
pub(super) const CAMPAIGN: &str = "A whole campaign on the controller: the machine identifies itself. At every sample [`Self::command`] gives reference and feed-forward, the\n\
     controller adds its feedback and applies the sum, and [`Self::push`] takes the sample in. When a run is whole, [`Self::update`] is due;\n\
     all runs are pooled by what they show. Runs begin with the first stage, pass smoothly from one pattern to the next, settle, and are\n\
     measured; a run that meets a limit is given up for a smaller one, and the campaign ends with a reason.";

/// What a campaign needs.
#[derive(Clone, Debug)]
pub(super) struct CampaignPlan<'a> {
    reconstructions: &'a [(Coordinate, Plan)],
}

impl<'a> CampaignPlan<'a> {
    /// Of a model whose campaign was requested.
    pub(super) fn of(estimator: &'a EstimatorSource) -> Option<Self> {
        let reconstructions = estimator.campaign.as_deref()?;
        Some(Self { reconstructions })
    }

    /// The plan of an eliminated coordinate from the motion of the others.
    pub(super) fn reconstruction(&self, coordinate: Coordinate) -> Option<&'a Plan> {
        self.reconstructions.iter().find(|(of, _)| *of == coordinate).map(|(_, plan)| plan)
    }
}
