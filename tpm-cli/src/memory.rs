//! The memory of the process: what the budget of the algebra does not count ends here, with a sentence, before the machine swaps.
//!
//! The allocator counts what is held, and a thread of its own looks at the count. It ends the program as a refusal does; nothing needs
//! memory to be told, and no allocation fails, so that no code has to expect it. What grows by a gigabyte a second passes the limit by some
//! megabytes. The limit is that of the command line alone: whoever uses the libraries has an allocator of their own.

use crate::failure::Failure;
use cap::Cap;
use std::alloc::System;
use std::time::Duration;

/// Most bytes that are held at one time where large models are not allowed.
const MOST_BYTES: usize = 1 << 30;

/// How often the count is looked at.
const BETWEEN_LOOKS: Duration = Duration::from_millis(10);

#[global_allocator]
static HELD: Cap<System> = Cap::new(System, usize::MAX);

/// Ends the program once it holds more than [`MOST_BYTES`]. Where no thread can be started, nothing is watched.
pub(crate) fn limit() {
    let watch = || {
        while HELD.allocated() <= MOST_BYTES {
            std::thread::sleep(BETWEEN_LOOKS);
        }
        let failure = Failure::Input(format!(
            "this takes more than {} GiB of memory, which is what a command may hold; give it less to read or to make (shorter logs, fewer \
             samples, harmonics, coordinates or documents), or allow large models: --allow-large",
            MOST_BYTES >> 30
        ));
        failure.report();
        std::process::exit(i32::from(failure.exit_code()));
    };
    let _ = std::thread::Builder::new().name("memory".to_owned()).spawn(watch);
}
