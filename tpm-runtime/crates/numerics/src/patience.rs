//! Whether anybody still waits: long searches ask between their steps, and end with what they have.
//!
//! Invariant: the answer belongs to a thread, that which began the work. Searches ask on it, between what they pass to others.

use std::cell::Cell;

thread_local! {
    static STOP: Cell<Option<fn() -> bool>> = const { Cell::new(None) };
}

/// Does work whose searches end as soon as `stop` returns true.
///
/// ```
/// use tpm_numerics::patience;
/// assert!(patience::within(|| true, patience::is_over));
/// assert!(!patience::is_over());
/// ```
pub fn within<T>(stop: fn() -> bool, work: impl FnOnce() -> T) -> T {
    let outer = STOP.replace(Some(stop));
    let done = work();
    STOP.set(outer);
    done
}

/// Whether the search that asks is to end; never where nobody said how long it may take.
#[must_use]
pub fn is_over() -> bool {
    STOP.get().is_some_and(|stop| stop())
}
