//! Signals. Ctrl-C: long work that polls for it stops cleanly, anything else ends at once, and a second Ctrl-C always does. The limit of a
//! file's size: writing fails, and the program goes on to say so.

use std::sync::atomic::{AtomicBool, Ordering};

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
