//! A child process that exchanges lines of text: its output, awaited with a time limit, and how it ended.
//!
//! Invariant: no call blocks for longer than it was given, whether the process reads, writes, hangs or floods. The process ends with
//! this value: its input is closed, and where it has not ended soon after, it is killed.

use crate::process::protocol::quoted;
use std::collections::VecDeque;
use std::io::{BufRead as _, BufReader, ErrorKind, Read, Write as _};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Interval at which a wait checks whether it was interrupted.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Longest wait for the rest of a process's standard error once the process has ended.
const LONGEST_ERROR_WAIT: Duration = Duration::from_millis(200);
/// Longest line in bytes: a record of a million samples of ten signals.
const LONGEST_LINE_BYTES: u64 = 1 << 28;
/// Most lines of output that are buffered; beyond them the process blocks on writing.
const MOST_BUFFERED_LINES: usize = 64;
/// Last lines of the standard error that are kept.
const KEPT_ERROR_LINES: usize = 5;

/// The result of waiting for a line.
#[derive(Debug)]
pub(super) enum Heard {
    /// A line, without its end.
    Line(String),
    /// A line that is no text or too long, described in words.
    NoText(String),
    /// The process closed its output.
    Closed,
    /// No line came within the time.
    Silence,
    /// The wait was interrupted.
    Interrupted,
}

/// A running process.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    input: Option<Sender<String>>,
    output: Receiver<Heard>,
    last_words: Arc<Mutex<VecDeque<String>>>,
    listener: JoinHandle<()>,
    /// Longest wait for the process to end of itself once its input is closed.
    grace: Duration,
}

impl Process {
    /// Starts a program with its arguments. The process has the time `grace` to end of itself once its input is closed.
    /// On Unix the process has a process group of its own, so that Ctrl-C on a terminal reaches this program alone,
    /// which then stops the machine in an orderly way.
    ///
    /// # Errors
    /// The system's reason.
    pub(super) fn start(words: &[String], grace: Duration) -> std::io::Result<Self> {
        let (program, arguments) = words.split_first().ok_or_else(|| std::io::Error::from(ErrorKind::InvalidInput))?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let piped = "invariant: the stream was piped, and is taken once";
        let stdin = child.stdin.take().expect(piped);
        let stdout = child.stdout.take().expect(piped);
        let stderr = child.stderr.take().expect(piped);
        let (input, lines) = mpsc::channel();
        thread::spawn(move || write(stdin, &lines));
        let (heard, output) = mpsc::sync_channel(MOST_BUFFERED_LINES);
        thread::spawn(move || read(stdout, &heard));
        let last_words = Arc::new(Mutex::new(VecDeque::with_capacity(KEPT_ERROR_LINES)));
        let kept = Arc::clone(&last_words);
        let listener = thread::spawn(move || keep_last(stderr, &kept));
        Ok(Process { child, input: Some(input), output, last_words, listener, grace })
    }

    /// Sends a line. A process that does not read it is noticed when its answer is awaited.
    pub(super) fn say(&self, line: String) {
        if let Some(input) = &self.input {
            let _ = input.send(line);
        }
    }

