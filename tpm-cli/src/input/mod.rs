//! The command line in the terms of the libraries: files, assignments, and options that several verbs share.

pub(crate) mod assignments;
pub(crate) mod choice;
pub(crate) mod description;
pub(crate) mod domain;
pub(crate) mod experiment;
pub(crate) mod issue;
pub(crate) mod limits;
pub(crate) mod linear;
pub(crate) mod load;
pub(crate) mod log;
pub(crate) mod measured;
pub(crate) mod values;
