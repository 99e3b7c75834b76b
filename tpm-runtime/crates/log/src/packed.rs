//! Packed parts of files, of which a few bytes may unpack to more than the memory holds.

use std::io::{Read, Result};

/// Most bytes to which what is packed in a file may unpack: 33 million numbers.
pub(super) const MOST_UNPACKED: u64 = 1 << 28;

/// How much of a file may still be unpacked.
pub(super) struct Room(u64);

impl Room {
    /// Room for a whole file, or a part of one that is read by itself.
    pub(super) const fn new() -> Self {
        Self(MOST_UNPACKED)
    }

    /// Room for the parts of a file of so many bytes, of which some are stored as they are.
    pub(super) fn of_file(length: usize) -> Self {
        Self(MOST_UNPACKED.max(length as u64))
    }

    /// Everything that a decoder gives; nothing where that is more than there is room for.
    ///
    /// # Errors
    /// The decoder's, on damaged bytes.
    pub(super) fn unpack(&mut self, decoder: impl Read) -> Result<Option<Vec<u8>>> {
        let mut bytes = Vec::new();
        decoder.take(self.0 + 1).read_to_end(&mut bytes)?;
        let left = self.0.checked_sub(bytes.len() as u64);
        self.0 = left.unwrap_or(0);
        Ok(left.map(|_| bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::{MOST_UNPACKED, Room};
    use std::io::Read as _;

    #[test]
    fn no_more_is_unpacked_than_there_is_room_for() {
        let zeros = |count: u64| std::io::repeat(0).take(count);
        let mut room = Room::new();
        assert_eq!(room.unpack(zeros(1000)).expect("readable").map(|bytes| bytes.len()), Some(1000));
        assert_eq!(room.unpack(zeros(MOST_UNPACKED - 999)).expect("readable"), None);
        assert_eq!(room.unpack(zeros(1)).expect("readable"), None);
    }
}
