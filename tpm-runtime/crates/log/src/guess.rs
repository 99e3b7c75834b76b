//! What may be meant where a signal has no column: a guess that a user is shown as something to paste, never one that is read.

use crate::columns::Holds;
use crate::error::LogError;
use crate::names::{Fitting, Names, Signal, Time, may_be_time, split_unit};
use crate::options::TIME;
use crate::unit::conversion;
use tpm_report::Remedy;

/// Parts of names of columns that hold quantities of a unit, in small letters.
const WORDS: [(&str, &[&str]); 8] = [
    ("rad", &["angle", "pos", "theta", "phi", "winkel", "enc", "joint", "sensor", "state"]),
    ("m", &["pos", "dist", "weg", "enc", "height", "sensor"]),
    ("rad/s", &["speed", "vel", "omega", "rate", "gyr", "drehzahl"]),
    ("m/s", &["speed", "vel", "geschw"]),
    ("V", &["volt", "pwm", "spannung", "drive", "cmd"]),
    ("A", &["curr", "amp", "strom"]),
    ("N", &["force", "load", "kraft"]),
    ("N*m", &["torque", "tau", "effort", "moment", "curr"]),
];

impl Names<'_> {
    /// A fault with the columns that may be meant by all signals that have none.
    pub(super) fn guessed(&self, mut fault: LogError, signals: &[Signal]) -> LogError {
        let guess = match &mut fault {
            LogError::MissingColumn { file, .. } => Some(&mut file.guess),
            LogError::AmbiguousColumn { guess, .. } => Some(&mut **guess),
            _ => None,
        };
        if let Some(guess) = guess {
            let of_file = || self.of_file().map(|(index, column)| (index, column.text.as_str()));
            let mut taken: Vec<usize> = Vec::new();
            let mut columns = Vec::new();
            let time = match self.time(&mut Vec::new()) {
                Ok(Time::One { index, .. }) => Some(index),
                Ok(_) => None,
                Err(LogError::AmbiguousColumn { columns, .. }) => {
                    of_file().find(|(_, own)| columns.contains(&(*own).into())).map(|of| of.0)
                }
                Err(_) => {
                    let rises = |index: usize| self.header[index].holds == Holds::Rising;
                    let named = of_file().find(|(index, own)| may_be_time(own) && rises(*index));
                    named.or_else(|| of_file().next().filter(|(index, _)| rises(*index))).map(|of| of.0)
                }
            };
            let has_time = self.time(&mut Vec::new()).is_ok();
            taken.extend(time);
            if let Some(index) = time.filter(|_| !has_time) {
                columns.push((TIME.to_owned(), self.header[index].text.clone()));
            }
            taken.extend(signals.iter().filter_map(|signal| Some(self.column(signal).ok()??.index)));
            for signal in signals.iter().filter(|signal| !matches!(self.column(signal), Ok(Some(_)))) {
                let wanted = self.wanted(&signal.name).to_lowercase();
                let in_unit = |index: usize| {
                    let (_, unit, bracketed) = split_unit(&self.header[index].text);
                    let unit = self.stated(&Fitting { index, unit, bracketed });
                    unit.zip(signal.unit.as_deref()).is_some_and(|((unit, _), own)| conversion(unit, own).is_ok())
                };
                let words =
                    WORDS.iter().find(|(unit, _)| Some(*unit) == signal.unit.as_deref()).map_or(&[][..], |of| of.1);
                type Fits<'f> = &'f dyn Fn(usize, &str) -> bool;
                let ways: [Fits<'_>; 5] = [
                    &|_, own| own == wanted,
                    &|_, own| wanted.len() > 1 && own.contains(&wanted),
                    &|index, _| in_unit(index),
                    &|_, own| words.iter().any(|word| own.contains(word)),
                    &|_, _| true,
                ];
                let is_free = |index: &usize| !taken.contains(index) && self.header[*index].holds != Holds::Few;
                let free = || of_file().filter(|(index, own)| is_free(index) && !may_be_time(own));
                let found = ways.iter().find_map(|fits| free().find(|(index, own)| fits(*index, &own.to_lowercase())));
                let found = found.map(|(index, own)| (index, own.to_owned()));
                taken.extend(found.iter().map(|of| of.0));
                columns.push((signal.name.clone(), found.map_or(String::new(), |of| of.1)));
            }
            *guess = Remedy::Columns { columns, timeless: time.is_none() && !has_time };
        }
        fault
    }
}
