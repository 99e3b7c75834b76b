//! The budget of one run of the engine: how much exact work a model may ask for before it is refused.
//!
//! How much work a model is becomes known only while it is done, deep in the algebra. So every long loop of exact arithmetic says beforehand
//! how many operations on machine words it is about to do ([`charge`]), and [`run`] refuses the model once their sum passes the limit
//! (`DESIGN.md`, "Why does the engine count operations and not seconds?").
//!
//! Arithmetic is written with operators, which cannot return an error. A run that ends is therefore unwound to [`run`]; no panic is
//! raised, no hook is called, and what the work has built is dropped on the way. Without a [`run`] around it the engine has no limit. A
//! program that is built to abort on panics cannot unwind, and ends where a budget does; [`ended`] tells its host why.
//!
//! Invariant: the count belongs to a thread. Work that is passed to other threads has its own bounds.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use thiserror::Error;

/// Default limit of operations on machine words for a model, about a second on a desktop computer. It does not apply
/// where large models are allowed.
pub const OPERATIONS: u64 = 1_000_000_000;

/// Default limit of a table in bytes, about two million entries of ordinary size. It does not apply where large models
/// are allowed.
pub const TABLE_BYTES: u128 = 256_000_000;

/// How many operations pass between two questions whether to go on.
const BETWEEN_QUESTIONS: u32 = 22;

/// Longest name of a term in an error, in characters.
const LONGEST_NAME: usize = 80;

thread_local! {
    /// Number of operations that the current run may still take.
    static LEFT: Cell<u64> = const { Cell::new(u64::MAX) };
    /// The limit of that run, among the current one and the outer ones, which has the fewest operations left.
    static LIMIT: Cell<u64> = const { Cell::new(u64::MAX) };
    static STOP: Cell<Option<fn() -> bool>> = const { Cell::new(None) };
    static LARGE: Cell<bool> = const { Cell::new(false) };
    /// Why the current run is ending.
    static ENDED: Cell<Option<Signal>> = const { Cell::new(None) };
    /// The innermost named work at which the current run ended.
    static ENDED_AT: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Why a run of the engine ended before its result.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Halted {
    /// The work would take more operations than the budget has.
    #[error(
        "{} takes more than the {} million operations on numbers that a model may take; lower its exponents, orders, harmonics or digits, or allow large models",
        at.as_deref().map_or_else(|| "this model".to_owned(), |at| format!("`{at}`")),
        limit / 1_000_000
    )]
    TooLarge {
        /// The term or expression that was worked on, when it is known.
        at: Option<String>,
        /// The operations that the run may take.
        limit: u64,
    },
    /// The caller of the run requested a stop.
    #[error("the work was stopped")]
    Stopped,
}

/// Payload of the unwinding that [`run`] catches.
#[derive(Clone, Copy)]
enum Signal {
    TooLarge,
    Stopped,
}

/// Limits of a run of the engine.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Budget {
    /// Operations on machine words.
    pub operations: u64,
    /// Whether tables may take more than [`TABLE_BYTES`].
    pub large: bool,
    /// Called many times a second; the run stops when it returns true.
    pub stop: Option<fn() -> bool>,
}

impl Default for Budget {
    fn default() -> Self {
        Self { operations: OPERATIONS, large: false, stop: None }
    }
}

impl Budget {
    /// The budget of a user who has allowed large models, without a limit.
    #[must_use]
    pub fn large() -> Self {
        Self { operations: u64::MAX, large: true, stop: None }
    }

    /// The budget of nested work: the operations that the outer run has left.
    #[must_use]
    pub fn of_outer() -> Self {
        Self { operations: u64::MAX, large: false, stop: None }
    }

    /// The budget of a run that stops as soon as `stop` returns true.
    #[must_use]
    pub fn stopped_by(self, stop: fn() -> bool) -> Self {
        Self { stop: Some(stop), ..self }
    }
}

/// Runs work of the engine within a budget. Work inside other work shares the operations of the outer one.
///
/// ```
/// # use tpm_symbolic::{budget::{self, Budget}, number::rational::integer};
/// let mut few = Budget::default();
/// few.operations = 10;
/// assert!(budget::run(few, || integer(3).pow(1_000_000)).is_err());
/// ```
///
/// # Errors
/// When the work takes more operations than the budget has, or is stopped.
pub fn run<T>(budget: Budget, work: impl FnOnce() -> T) -> Result<T, Halted> {
    let (outer, limit) = ((LEFT.get(), STOP.get(), LARGE.get()), LIMIT.get());
    let granted = budget.operations.min(outer.0);
    LEFT.set(granted);
    LIMIT.set(if budget.operations < outer.0 { budget.operations } else { limit });
    STOP.set(budget.stop.or(outer.1));
    LARGE.set(budget.large || outer.2);
    let outcome = catch_unwind(AssertUnwindSafe(work));
    // The outer run continues with its remaining operations.
    LEFT.set(outer.0 - (granted - LEFT.get()));
    let limit = LIMIT.replace(limit);
    ENDED.set(None);
    STOP.set(outer.1);
    LARGE.set(outer.2);
    outcome.map_err(|payload| match payload.downcast::<Signal>() {
        Ok(signal) => match *signal {
            Signal::TooLarge => Halted::TooLarge { at: ENDED_AT.take(), limit },
            Signal::Stopped => Halted::Stopped,
        },
        Err(panic) => resume_unwind(panic),
    })
}

