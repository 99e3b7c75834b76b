//! Lines of a stream that nobody controls: as long as they may be, and no longer.

use std::io::{BufRead, ErrorKind, Result};

/// How a line ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// With a line break.
    Break,
    /// With the stream.
    Stream,
    /// It is longer than a line may be; the rest of it is still in the stream.
    TooLong,
}

/// Reads a line of at most `most` bytes into `bytes`, which are emptied before. The limit is asked for again as the line goes on, so that
/// it may change while the stream is silent. A line that ends with the stream and has no byte is none.
///
/// # Errors
/// The system's reason.
pub(super) fn read_line(stream: &mut impl BufRead, bytes: &mut Vec<u8>, most: impl Fn() -> usize) -> Result<End> {
    bytes.clear();
    loop {
        let part = next(stream)?;
        if part.is_empty() {
            return Ok(End::Stream);
        }
        let (length, ends) = up_to_break(part);
        let room = most().saturating_sub(bytes.len());
        bytes.extend_from_slice(&part[..length.min(room)]);
        stream.consume(length.min(room));
        if room < length {
            return Ok(End::TooLong);
        }
        if ends {
            return Ok(End::Break);
        }
    }
}

/// Leaves out what is left of a line.
///
/// # Errors
/// The system's reason.
pub(super) fn skip_line(stream: &mut impl BufRead) -> Result<()> {
    loop {
        let part = next(stream)?;
        let (length, ends) = up_to_break(part);
        let last = ends || part.is_empty();
        stream.consume(length);
        if last {
            return Ok(());
        }
    }
}

/// The bytes that come next; none at the end of the stream.
fn next(stream: &mut impl BufRead) -> Result<&[u8]> {
    while let Err(error) = stream.fill_buf() {
        if error.kind() != ErrorKind::Interrupted {
            return Err(error);
        }
    }
    stream.fill_buf()
}

/// The number of bytes up to a line break, which is counted, and whether there is one.
fn up_to_break(part: &[u8]) -> (usize, bool) {
    part.iter().position(|&byte| byte == b'\n').map_or((part.len(), false), |at| (at + 1, true))
}

#[cfg(test)]
mod tests {
    use super::{End, read_line, skip_line};
    use std::io::BufReader;

    #[test]
    fn lines_are_read_up_to_their_limit() {
        for capacity in [1, 3, 100] {
            let mut stream = BufReader::with_capacity(capacity, &b"one\n\ntoo long a line\nfour\nend"[..]);
            let mut bytes = Vec::new();
            let mut read = |stream: &mut _| {
                let end = read_line(stream, &mut bytes, || 5).expect("readable");
                (end, String::from_utf8_lossy(&bytes).into_owned())
            };
            assert_eq!(read(&mut stream), (End::Break, "one\n".into()));
            assert_eq!(read(&mut stream), (End::Break, "\n".into()));
            assert_eq!(read(&mut stream), (End::TooLong, "too l".into()));
            skip_line(&mut stream).expect("readable");
            assert_eq!(read(&mut stream), (End::Break, "four\n".into()));
            assert_eq!(read(&mut stream), (End::Stream, "end".into()));
            assert_eq!(read(&mut stream), (End::Stream, String::new()));
            skip_line(&mut stream).expect("nothing is left");
        }
    }
}
