//! tpm-codegen
