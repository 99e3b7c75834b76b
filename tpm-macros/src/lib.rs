//! tpm-macros
