//! tpm-runtime
