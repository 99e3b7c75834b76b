//! Recordings of what a result makes of its logs, for viewers of robot logs.

use crate::failure::{Failure, Outcome};
use crate::output::{file, writable};
use std::path::Path;
use tpm_runtime::log::Track;
use tpm_runtime::session::{SessionError, Validation};

/// Whether a recording can be written, before anything is computed.
pub(crate) fn possible(path: Option<&Path>) -> Outcome {
    let Some(path) = path else { return Ok(()) };
    writable(Some(path), None)?;
    Track::recorded(&[]).map(drop).map_err(|error| SessionError::from(error).into())
}

/// Writes what is known of logs into an MCAP file, a topic for every kind of signal; of several logs their numbers stand first.
pub(crate) fn write(path: &Path, shown: &[Validation]) -> Outcome {
    let mut tracks = Vec::new();
    for (number, validation) in (1..).zip(shown) {
        let own = validation.tracks();
        if own.is_empty() {
            let why = validation.not_simulated.as_deref().unwrap_or("nothing of it is compared over time");
            file::remark(&format!("remark: {} is not in the recording: {why}", validation.log));
        }
        let beginning = if shown.len() > 1 { format!("log{number}/") } else { String::new() };
        tracks.extend(own.into_iter().map(|track| Track { name: format!("{beginning}{}", track.name), ..track }));
    }
    if tracks.is_empty() {
        return Err(Failure::Incomplete(format!("nothing is there to record, and {} is not written", path.display())));
    }
    let bytes = Track::recorded(&tracks).map_err(SessionError::from)?;
    file::write_file(path, &bytes)
}
