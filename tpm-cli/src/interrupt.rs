//! Signals. Ctrl-C: long work that polls for it stops cleanly, anything else ends at once, and a second Ctrl-C always does. The limit of a
//! file's size: writing fails, and the program goes on to say so.

use crate::output::progress;
use cpu_time::ProcessTime;
use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};
use tpm_runtime::numerics::patience;

thread_local! {
    static SEARCH: RefCell<Option<Search>> = const { RefCell::new(None) };
}

/// A search that runs patiently.
struct Search {
    /// How much of the processor it may take, s.
    limit: f64,
    began: Option<ProcessTime>,
    busy: progress::Busy,
}

static REQUESTED: AtomicBool = AtomicBool::new(false);
static WATCHED: AtomicBool = AtomicBool::new(false);

/// Installs the handler. Where signals cannot be handled, the default stays, which ends the program at once.
pub(crate) fn install() {
    outlive_the_largest_file();
    end_without_memory();
    let _ = ctrlc::set_handler(|| {
        let again = REQUESTED.swap(true, Ordering::SeqCst);
        if again || !WATCHED.load(Ordering::SeqCst) {
            std::process::exit(130);
        }
    });
}

/// Lets a write beyond the limit of a file's size (`ulimit -f`) fail instead of ending the program, which would leave the file half
/// written. The signal only has to be handled; the write says what is wrong.
fn outlive_the_largest_file() {
    #[cfg(unix)]
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
}

/// Lets a program without memory end as bad input does. An allocation that the system or a limit (`ulimit -v`) refuses says so on standard
/// error and aborts, and an abort would be told as a crash.
fn end_without_memory() {
    #[cfg(unix)]
    let _ = signal_hook::flag::register_conditional_shutdown(
        signal_hook::consts::SIGABRT,
        2,
        std::sync::Arc::new(AtomicBool::new(true)),
    );
}

/// Runs a search that ends with what it has when the user asks to stop, or when the program has taken so much of the processor, s; where it goes
/// on, that is said on a terminal.
pub(crate) fn patient<T>(seconds: Option<f64>, what: &'static str, work: impl FnOnce() -> T) -> T {
    let limit = seconds.unwrap_or(f64::INFINITY);
    SEARCH.set(Some(Search { limit, began: ProcessTime::try_now().ok(), busy: progress::Busy::new(what) }));
    let result = watched(|_| patience::within(is_over, work));
    SEARCH.take();
    result
}

/// Whether the search that runs patiently is to end.
fn is_over() -> bool {
    SEARCH.with_borrow_mut(|search| {
        let Some(Search { limit, began, busy }) = search else { return false };
        busy.show();
        let spent = began.and_then(|began| began.try_elapsed().ok());
        requested() || spent.is_some_and(|spent| spent.as_secs_f64() > *limit)
    })
}

/// Whether the user has asked to stop.
pub(crate) fn requested() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}

/// Runs long work that polls the given function, which says whether to go on.
pub(crate) fn watched<T>(work: impl FnOnce(&(dyn Fn() -> bool + Sync)) -> T) -> T {
    WATCHED.store(true, Ordering::SeqCst);
    let result = work(&|| !REQUESTED.load(Ordering::SeqCst));
    WATCHED.store(false, Ordering::SeqCst);
    result
}
