//! tpm-symbolic
