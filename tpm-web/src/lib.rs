//! Identification in a browser: what a page asks, and what it is answered.
//!
//! A page has a text of a model, the bytes of logs, and forms that are filled in. [`answer`] takes them as one question in JSON and gives one
//! answer in JSON; nothing is decided here that the library does not decide. The module for a browser (`exchange`) hands questions and answers
//! over as bytes, so that no tool has to write code between the two languages. `page` holds the page itself.
//!
//! Invariant: an answer has either `error`, a sentence for people, or the fields of its question. A model and a log have the names of their
//! files, so that a result is that of the command line in the folder of these files, to the last bit.
//!
//! A WebAssembly module cannot unwind. Where a command ends with a refusal out of the middle of its work (the budget of the algebra), the module
//! ends, and the host asks it for its last words.

mod asked;
mod exchange;
mod file;
mod findings;
mod identified;
mod log;
mod settings;
#[cfg(test)]
mod tests;
mod words;

// The functions of the command line, so that numbers agree to the last bit.
use tpm_elementary as _;

pub use asked::answer;
pub use file::Bytes;