/// Why the run on this thread ended, where it was not unwound: a host that outlives its program, as a browser does a WebAssembly module that
/// aborts, asks afterwards. Nothing while a run goes on, or after it was unwound.
#[must_use]
pub fn ended() -> Option<Halted> {
    ENDED.get().map(|signal| match signal {
        Signal::TooLarge => Halted::TooLarge { at: None, limit: LIMIT.get() },
        Signal::Stopped => Halted::Stopped,
    })
}

/// Names the work in the error of a run that ends within it. The innermost name is reported.
///
/// ```
/// # use tpm_symbolic::{budget::{self, Budget}, number::rational::integer};
/// let mut few = Budget::default();
/// few.operations = 10;
/// let work = || budget::within(|| "a power".to_owned(), || integer(3).pow(1_000_000));
/// assert!(budget::run(few, work).is_err_and(|halted| halted.to_string().contains("a power")));
/// ```
pub fn within<T>(name: impl FnOnce() -> String, work: impl FnOnce() -> T) -> T {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        if payload.is::<Signal>() {
            // Making the name takes operations too, of which the ended run has none left.
            let left = LEFT.replace(u64::MAX);
            ENDED_AT.with_borrow_mut(|at| {
                at.get_or_insert_with(|| shortened(&name()));
            });
            LEFT.set(left);
        }
        resume_unwind(payload)
    })
}

/// The beginning of a name that is too long for an error message.
fn shortened(name: &str) -> String {
    if name.chars().count() <= LONGEST_NAME {
        return name.to_owned();
    }
    name.chars().take(LONGEST_NAME - 3).chain("...".chars()).collect()
}

/// Whether the present run may build large tables.
#[must_use]
pub fn allows_large() -> bool {
    LARGE.get()
}

/// The operations on machine words that are left to the present run.
#[must_use]
pub fn left() -> u64 {
    LEFT.get()
}

/// Counts `operations` on machine words before they are performed.
///
/// Ends the current run when it has fewer operations left.
// Not inlined, so that the loops after a call are compiled as they would be without it.
#[inline(never)]
pub fn charge(operations: u64) {
    let left = LEFT.get();
    if left < operations {
        end(Signal::TooLarge);
    } else {
        LEFT.set(left - operations);
        if (left >> BETWEEN_QUESTIONS) != ((left - operations) >> BETWEEN_QUESTIONS)
            && STOP.get().is_some_and(|stop| stop())
        {
            end(Signal::Stopped);
        }
    }
}

#[cold]
fn end(signal: Signal) {
    // A thread that is already unwinding must not start another unwinding.
    if !std::thread::panicking() {
        LEFT.set(0);
        ENDED_AT.set(None);
        ENDED.set(Some(signal));
        resume_unwind(Box::new(signal));
    }
}

#[cfg(test)]
mod tests {
    use super::{Budget, Halted, charge, ended, left, run, within};

    fn of(operations: u64) -> Budget {
        Budget { operations, ..Budget::default() }
    }

    #[test]
    fn while_a_run_ends_it_is_known_why() {
        struct Asks;
        impl Drop for Asks {
            fn drop(&mut self) {
                assert_eq!(ended(), Some(Halted::TooLarge { at: None, limit: 100 }));
            }
        }
        let halted = run(of(100), || {
            assert_eq!(ended(), None);
            let _asks = Asks;
            charge(101);
        });
        assert!(halted.is_err());
        assert_eq!(ended(), None);
    }

    #[test]
    fn work_beyond_the_budget_is_refused_by_its_innermost_name() {
        let halted = run(of(100), || {
            charge(60);
            within(|| "outer".to_owned(), || within(|| "inner".to_owned(), || charge(41)));
        });
        assert_eq!(halted, Err(Halted::TooLarge { at: Some("inner".to_owned()), limit: 100 }));
        assert_eq!(run(of(100), || charge(100)), Ok(()));
        // Without a run there is no limit.
        charge(u64::MAX / 4);
    }

    #[test]
    fn inner_runs_share_the_operations_of_the_outer_one() {
        let outcome = run(of(100), || {
            assert_eq!(run(of(10), || charge(11)), Err(Halted::TooLarge { at: None, limit: 10 }));
            // The outer run has nothing left, so its limit is reported.
            assert_eq!((left(), run(of(1000), || charge(91))), (90, Err(Halted::TooLarge { at: None, limit: 100 })));
            charge(1);
        });
        assert!(outcome.is_err());
    }

    #[test]
    fn a_run_stops_when_it_is_asked_to() {
        let budget = Budget::default().stopped_by(|| true);
        assert_eq!(run(budget, || (0..10_000).for_each(|_| charge(10_000))), Err(Halted::Stopped));
    }

    #[test]
    fn panics_of_the_work_go_through() {
        let caught = std::panic::catch_unwind(|| run(Budget::default(), || std::panic::resume_unwind(Box::new(7_u8))));
        assert_eq!(caught.err().and_then(|payload| payload.downcast::<u8>().ok()).as_deref(), Some(&7));
    }
}