    /// Waits at most `timeout` for the next line; the wait is interrupted when `go_on` returns false.
    pub(super) fn hear(&self, timeout: Duration, go_on: &dyn Fn() -> bool) -> Heard {
        let began = Instant::now();
        loop {
            let left = timeout.saturating_sub(began.elapsed());
            match self.output.recv_timeout(left.min(POLL_INTERVAL)) {
                Ok(heard) => return heard,
                Err(RecvTimeoutError::Disconnected) => return Heard::Closed,
                Err(RecvTimeoutError::Timeout) if !go_on() => return Heard::Interrupted,
                Err(RecvTimeoutError::Timeout) if left.is_zero() => return Heard::Silence,
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Closes the input, waits a short time for the process to end, and describes its end in words, with the last lines
    /// of its standard error.
    pub(super) fn ending(&mut self) -> String {
        self.input = None;
        let status = self.wait(self.grace);
        let deadline = Instant::now() + LONGEST_ERROR_WAIT;
        while status.is_some() && !self.listener.is_finished() && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(1));
        }
        let how = match status {
            Some(status) => format!("ended with {status}"),
            None => "closed its standard output, and goes on".to_string(),
        };
        format!("{how}{}", self.last_words())
    }

    /// The last lines of the standard error, as the end of a sentence; empty where there are none.
    pub(super) fn last_words(&self) -> String {
        let lines = self.last_words.lock().unwrap_or_else(PoisonError::into_inner);
        if lines.is_empty() {
            return String::new();
        }
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        format!("; its standard error ends with: {}", lines.join(" | "))
    }

    fn wait(&mut self, timeout: Duration) -> Option<ExitStatus> {
        let deadline = Instant::now() + timeout;
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Some(status),
                Ok(None) if Instant::now() < deadline => thread::sleep(Duration::from_millis(2)),
                Ok(None) | Err(_) => return None,
            }
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.input = None;
        if self.wait(self.grace).is_none() {
            // A process that has ended meanwhile cannot be killed, which is no fault.
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// Writes lines to the process until there are no more, or nobody reads them.
fn write(mut stdin: ChildStdin, lines: &Receiver<String>) {
    while let Ok(mut line) = lines.recv() {
        line.push('\n');
        if stdin.write_all(line.as_bytes()).and_then(|()| stdin.flush()).is_err() {
            return;
        }
    }
}

/// Passes on the lines of the process until its output is closed, or nobody receives them.
fn read(stdout: impl Read, heard: &SyncSender<Heard>) {
    let mut stdout = BufReader::new(stdout);
    loop {
        let mut bytes = Vec::new();
        let line = match stdout.by_ref().take(LONGEST_LINE_BYTES).read_until(b'\n', &mut bytes) {
            Ok(0) | Err(_) => return,
            Ok(_) => match String::from_utf8(bytes) {
                Ok(line) if line.ends_with('\n') => Heard::Line(line.trim_end().to_string()),
                Ok(line) if line.len() as u64 == LONGEST_LINE_BYTES => {
                    Heard::NoText(format!("the line is longer than {LONGEST_LINE_BYTES} bytes"))
                }
                Ok(line) => Heard::NoText(format!("the line does not end: {}", quoted(&line))),
                Err(fault) => Heard::NoText(format!("the line is no text: {}", quoted(&lossy(fault.as_bytes())))),
            },
        };
        if heard.send(line).is_err() {
            return;
        }
    }
}

/// Keeps the last lines of a stream.
fn keep_last(stderr: impl Read, kept: &Mutex<VecDeque<String>>) {
    let mut stderr = BufReader::new(stderr);
    let mut bytes = Vec::new();
    while let Ok(1..) = stderr.by_ref().take(LONGEST_LINE_BYTES).read_until(b'\n', &mut bytes) {
        let line = quoted(&lossy(&bytes));
        bytes.clear();
        if line.trim().is_empty() {
            continue;
        }
        let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() == KEPT_ERROR_LINES {
            kept.pop_front();
        }
        kept.push_back(line);
    }
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[cfg(all(test, unix))]
mod tests {
    use super::{Heard, Process};
    use std::time::{Duration, Instant};

    /// A shell that runs a script; it has `grace` milliseconds to end of itself.
    fn shell(script: &str, grace: u64) -> Process {
        let words: Vec<String> = ["sh", "-c", script].iter().map(ToString::to_string).collect();
        Process::start(&words, Duration::from_millis(grace)).expect("there is a shell")
    }

    fn hear(process: &Process, milliseconds: u64) -> Heard {
        process.hear(Duration::from_millis(milliseconds), &|| true)
    }

    #[test]
    fn lines_go_both_ways_and_the_end_is_told() {
        let mut echo = shell("while read line; do echo \"$line\"; done; echo broken belt >&2; exit 3", 20_000);
        for line in ["one", "two"] {
            echo.say(line.to_string());
            assert!(matches!(hear(&echo, 5000), Heard::Line(heard) if heard == line));
        }
        let ending = echo.ending();
        assert!(ending.contains("ended with exit status: 3") && ending.ends_with("broken belt"), "{ending}");
        assert!(matches!(hear(&echo, 5000), Heard::Closed));
    }

    #[test]
    fn nothing_waits_for_a_process_that_hangs() {
        let began = Instant::now();
        let hung = shell("exec sleep 60", 200);
        // More than a pipe holds, which nobody reads.
        hung.say("x".repeat(1 << 20));
        assert!(matches!(hear(&hung, 50), Heard::Silence));
        assert!(matches!(hung.hear(Duration::from_secs(60), &|| false), Heard::Interrupted));
        drop(hung);
        assert!(began.elapsed() < Duration::from_secs(30));
    }

    #[test]
    fn what_is_no_line_of_text_is_said() {
        let torn = shell("printf '{\"type\":'", 20_000);
        assert!(matches!(hear(&torn, 5000), Heard::NoText(what) if what.contains("does not end: {\"type\":")));
        let binary = shell("printf '\\377\\376\\n'", 20_000);
        assert!(matches!(hear(&binary, 5000), Heard::NoText(what) if what.contains("no text")));
        // An endless output is read no faster than lines are asked for.
        let flood = shell("yes", 200);
        assert!(matches!(hear(&flood, 5000), Heard::Line(line) if line == "y"));
    }
}
