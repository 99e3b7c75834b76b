//! Long work without the interpreter's lock, which Ctrl-C stops.

use crate::words::Fault;
use cpu_time::ProcessTime;
use pyo3::prelude::*;
use std::cell::Cell;
use std::time::{Duration, Instant};
use tpm_runtime::numerics::patience;
use tpm_runtime::session::USUAL_TIME;
use tpm_symbolic::budget::{self, Budget};

/// Time between two looks at what the user wants, each of which takes the interpreter's lock.
const BETWEEN: Duration = Duration::from_millis(50);

thread_local! {
    static LOOKED: Cell<Option<Instant>> = const { Cell::new(None) };
    static ENDS: Cell<Option<(ProcessTime, Duration)>> = const { Cell::new(None) };
    static STOPPED: Cell<bool> = const { Cell::new(false) };
}

/// Whether the user asked to stop; Python tells its main thread alone.
pub(crate) fn requested() -> bool {
    if LOOKED.get().is_none_or(|last| last.elapsed() >= BETWEEN) {
        LOOKED.set(Some(Instant::now()));
        // The signal is taken by this look, and raised again when the work has stopped.
        STOPPED.set(STOPPED.get() || Python::attach(|py| py.check_signals().is_err()));
    }
    STOPPED.get()
}

/// How much a piece of work may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Limit {
    /// Models of usual size.
    None,
    /// Models of any size.
    Large,
    /// Of the processor, s: a search that has not settled by then ends with what it has.
    Time(f64),
}

impl Limit {
    /// The time that was given, or the usual one.
    pub(crate) fn of(time: Option<f64>) -> Self {
        Limit::Time(time.unwrap_or(USUAL_TIME))
    }

    /// Models of any size, or of usual size.
    pub(crate) fn large(allowed: bool) -> Self {
        if allowed { Limit::Large } else { Limit::None }
    }
}

/// Whether a search is to end: the user asked to stop, or its time is over.
fn is_over() -> bool {
    let spent = ENDS.get().is_some_and(|(began, limit)| began.try_elapsed().is_ok_and(|spent| spent > limit));
    spent || requested()
}

/// Does work without the interpreter's lock, within the budget of models of usual size or, if asked, without one.
pub(crate) fn detached<T: Send>(
    py: Python<'_>,
    limit: Limit,
    work: impl FnOnce() -> Result<T, Fault> + Send,
) -> PyResult<T> {
    let done = py.detach(|| {
        STOPPED.set(false);
        let time = if let Limit::Time(seconds) = limit { Duration::try_from_secs_f64(seconds).ok() } else { None };
        ENDS.set(ProcessTime::try_now().ok().zip(time));
        let budget = if limit == Limit::Large { Budget::large() } else { Budget::default() };
        let done = budget::run(budget.stopped_by(requested), || patience::within(is_over, work));
        if STOPPED.take() { Err(Fault::Interrupted) } else { done.map_err(Fault::from).and_then(|done| done) }
    });
    done.map_err(PyErr::from)
}
