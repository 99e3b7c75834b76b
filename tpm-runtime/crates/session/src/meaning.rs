//! What findings mean for a result: one row for every kind.

use crate::warning::Warning;
use serde::{Deserialize, Serialize};
use std::slice;

/// What a finding means for the numbers of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Values and deviations hold.
    Remark,
    /// The model leaves something of what was measured unexplained; deviations contain what that does to the values.
    Misfit,
    /// Values of the parameters that it concerns are not to be trusted, and the result is not complete.
    Distrust,
}

/// What a finding is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum About {
    /// How a log was read.
    Reading,
    /// The record, and how the model explains it.
    Record,
    /// What the data show of the parameters.
    Parameters,
    /// How the estimation went.
    Estimation,
    /// The runs of a campaign.
    Campaign,
}

/// The parameters that a finding concerns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Concern<'a> {
    /// None in particular.
    Nothing,
    /// These, by name.
    Parameters(&'a [String]),
    /// All.
    All,
}

impl<'a> Concern<'a> {
    /// One parameter.
    const fn one(name: &'a String) -> Self {
        Concern::Parameters(slice::from_ref(name))
    }

    /// Whether a parameter is among them.
    #[must_use]
    pub fn includes(&self, name: &str) -> bool {
        match self {
            Concern::Nothing => false,
            Concern::Parameters(names) => names.iter().any(|own| own == name),
            Concern::All => true,
        }
    }
}

/// What a kind of finding means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Meaning<'a> {
    /// How grave it is.
    pub severity: Severity,
    /// What it is about.
    pub about: About,
    /// The parameters that it concerns.
    pub concern: Concern<'a>,
}

impl Warning {
    /// What the finding means: one row for every kind.
    #[must_use]
    pub fn meaning(&self) -> Meaning<'_> {
        use About::{Campaign, Estimation, Parameters, Reading, Record};
        use Concern::{All, Nothing};
        use Severity::{Distrust, Misfit, Remark};
        let (severity, about, concern) = match self {
            Warning::OnePeriod => (Remark, Reading, Nothing),
            Warning::PeriodNotUsed { .. } => (Remark, Reading, Nothing),
            Warning::AllCoordinates { .. } => (Remark, Reading, Nothing),
            Warning::RepeatedReadings { .. } => (Remark, Reading, Nothing),
            Warning::OnlyTogether { .. } => (Remark, Reading, Nothing),
            Warning::LoneReadings { .. } => (Remark, Reading, Nothing),
            Warning::OtherHold { .. } | Warning::LateByHold { .. } => (Remark, Record, Nothing),
            Warning::Exchanged { .. } => (Distrust, Record, All),
            Warning::Astray { .. } => (Distrust, Record, All),
            Warning::BeyondNoise { .. } => (Distrust, Record, All),
            Warning::ScaleUnknown { .. } => (Distrust, Record, All),
            Warning::UnseenFaults { .. } => (Remark, Record, Nothing),
            Warning::RateDiffers { .. } => (Remark, Record, Nothing),
            Warning::Unsteady { .. } => (Remark, Record, Nothing),
            Warning::MostlyLeftOut { .. } => (Remark, Record, Nothing),
            Warning::HarmonicsLeftOut { .. } => (Remark, Record, Nothing),
            Warning::Unexplained { .. } => (Distrust, Record, All),
            Warning::MissingTerm { .. } => (Misfit, Record, Nothing),
            Warning::Limited { .. } => (Remark, Record, Nothing),
            Warning::Halves { parameter, .. } => (Distrust, Record, Concern::one(parameter)),
            Warning::Unsettled { .. } => (Distrust, Record, All),
            Warning::Repeats { .. } => (Misfit, Record, Nothing),
            Warning::Vibration { .. } => (Misfit, Record, Nothing),
            Warning::NotVisible { parameter, .. } => (Remark, Parameters, Concern::one(parameter)),
            Warning::PoorlyDetermined { parameter, .. } => (Remark, Parameters, Concern::one(parameter)),
            Warning::OnlyInCombinations { parameters, .. } => (Remark, Parameters, Concern::Parameters(parameters)),
            Warning::Physical { remark } => (Remark, Parameters, Concern::Parameters(remark.parameters())),
            Warning::NegativeInertia { parameter, .. } => (Distrust, Estimation, Concern::one(parameter)),
            Warning::GivesEnergy { parameter, .. } => (Distrust, Estimation, Concern::one(parameter)),
            Warning::CommonFactor { .. } => (Distrust, Record, All),
            Warning::GoesAgainst { parameter, .. } => (Distrust, Estimation, Concern::one(parameter)),
            Warning::FarFromLinear { .. } => (Distrust, Estimation, All),
            Warning::EndOfInterval { .. } => (Distrust, Estimation, All),
            Warning::SeveralMinima { parameter, .. } => (Remark, Estimation, Concern::one(parameter)),
            Warning::TakenAsKnown { parameter, .. } => (Remark, Estimation, Concern::one(parameter)),
            Warning::LongSimulation(_) => (Remark, Estimation, Nothing),
            // What the values before the simulation leave was to be explained by it.
            Warning::NotRefined { reason } if reason.is_cut() => (Distrust, Estimation, Nothing),
            Warning::NotRefined { .. } => (Remark, Estimation, Nothing),
            // The values hold, and are not what was asked for.
            Warning::AskedInVain { .. } => (Distrust, Estimation, Nothing),
            Warning::LogsDisagree { .. } => (Distrust, Estimation, All),
            // More logs say what the result says.
            Warning::OddLog { .. } => (Remark, Estimation, Nothing),
            Warning::Run { .. } => (Remark, Campaign, Nothing),
            Warning::Contradicts { majority: true, .. } => (Remark, Campaign, Nothing),
            // As many runs say one thing as another.
            Warning::Contradicts { majority: false, .. } => (Distrust, Campaign, All),
            Warning::NearMode { .. } => (Remark, Campaign, Nothing),
            Warning::EndedEarly { .. } => (Remark, Campaign, Nothing),
            Warning::RotorIncluded { .. } => (Remark, Campaign, Nothing),
            Warning::NothingAccepted => (Remark, Campaign, Nothing),
            Warning::InLog { warning, .. } => return warning.meaning(),
        };
        Meaning { severity, about, concern }
    }

    /// Whether values that follow from such data are not to be trusted.
    #[must_use]
    pub fn is_distrust(&self) -> bool {
        self.meaning().severity == Severity::Distrust
    }
}
