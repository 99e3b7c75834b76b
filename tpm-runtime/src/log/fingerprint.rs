//! Fingerprints, which tell files apart.

use std::format;
use std::string::String;

/// Fingerprint of a file's bytes (FNV-1a, 64 bits), in 16 hexadecimal digits: it tells files apart, it is no protection against
/// forgery.
#[must_use]
pub fn fingerprint(bytes: &[u8]) -> String {
    let value = bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
    format!("{value:016x}")
}
