//! The processes of a machine's program: the program, and whatever it starts, as one group of processes that ends together.
//!
//! On Unix the program leads a process group of its own, so that Ctrl-C on a terminal reaches this program alone, which then stops the
//! machine in an orderly way. The group is ended by TERM and then KILL. Where this program ends without that, by a panic that aborts, a
//! second Ctrl-C or a KILL, a guard does it: a shell that waits for the end of a pipe, which the system closes with this program however
//! it ends. A process that leaves the group on purpose (`setsid`) is out of reach.
//!
//! Invariant: the leader is waited for only after its group was sent its signals, so that the group's number is still its own then.

use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant};

/// Interval at which an ending group is looked at.
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// A program and whatever it starts.
#[derive(Debug)]
pub(super) struct Group {
    leader: Child,
    /// How the leader ended, once it was waited for.
    status: Option<ExitStatus>,
    #[cfg(unix)]
    guard: guard::Guard,
}

impl Group {
    /// Starts a program whose streams are those of the command.
    ///
    /// # Errors
    /// The system's reason.
    #[cfg(unix)]
    pub(super) fn start(command: &mut Command) -> std::io::Result<Self> {
        let mut guard = guard::Guard::start()?;
        std::os::unix::process::CommandExt::process_group(command, 0);
        let leader = command.spawn()?;
        guard.watch(leader.id());
        Ok(Group { leader, status: None, guard })
    }

    /// Starts a program whose streams are those of the command.
    ///
    /// # Errors
    /// The system's reason.
    #[cfg(not(unix))]
    pub(super) fn start(command: &mut Command) -> std::io::Result<Self> {
        Ok(Group { leader: command.spawn()?, status: None })
    }

    /// The program that leads the group.
    pub(super) const fn leader(&mut self) -> &mut Child {
        &mut self.leader
    }

    /// Waits at most `timeout` for the program to end; what it started may go on.
    pub(super) fn wait(&mut self, timeout: Duration) -> bool {
        let deadline = Instant::now() + timeout;
        while self.status.is_none() && !self.has_ended() {
            if Instant::now() >= deadline {
                return false;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
        true
    }

    /// Whether the program has ended, which leaves it to be waited for.
    #[cfg(unix)]
    fn has_ended(&self) -> bool {
        use rustix::process::{WaitId, WaitIdOptions, waitid};
        let look = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        guard::pid(self.leader.id()).is_none_or(|leader| !matches!(waitid(WaitId::Pid(leader), look), Ok(None)))
    }

    #[cfg(not(unix))]
    fn has_ended(&mut self) -> bool {
        self.status = self.leader.try_wait().ok().flatten();
        self.status.is_some()
    }

    /// Ends every process of the group, which has the time `mercy` to follow a request before it is killed. How the program ended, where
    /// the system says so.
    pub(super) fn end(&mut self, mercy: Duration) -> Option<ExitStatus> {
        if self.status.is_none() {
            self.signal(mercy);
            self.status = self.leader.wait().ok();
        }
        self.status
    }

    #[cfg(unix)]
    fn signal(&mut self, mercy: Duration) {
        use rustix::process::{Signal, kill_process_group, test_kill_process_group};
        let Some(group) = guard::pid(self.leader.id()) else { return };
        // Whoever has ended meanwhile cannot be signalled, which is no fault.
        let _ = kill_process_group(group, Signal::TERM);
        let deadline = Instant::now() + mercy;
        while Instant::now() < deadline {
            // Waiting for the leader lets its number go, unless others of the group still have it.
            if self.status.is_none() && self.has_ended() {
                self.status = self.leader.wait().ok();
            }
            if self.status.is_some() && test_kill_process_group(group).is_err() {
                self.guard.dismiss();
                return;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
        let _ = kill_process_group(group, Signal::KILL);
        self.guard.dismiss();
    }

    #[cfg(not(unix))]
    fn signal(&mut self, mercy: Duration) {
        if !self.wait(mercy) {
            let _ = self.leader.kill();
        }
    }
}

#[cfg(unix)]
mod guard {
    use rustix::process::Pid;
    use std::io::Write as _;
    use std::process::{Child, Command, Stdio};

    /// What the guard does. It reads the number of the group, and then a line that dismisses it. Where the pipe ends without that line, so
    /// has the program that held it: the group, whose input has ended as well, has a second to bring its machine to rest, and one after
    /// TERM.
    const SCRIPT: &str = "trap '' HUP INT QUIT TERM\nread -r group || exit 0\nread -r dismissed && exit 0\n\
                          sleep 1\nkill -TERM \"-$group\"\nsleep 1\nkill -KILL \"-$group\"";

    /// The process that outlives this program and ends its group.
    #[derive(Debug)]
    pub(super) struct Guard(Child);

    impl Guard {
        pub(super) fn start() -> std::io::Result<Self> {
            let mut command = Command::new("/bin/sh");
            command.args(["-c", SCRIPT]).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
            // What ends the group of this program does not end its guard.
            std::os::unix::process::CommandExt::process_group(&mut command, 0);
            command.spawn().map(Guard)
        }

        /// Names the group that is to be ended.
        pub(super) fn watch(&mut self, group: u32) {
            self.say(&format!("{group}\n"));
        }

        /// Lets the guard go: its group has been ended.
        pub(super) fn dismiss(&mut self) {
            self.say("dismissed\n");
        }

        /// A guard that was killed hears nothing, and nobody can do more about it.
        fn say(&mut self, line: &str) {
            if let Some(pipe) = &mut self.0.stdin {
                let _ = pipe.write_all(line.as_bytes());
            }
        }
    }

    impl Drop for Guard {
        fn drop(&mut self) {
            self.0.stdin = None;
            let _ = self.0.wait();
        }
    }

    /// The number of a process in the system's form.
    pub(super) fn pid(number: u32) -> Option<Pid> {
        i32::try_from(number).ok().and_then(Pid::from_raw)
    }
}
