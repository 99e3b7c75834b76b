//! Fingerprints: hashes by which files are told apart.

use std::io::{self, Read};

/// Offset basis of FNV-1a, 64 bits: the hash of no bytes.
const HASH_OF_NOTHING: u64 = 0xcbf2_9ce4_8422_2325;
/// The factor of FNV-1a, 64 bits.
const HASH_PRIME: u64 = 0x0100_0000_01b3;

/// Fingerprint of a file's bytes (FNV-1a, 64 bits), in 16 hexadecimal digits: it tells files apart, it is no protection against
/// forgery.
#[must_use]
pub fn fingerprint(bytes: &[u8]) -> String {
    digits(extended(HASH_OF_NOTHING, bytes))
}

/// A reader that takes the [`fingerprint`] of the bytes that are read through it.
#[derive(Debug)]
pub(crate) struct FingerprintReader<R> {
    inner: R,
    hash: u64,
}

impl<R> FingerprintReader<R> {
    /// A reader from which nothing was read yet.
    pub(crate) const fn new(inner: R) -> Self {
        Self { inner, hash: HASH_OF_NOTHING }
    }

    /// Fingerprint of the bytes that were read so far.
    pub(crate) fn fingerprint(&self) -> String {
        digits(self.hash)
    }
}

impl<R: Read> Read for FingerprintReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hash = extended(self.hash, &buffer[..count]);
        Ok(count)
    }
}

/// The [`fingerprint`] of bytes that come one by one.
pub(super) fn fingerprint_of(bytes: impl Iterator<Item = u8>) -> String {
    digits(bytes.fold(HASH_OF_NOTHING, with_byte))
}

fn extended(hash: u64, bytes: &[u8]) -> u64 {
    bytes.iter().copied().fold(hash, with_byte)
}

const fn with_byte(hash: u64, byte: u8) -> u64 {
    (hash ^ byte as u64).wrapping_mul(HASH_PRIME)
}

fn digits(hash: u64) -> String {
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use super::{FingerprintReader, fingerprint};
    use std::io::Read as _;

    #[test]
    fn a_file_read_in_parts_has_the_fingerprint_of_its_bytes() {
        // FNV-1a, 64 bits: published test vectors.
        assert_eq!(fingerprint(b""), "cbf29ce484222325");
        assert_eq!(fingerprint(b"foobar"), "85944171f73967e8");
        let mut reader = FingerprintReader::new(&b"foobar"[..]);
        let mut part = [0; 4];
        assert_eq!(reader.read(&mut part).expect("readable"), 4);
        assert_eq!(reader.fingerprint(), fingerprint(b"foob"));
        assert_eq!(reader.read(&mut part).expect("readable"), 2);
        assert_eq!(reader.fingerprint(), fingerprint(b"foobar"));
    }
}
