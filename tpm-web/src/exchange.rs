//! The names under which a host calls the module: questions, logs and answers as bytes in its memory.
//!
//! A host asks for room ([`tpm_room`]), writes bytes there, and says what they are: a log ([`tpm_log`]), of which there may be several, or the
//! question ([`tpm_ask`]). What is in the room is moved and never copied. The answer lies where [`tpm_said`] points, as long as
//! [`tpm_ask`] returned. Where a call ends with a trap, [`tpm_last_words`] may still be called, and says why.
#![allow(
    unsafe_code,
    reason = "a name that is exported could stand for two functions; the names here begin with the project's"
)]

use crate::asked::answer;
use crate::file::Bytes;
use std::cell::RefCell;
use std::panic::PanicHookInfo;
use std::ptr;
use std::sync::Arc;
use tpm_symbolic::budget;

/// The bytes that host and module exchange.
struct Exchange {
    /// Room for the bytes that the host writes next.
    room: Vec<u8>,
    /// The logs that were handed over.
    logs: Vec<Bytes>,
    /// The last answer.
    said: Vec<u8>,
    /// Why the module ended.
    panic: Option<String>,
}

thread_local! {
    static EXCHANGE: RefCell<Exchange> =
        const { RefCell::new(Exchange { room: Vec::new(), logs: Vec::new(), said: Vec::new(), panic: None }) };
}

/// Room for `length` bytes, which the host writes; null where there is no memory for them.
#[unsafe(no_mangle)]
extern "C" fn tpm_room(length: usize) -> *mut u8 {
    EXCHANGE.with_borrow_mut(|exchange| {
        let mut room = Vec::new();
        if room.try_reserve_exact(length).is_err() {
            return ptr::null_mut();
        }
        room.resize(length, 0);
        exchange.room = room;
        exchange.room.as_mut_ptr()
    })
}

/// Takes what is in the room as the next log.
#[unsafe(no_mangle)]
extern "C" fn tpm_log() {
    EXCHANGE.with_borrow_mut(|exchange| {
        let log = std::mem::take(&mut exchange.room);
        exchange.logs.push(Arc::new(log));
    });
}

/// Takes what is in the room as a question about all logs so far; returns the length of the answer.
#[unsafe(no_mangle)]
extern "C" fn tpm_ask() -> usize {
    std::panic::set_hook(Box::new(note));
    // Nothing is borrowed while the work goes on, so that last words can be said after a trap.
    let (room, logs) =
        EXCHANGE.with_borrow_mut(|exchange| (std::mem::take(&mut exchange.room), std::mem::take(&mut exchange.logs)));
    say(answer(&String::from_utf8_lossy(&room), &logs))
}

/// Where the last answer or the last words lie.
#[unsafe(no_mangle)]
extern "C" fn tpm_said() -> *const u8 {
    EXCHANGE.with_borrow(|exchange| exchange.said.as_ptr())
}

/// Why a call ended with a trap, as a sentence; returns its length, which is zero where the module does not know: it has no memory left then.
#[unsafe(no_mangle)]
extern "C" fn tpm_last_words() -> usize {
    let panic = EXCHANGE.with_borrow_mut(|exchange| exchange.panic.take());
    let halted = || budget::ended().map(|halted| format!("{halted}: the command line does, with --allow-large"));
    say(panic.or_else(halted).unwrap_or_default())
}

fn say(words: String) -> usize {
    EXCHANGE.with_borrow_mut(|exchange| {
        exchange.said = words.into_bytes();
        exchange.said.len()
    })
}

/// Keeps what a panic says.
fn note(panic: &PanicHookInfo<'_>) {
    let place = panic.location().map(|at| {
        let file = at.file().rsplit(['/', '\\']).next().unwrap_or_default();
        format!(" ({file}, line {})", at.line())
    });
    let what = panic.payload_as_str().unwrap_or("a fault without words");
    let words = format!(
        "this is a defect of tpm: {what}{}; please report it with the log and the model",
        place.unwrap_or_default()
    );
    EXCHANGE.with_borrow_mut(|exchange| exchange.panic = Some(words));
}
