//! What the program of a machine said, from which a run is read without the program.

use crate::process::child::next_line;
use crate::process::protocol::LONGEST_OTHER;
use crate::process::talk::{Heard, Partner};
use std::cell::{Cell, RefCell};
use std::io::Cursor;
use std::time::Duration;

/// All lines of a program, in their order. What it is told, it does not hear.
pub(super) struct Transcript {
    said: RefCell<Cursor<Vec<u8>>>,
    longest: Cell<usize>,
}

impl Transcript {
    /// The output of a program.
    pub(super) const fn new(said: Vec<u8>) -> Self {
        Transcript { said: RefCell::new(Cursor::new(said)), longest: Cell::new(LONGEST_OTHER) }
    }
}

impl Partner for Transcript {
    fn allow(&self, longest: usize) {
        self.longest.set(longest);
    }

    fn say(&self, _: String) {}

    fn hear(&self, _: Duration, _: &dyn Fn() -> bool) -> Heard {
        next_line(&mut *self.said.borrow_mut(), || self.longest.get())
    }

    fn ending(&mut self) -> String {
        "ended".to_string()
    }

    fn last_words(&self) -> String {
        String::new()
    }
}
