//! What a command line says, as the libraries take it: files, assignments, options of several verbs.

pub(crate) mod assignments;
pub(crate) mod experiment;
pub(crate) mod load;
pub(crate) mod log;
pub(crate) mod measured;
pub(crate) mod values;
