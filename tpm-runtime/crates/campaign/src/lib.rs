//! The five-step procedure (Feng, chapter 3) as a state machine: the next trial, the test of settling, the update of
//! the estimates, the stopping rules, and the files in which runs are stored.
//!
//! ```text
//! Setup -> Campaign --next--> Trial -> (plant or machine) -> Record --submit--> Estimate, next Trial
//! ```

mod cut;
mod harmonics;
mod information;
mod lock;
mod modes;
mod plan;
mod procedure;
mod refinement;
mod settling;
mod setup;
mod steady;
mod store;
#[cfg(test)]
mod system_a;
mod wire;

pub use harmonics::{Lines, RunHarmonics};
pub use information::{LEAST_NOISE, run_information, sensor_deviations, strayed};
pub use lock::Lock;
pub use modes::NearMode;
pub use modes::near_mode;
pub use plan::{Advice, Room, combined_multiples, first_stage};
pub use procedure::{Campaign, CampaignError, Contradiction, Outcome, RunParameter, RunReport};
pub use refinement::Refinement;
pub use settling::settled_from;
pub use setup::{LEAST_PERIODS, Plan, Procedure, Setup, Stage, StageStroke};
pub use steady::SteadyRun;
pub use store::{LogFingerprints, Manifest, RunManifest, Store, StoreError, samples_text};
pub use store::{read_json, write_json};
pub use tpm_motion::{GainManifest, Law, RUN_FILE, Rate, RunFile, Timing};
pub use wire::{WireError, read_trial, trial_columns, trial_samples};
