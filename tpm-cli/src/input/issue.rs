//! Who writes a report, when, and for what.

use std::time::{SystemTime, UNIX_EPOCH};
use tpm_runtime::document::Issue;

/// Options that say it.
#[derive(Clone, clap::Args)]
pub(crate) struct IssueArgs {
    /// What the report is about, such as the name and number of the machine; stands at its top.
    #[arg(long, value_name = "TEXT", requires = "report")]
    title: Option<String>,
    /// Who writes the report.
    #[arg(long, value_name = "NAME", requires = "report")]
    author: Option<String>,
}

impl IssueArgs {
    /// What stands at the top of a report that is written now.
    pub(crate) fn now(&self) -> Issue {
        Issue { title: self.title.clone(), author: self.author.clone(), date: today() }
    }
}

/// The day in UTC, or that of `SOURCE_DATE_EPOCH`, by which whoever needs it gets the same bytes again; nothing where the clock is set to
/// a time before 1970.
fn today() -> Option<String> {
    let stated = std::env::var("SOURCE_DATE_EPOCH").ok().and_then(|seconds| seconds.parse::<i64>().ok());
    let now =
        || SystemTime::now().duration_since(UNIX_EPOCH).ok().and_then(|since| i64::try_from(since.as_secs()).ok());
    let time = chrono::DateTime::from_timestamp(stated.or_else(now)?, 0)?;
    Some(time.date_naive().to_string())
}
