//! The verbs, one module each.

pub(crate) mod actuator;
pub(crate) mod campaign;
pub(crate) mod check;
pub(crate) mod compare;
pub(crate) mod design;
pub(crate) mod excite;
pub(crate) mod expand;
pub(crate) mod explain;
pub(crate) mod feedforward;
pub(crate) mod fit;
pub(crate) mod frf;
pub(crate) mod generate;
pub(crate) mod identifiability;
pub(crate) mod identify;
pub(crate) mod import;
pub(crate) mod init;
pub(crate) mod inspect;
pub(crate) mod linearize;
pub(crate) mod path;
pub(crate) mod regulate;
pub(crate) mod shell;
pub(crate) mod simulate;
pub(crate) mod split;
pub(crate) mod study;
pub(crate) mod trajectories;
pub(crate) mod validate;
