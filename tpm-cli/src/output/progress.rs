//! Progress of long work on standard error, shown only on a terminal and only when the work takes long.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::{Duration, Instant};

/// Longest work that shows no progress.
const PATIENCE: Duration = Duration::from_millis(500);
/// Longest search, of which nobody knows how far it has come, that does not say that it goes on.
const SILENT: Duration = Duration::from_secs(2);
/// Time from one look of a spinner to the next.
const TICK: Duration = Duration::from_millis(200);

/// A line for work of which nobody knows how far it has come, which goes away when dropped.
pub(crate) struct Busy {
    bar: ProgressBar,
    started: Instant,
    /// Whether the line was asked for already; without a terminal it stays invisible.
    shown: bool,
}

impl Busy {
    /// A line for work that is just beginning.
    pub(crate) fn new(what: &'static str) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        if let Ok(style) =
            ProgressStyle::with_template("{spinner} {msg}, {elapsed}; Ctrl-C ends it with what is known by then")
        {
            bar.set_style(style);
        }
        bar.set_message(what);
        Self { bar, started: Instant::now(), shown: false }
    }

    /// Shows the line if the work has taken long.
    pub(crate) fn show(&mut self) {
        if !self.shown && self.started.elapsed() > SILENT {
            self.shown = true;
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
            self.bar.enable_steady_tick(TICK);
        }
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// A progress bar that goes away when dropped.
pub(crate) struct Bar {
    bar: ProgressBar,
    started: Instant,
}

impl Bar {
    /// A bar for work that is just beginning.
    pub(crate) fn new(what: &'static str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::hidden());
        if let Ok(style) = ProgressStyle::with_template("{msg} {bar:40} {percent} %, {eta} left") {
            bar.set_style(style);
        }
        bar.set_message(what);
        Self { bar, started: Instant::now() }
    }

    /// Shows how far the work has come.
    pub(crate) fn set(&self, done: u64, total: u64) {
        if self.bar.is_hidden() && self.started.elapsed() > PATIENCE {
            // Draws nothing unless standard error is a terminal.
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        self.bar.set_length(total);
        self.bar.set_position(done);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
