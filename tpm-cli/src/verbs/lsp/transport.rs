//! Messages of the language server protocol as they come in: a header with the number of bytes, then so many bytes of JSON.

use lsp_server::Message;
use std::io::{BufRead, Read as _};
use tpm_runtime::report::MOST_TEXT;

/// Most bytes of a message: a model of the largest size, of which each byte may be written as an escape of six letters, and what is said of
/// it.
const MOST_BYTES: u64 = 7 * MOST_TEXT;
/// Most bytes of a line of the header.
const MOST_HEADER: u64 = 1000;

/// Hands on messages until the last one, the end of the input, or until nobody takes them.
///
/// # Errors
/// In words, what is wrong with the input.
pub(super) fn read_all(input: &mut impl BufRead, mut take: impl FnMut(Message) -> bool) -> Result<(), String> {
    while let Some(message) = read(input)? {
        let is_last = matches!(&message, Message::Notification(own) if own.method == "exit");
        if !take(message) || is_last {
            break;
        }
    }
    Ok(())
}

/// The next message; nothing at the end of the input.
fn read(input: &mut impl BufRead) -> Result<Option<Message>, String> {
    let Some(length) = header(input)? else { return Ok(None) };
    if length > MOST_BYTES {
        return Err(format!("a message of {length} bytes, and no more than {MOST_BYTES} are taken"));
    }
    // The memory grows with what comes in, not with what the header says.
    let mut bytes = Vec::new();
    let read = input.take(length).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if (read as u64) < length {
        return Err(format!("the input ends after {read} of {length} bytes"));
    }
    serde_json::from_slice(&bytes).map(Some).map_err(|error| format!("malformed JSON: {error}"))
}

/// The number of bytes that a header says; nothing at the end of the input.
fn header(input: &mut impl BufRead) -> Result<Option<u64>, String> {
    let mut length = None;
    loop {
        let mut line = Vec::new();
        input.take(MOST_HEADER).read_until(b'\n', &mut line).map_err(|error| error.to_string())?;
        if line.is_empty() {
            return Ok(None);
        }
        let line = String::from_utf8_lossy(&line).into_owned();
        let Some(line) = line.strip_suffix("\r\n") else {
            return Err(format!("malformed header: {line:?}"));
        };
        if line.is_empty() {
            return length.map(Some).ok_or_else(|| "no Content-Length".to_owned());
        }
        let Some((name, value)) = line.split_once(": ") else {
            return Err(format!("malformed header: {line:?}"));
        };
        if name.eq_ignore_ascii_case("Content-Length") {
            let bytes = value.parse().map_err(|_| format!("`{value}` is no number of bytes"))?;
            length = Some(bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::read_all;

    /// The number of messages in an input, and what is wrong with it.
    fn heard(input: &str) -> (usize, Result<(), String>) {
        let mut count = 0;
        let outcome = read_all(&mut input.as_bytes(), |_| {
            count += 1;
            true
        });
        (count, outcome)
    }

    fn message(body: &str) -> String {
        format!("Content-Length: {}\r\n\r\n{body}", body.len())
    }

    #[test]
    fn messages_are_handed_on_until_the_last_one() {
        let ask = message(r#"{"jsonrpc":"2.0","id":1,"method":"shutdown"}"#);
        let exit = message(r#"{"jsonrpc":"2.0","method":"exit"}"#);
        assert_eq!(heard(&format!("{ask}{ask}{exit}{ask}")), (3, Ok(())));
        assert_eq!(heard(&ask), (1, Ok(())));
        assert_eq!(heard(""), (0, Ok(())));
    }

    #[test]
    fn lengths_that_nobody_sends_are_refused() {
        let says = |input: &str, part: &str| {
            let (count, outcome) = heard(input);
            assert!(count == 0 && outcome.as_ref().is_err_and(|reason| reason.contains(part)), "{outcome:?}");
        };
        says("Content-Length: 99999999999999\r\n\r\n{}", "99999999999999 bytes");
        says("Content-Length: 1000000\r\n\r\n{}", "ends after 2 of");
        says("Content-Length: -1\r\n\r\n{}", "`-1` is no number");
        says("Content-Type: x\r\n\r\n{}", "no Content-Length");
        says(&"x".repeat(5000), "malformed header");
        says(&message("{\"id\":"), "malformed JSON");
        says(&message(&"[".repeat(100_000)), "malformed JSON");
    }
}
