//! Long work without the interpreter's lock, which Ctrl-C stops.

use crate::words::Fault;
use pyo3::prelude::*;
use std::cell::Cell;
use std::time::{Duration, Instant};
use tpm_runtime::numerics::patience;
use tpm_symbolic::budget::{self, Budget};

/// Time between two looks at what the user wants, each of which takes the interpreter's lock.
const BETWEEN: Duration = Duration::from_millis(50);

thread_local! {
    static LOOKED: Cell<Option<Instant>> = const { Cell::new(None) };
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

/// Does work without the interpreter's lock, within the budget of models of usual size or, if asked, without one.
pub(crate) fn detached<T: Send>(
    py: Python<'_>,
    allow_large: bool,
    work: impl FnOnce() -> Result<T, Fault> + Send,
) -> PyResult<T> {
    let done = py.detach(|| {
        STOPPED.set(false);
        let budget = if allow_large { Budget::large() } else { Budget::default() };
        let done = budget::run(budget.stopped_by(requested), || patience::within(requested, work));
        if STOPPED.take() { Err(Fault::Interrupted) } else { done.map_err(Fault::from).and_then(|done| done) }
    });
    done.map_err(PyErr::from)
}
