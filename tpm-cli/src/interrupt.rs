//! Ctrl-C: long work that polls for it stops cleanly, anything else ends at once.

use std::sync::atomic::{AtomicBool, Ordering};

static REQUESTED: AtomicBool = AtomicBool::new(false);
static WATCHED: AtomicBool = AtomicBool::new(false);

/// Installs the handler. Where signals cannot be handled, the default stays, which ends the program at once.
pub(crate) fn install() {
    let _ = ctrlc::set_handler(|| {
        let again = REQUESTED.swap(true, Ordering::SeqCst);
        if again || !WATCHED.load(Ordering::SeqCst) {
            std::process::exit(130);
        }
    });
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
