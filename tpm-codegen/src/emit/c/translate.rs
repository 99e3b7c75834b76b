//! C from the controller's own Rust: the one source of what every estimator computes is `tpm_controller::support`, and this prints it as C99.
//!
//! The subset that is read: structures of scalars, numbers and arrays of fixed size; functions over them with arrays and structures by
//! reference; loops over ranges; no closures, iterators, options, or generics but the scalar, sizes, and the model. What is asked for is
//! translated with all that it calls, and nothing else, so that other items of the same files may be anything. The scalar becomes `float` or
//! `double`, every size a macro of the model's header, and a fault the number of its status.
//!
//! Invariant: an operation of the source is one of the text, in the same order, so that both give the same bits.

mod expression;
mod frame;
mod library;
mod spelling;
mod statement;
mod translator;
mod types;

pub(super) use library::{Library, Untranslated};
pub(super) use translator::{Target, Translator};
