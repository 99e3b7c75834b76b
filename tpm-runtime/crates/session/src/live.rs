//! A campaign in a folder on a machine that is at hand: what [`CampaignFolder::next`] and [`CampaignFolder::submit`] do by files, run
//! after run until the campaign ends.

use crate::error::SessionError;
use crate::folder::CampaignFolder;
use crate::identification::Identification;
use crate::play::Watch;
use std::time::Duration;
use tpm_campaign::Lock;
use tpm_motion::Bench;
use tpm_plant::process::{ProcessMachine, ProcessSettings};

impl CampaignFolder {
    /// Plays what is left of the campaign on a machine. Every run is kept in the folder as it ends, so that a campaign that breaks off
    /// anywhere goes on from its finished runs, and gives the result of the unbroken one.
    ///
    /// # Errors
    /// [`SessionError`]; [`SessionError::Bench`] when the machine fails.
    pub fn play(&self, bench: &mut dyn Bench, watch: &mut Watch<'_>) -> Result<Identification, SessionError> {
        let _lock = Lock::hold(self.store().folder())?;
        self.session().identify_on(bench, Some(self.store()), watch)
    }

    /// The machine behind a program that speaks [`PROTOCOL`](tpm_plant::process::PROTOCOL), for this campaign. `timeout` is the
    /// longest wait for a line; once `go_on` says no, the machine is told to stop.
    ///
    /// # Errors
    /// [`SessionError::Experiment`].
    pub fn machine<'a>(
        &'a self,
        command: String,
        timeout: Duration,
        go_on: &'a dyn Fn() -> bool,
    ) -> Result<ProcessMachine<'a>, SessionError> {
        let session = self.session();
        let settle_periods = session.campaign()?.0.setup().procedure.settle_periods;
        let settings = ProcessSettings { command, timeout, settle_periods };
        Ok(ProcessMachine::new(session.machine().plant(), settings, go_on))
    }
}
