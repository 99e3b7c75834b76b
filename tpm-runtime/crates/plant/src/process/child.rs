//! A child process that exchanges lines of text: its output, awaited with a time limit, and how it ended.
//!
//! Invariant: no call blocks for longer than it was given, and no more is held than one line of each stream and what waits to be read by
//! the process, whether it reads, writes, hangs or floods. The process ends with this value, and whatever it started: its input is closed,
//! and where that does not end it soon, it is told to end, and then killed.

use crate::process::group::Group;
use crate::process::lines::{End, read_line, skip_line};
use crate::process::protocol::{LONGEST_OTHER, quoted};
use crate::process::talk::{Heard, Partner};
use std::cell::Cell;
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write as _};
use std::process::{ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Interval at which a wait checks whether it was interrupted.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Longest wait for the rest of a process's standard error once the process has ended.
const LONGEST_ERROR_WAIT: Duration = Duration::from_millis(200);
/// Longest wait for a process that was told to end.
const MERCY: Duration = Duration::from_millis(500);
/// Longest part of a line of the standard error that is kept, in bytes.
const LONGEST_ERROR_LINE: usize = 1 << 12;
/// Most bytes that wait to be read by the process when a line is added to them.
const MOST_WAITING: usize = 1 << 24;
/// Last lines of the standard error that are kept.
const KEPT_ERROR_LINES: usize = 5;

/// A running process.
#[derive(Debug)]
pub(super) struct Process {
    group: Group,
    input: Option<Sender<String>>,
    /// Bytes of the lines that the process has not read yet.
    waiting: Arc<AtomicUsize>,
    /// Whether a line was not sent because too much waited.
    deaf: Cell<bool>,
    output: Receiver<Heard>,
    /// Longest line that is read, in bytes.
    longest: Arc<AtomicUsize>,
    last_words: Arc<Mutex<VecDeque<String>>>,
    listener: JoinHandle<()>,
    /// Longest wait for the process to end of itself once its input is closed.
    grace: Duration,
}

impl Process {
    /// Starts a program with its arguments. The process has the time `grace` to end of itself once its input is closed.
    ///
    /// # Errors
    /// The system's reason.
    pub(super) fn start(words: &[String], grace: Duration) -> std::io::Result<Self> {
        let (program, arguments) = words.split_first().ok_or_else(|| std::io::Error::from(ErrorKind::InvalidInput))?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut group = Group::start(&mut command)?;
        let child = group.leader();
        let piped = "invariant: the stream was piped, and is taken once";
        let stdin = child.stdin.take().expect(piped);
        let stdout = child.stdout.take().expect(piped);
        let stderr = child.stderr.take().expect(piped);
        let (input, lines) = mpsc::channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        let unread = Arc::clone(&waiting);
        thread::spawn(move || write(stdin, &lines, &unread));
        // A line is handed over before the next one is read.
        let (heard, output) = mpsc::sync_channel(0);
        let longest = Arc::new(AtomicUsize::new(LONGEST_OTHER));
        let most = Arc::clone(&longest);
        thread::spawn(move || read(stdout, &heard, &most));
        let last_words = Arc::new(Mutex::new(VecDeque::with_capacity(KEPT_ERROR_LINES)));
        let kept = Arc::clone(&last_words);
        let listener = thread::spawn(move || keep_last(stderr, &kept));
        Ok(Process {
            group,
            input: Some(input),
            waiting,
            deaf: Cell::new(false),
            output,
            longest,
            last_words,
            listener,
            grace,
        })
    }
}

impl Partner for Process {
    fn allow(&self, longest: usize) {
        self.longest.store(longest, Ordering::Relaxed);
    }

    fn say(&self, line: String) {
        let Some(input) = &self.input else { return };
        if self.waiting.load(Ordering::Relaxed) > MOST_WAITING {
            self.deaf.set(true);
            return;
        }
        self.waiting.fetch_add(line.len(), Ordering::Relaxed);
        let _ = input.send(line);
    }

    fn hear(&self, timeout: Duration, go_on: &dyn Fn() -> bool) -> Heard {
        if self.deaf.get() {
            return Heard::Deaf(self.waiting.load(Ordering::Relaxed));
        }
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

    /// Closes the input, and waits a short time for the process to end.
    fn ending(&mut self) -> String {
        self.input = None;
        let status = if self.group.wait(self.grace) { self.group.end(MERCY) } else { None };
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

    fn last_words(&self) -> String {
        let lines = self.last_words.lock().unwrap_or_else(PoisonError::into_inner);
        if lines.is_empty() {
            return String::new();
        }
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        format!("; its standard error ends with: {}", lines.join(" | "))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.input = None;
        self.group.wait(self.grace);
        self.group.end(MERCY);
    }
}

/// Writes lines to the process until there are no more, or nobody reads them.
fn write(mut stdin: ChildStdin, lines: &Receiver<String>, waiting: &AtomicUsize) {
    while let Ok(mut line) = lines.recv() {
        let length = line.len();
        line.push('\n');
        if stdin.write_all(line.as_bytes()).and_then(|()| stdin.flush()).is_err() {
            return;
        }
        waiting.fetch_sub(length, Ordering::Relaxed);
    }
}

/// Passes on the lines of the process until its output is closed, a line is too long, or nobody receives them.
fn read(stdout: impl Read, heard: &SyncSender<Heard>, longest: &AtomicUsize) {
    let mut stdout = BufReader::new(stdout);
    loop {
        let line = next_line(&mut stdout, || longest.load(Ordering::Relaxed));
        let is_last = matches!(line, Heard::Closed | Heard::TooLong(_));
        if heard.send(line).is_err() || is_last {
            return;
        }
    }
}

/// The next line of a stream, of at most `most` bytes.
pub(super) fn next_line(stream: &mut impl BufRead, most: impl Fn() -> usize) -> Heard {
    let mut bytes = Vec::new();
    match read_line(stream, &mut bytes, &most) {
        Err(_) => Heard::Closed,
        Ok(End::Stream) if bytes.is_empty() => Heard::Closed,
        Ok(End::TooLong) => Heard::TooLong(most()),
        Ok(end) => match (String::from_utf8(bytes), end) {
            (Ok(line), End::Break) => Heard::Line(line.trim_end().to_string()),
            (Ok(line), _) => Heard::NoText(format!("the line does not end: {}", quoted(&line))),
            (Err(fault), _) => Heard::NoText(format!("the line is no text: {}", quoted(&lossy(fault.as_bytes())))),
        },
    }
}

/// Keeps the last lines of a stream, each up to a length that is read at a glance.
fn keep_last(stderr: impl Read, kept: &Mutex<VecDeque<String>>) {
    let mut stderr = BufReader::new(stderr);
    let mut bytes = Vec::new();
    loop {
        match read_line(&mut stderr, &mut bytes, || LONGEST_ERROR_LINE) {
            Err(_) => return,
            Ok(End::Stream) if bytes.is_empty() => return,
            Ok(End::TooLong) if skip_line(&mut stderr).is_err() => return,
            Ok(_) => {}
        }
        let line = quoted(&lossy(&bytes));
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
    use super::Process;
    use crate::process::talk::{Heard, Partner as _};
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

    #[test]
    fn endless_lines_are_refused_at_their_limit() {
        let endless = shell("yes | tr -d '\\n'", 200);
        assert!(matches!(hear(&endless, 5000), Heard::TooLong(super::LONGEST_OTHER)));
        // What may come later may be longer, also where the process is awaited already.
        let later = shell("sleep 0.2; head -c 3000000 /dev/zero | tr '\\0' x; echo", 200);
        later.allow(1 << 22);
        assert!(matches!(hear(&later, 5000), Heard::Line(line) if line.len() == 3_000_000));
        let mut noisy = shell("yes | tr -d '\\n' | head -c 10000000 >&2; echo >&2; echo last >&2; exit 1", 5000);
        let ending = noisy.ending();
        assert!(ending.len() < 400 && ending.contains("(4096 characters) | last"), "{ending}");
    }

    #[test]
    fn nothing_more_waits_for_a_process_that_does_not_read() {
        let deaf = shell("while true; do echo said; done", 200);
        let mut said = 0;
        while matches!(hear(&deaf, 5000), Heard::Line(_)) {
            deaf.say("x".repeat(1 << 20));
            said += 1;
        }
        assert!(matches!(hear(&deaf, 5000), Heard::Deaf(waiting) if waiting <= super::MOST_WAITING + (1 << 20)));
        assert!(said < 20, "{said}");
    }

    /// Whether a process is there and has not ended.
    #[cfg(target_os = "linux")]
    fn lives(process: &str) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
        stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with(['Z', 'X']))
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn whatever_the_process_has_started_ends_with_it() {
        let ends = [
            ("a program that hangs", "exec sleep 60"),
            ("one that ignores TERM", "exec sleep 60"),
            ("one that has ended", "exit 0"),
        ];
        for (what, then) in ends {
            let trap = if what.contains("TERM") { "trap '' TERM;" } else { "" };
            let family = shell(&format!("{trap} sleep 61 <&0 & echo $!; sh -c 'sleep 62 & echo $!'; {then}"), 100);
            let children: Vec<String> = (0..2)
                .map(|_| match hear(&family, 5000) {
                    Heard::Line(line) => line,
                    other => panic!("{other:?}"),
                })
                .collect();
            assert!(children.iter().all(|child| lives(child)), "{what}");
            let began = Instant::now();
            drop(family);
            assert!(began.elapsed() < Duration::from_secs(2), "{what}: {:?}", began.elapsed());
            for _ in 0..100 {
                if !children.iter().any(|child| lives(child)) {
                    break;
                }
                std::thread::sleep(Duration::from_millis(10));
            }
            assert!(!children.iter().any(|child| lives(child)), "{what}");
        }
    }
}
