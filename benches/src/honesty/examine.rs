//! Plays, records and identifies the logs of cases.

use crate::honesty::cases::Case;
use crate::honesty::identify::{Outcome, identify, parse, write};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::error::Error;
use std::path::Path;

/// A case with what the user is told of each of its logs.
#[derive(Clone, Debug)]
pub struct Examined {
    /// The case.
    pub case: Case,
    /// One outcome a log.
    pub outcomes: Vec<Outcome>,
}

/// Examines those of the cases whose name contains the words, each with so many logs, or with its own number. A case has the same noise
/// whichever others are examined. `progress` gets the name of every case before it begins. Where a folder to keep them is named, every log is
/// written there, with the number of its case and its own.
///
/// # Errors
/// Any error of the file system, and the faults of a model.
pub fn examine(
    cases: Vec<Case>,
    words: &str,
    logs: Option<u32>,
    keep: Option<&Path>,
    progress: &dyn Fn(&str),
) -> Result<Vec<Examined>, Box<dyn Error>> {
    let mut examined = Vec::new();
    for (number, case) in cases.into_iter().enumerate().filter(|(_, case)| case.name.contains(words)) {
        progress(case.name);
        let model = parse(case.model.text())?;
        let one = |log: u32| {
            let seed = (number as u64) << 32 | u64::from(log);
            let mut recording = case.rig.play(seed);
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            // The rig draws from the first stream of the seed.
            rng.set_stream(1);
            (case.spoil)(&mut recording, &mut rng);
            if let Some(folder) = keep {
                write(&folder.join(format!("case-{number}-log-{log}.csv")), &recording)?;
            }
            identify(&model, &recording, case.hold)
        };
        let outcomes = (0..logs.unwrap_or(case.logs)).into_par_iter().map(one).collect::<Result<Vec<Outcome>, _>>()?;
        examined.push(Examined { case, outcomes });
    }
    Ok(examined)
}
