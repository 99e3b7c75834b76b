//! Stamps that are dates with times of day, as ISO 8601 writes them: `2026-03-01T10:00:00.125+01:00`.
//!
//! Between date and time stands a `T` or a blank, the date may be separated by `-` or `/`, seconds and their fraction may be missing, and
//! a zone may follow: `Z`, `+01:00`, `+0100` or `+01`. A stamp without a zone is read as one of UTC: only differences are used.

use crate::stamps::last_digit;

/// A date with a time of day.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Date {
    /// Whole seconds since 1970 in UTC.
    pub(super) seconds: i64,
    /// The fraction of a second.
    pub(super) fraction: f64,
    /// Value of one unit in the last digit, s.
    pub(super) last_digit: f64,
}

/// A whole number of so many digits at the beginning of a text, and the rest.
fn digits(text: &str, count: usize) -> Option<(i64, &str)> {
    let head = text.get(..count).filter(|head| head.bytes().all(|byte| byte.is_ascii_digit()))?;
    Some((head.parse().ok()?, &text[count..]))
}

/// Days from 1970-01-01 to a date of the Gregorian calendar, counted in years that begin with March.
fn days(year: i64, month: i64, day: i64) -> Option<i64> {
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let lengths = [31, if leap { 29 } else { 28 }, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let length = usize::try_from(month - 1).ok().and_then(|at| lengths.get(at))?;
    if day < 1 || day > *length {
        return None;
    }
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let century = year.div_euclid(100);
    Some(year * 365 + year.div_euclid(4) - century + century.div_euclid(4) + (153 * month + 2) / 5 + day - 1 - 719_468)
}

/// Seconds by which the clock of a zone is ahead of UTC.
fn zone(text: &str) -> Option<i64> {
    let text = text.trim();
    if text.is_empty() || text.eq_ignore_ascii_case("z") || text.eq_ignore_ascii_case("utc") {
        return Some(0);
    }
    let sign = match text.as_bytes()[0] {
        b'+' => 1,
        b'-' => -1,
        _ => return None,
    };
    let (hours, rest) = digits(&text[1..], 2)?;
    let rest = rest.strip_prefix(':').unwrap_or(rest);
    let (minutes, rest) = if rest.is_empty() { (0, rest) } else { digits(rest, 2)? };
    (rest.is_empty() && hours < 24 && minutes < 60).then_some(sign * (3_600 * hours + 60 * minutes))
}

impl Date {
    /// The date in a field; nothing for any other text.
    pub(super) fn of(field: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(field).ok()?;
        let (year, rest) = digits(text, 4)?;
        let mark = rest.chars().next().filter(|mark| matches!(mark, '-' | '/'))?;
        let (month, rest) = digits(&rest[1..], 2)?;
        let (day, rest) = digits(rest.strip_prefix(mark)?, 2)?;
        let rest = rest.strip_prefix(['T', 't', ' '])?;
        let (hour, rest) = digits(rest, 2)?;
        let (minute, rest) = digits(rest.strip_prefix(':')?, 2)?;
        let (second, rest) = match rest.strip_prefix(':') {
            Some(rest) => digits(rest, 2)?,
            None => (0, rest),
        };
        let (fraction, unit, rest) = match rest.strip_prefix(['.', ',']) {
            Some(decimals) => {
                let count = decimals.bytes().take_while(u8::is_ascii_digit).count();
                let text = format!("0.{}", &decimals[..count]);
                (text.parse::<f64>().ok().filter(|_| count > 0)?, last_digit(text.as_bytes(), b'.'), &decimals[count..])
            }
            None => (0.0, 1.0, rest),
        };
        if hour > 23 || minute > 59 || second > 60 {
            return None;
        }
        let seconds = 86_400 * days(year, month, day)? + 3_600 * hour + 60 * minute + second - zone(rest)?;
        Some(Date { seconds, fraction, last_digit: unit })
    }
}

#[cfg(test)]
mod tests {
    use super::Date;

    fn seconds(text: &str) -> Option<i64> {
        Date::of(text.as_bytes()).map(|date| date.seconds)
    }

    #[test]
    fn dates_are_counted_from_1970() {
        // From `date -u -d ... +%s`.
        for (text, since) in [
            ("1970-01-01T00:00:00Z", 0),
            ("2000-02-29 12:34:56", 951_827_696),
            ("2000/03/01 00:00:00", 951_868_800),
            ("2026-03-01T10:00", 1_772_359_200),
            ("2026-03-01T11:00:00+01:00", 1_772_359_200),
            ("2026-03-01T04:30:00-0530", 1_772_359_200),
            ("1969-12-31T23:59:59Z", -1),
        ] {
            assert_eq!(seconds(text), Some(since), "{text}");
        }
        let date = Date::of(b"2026-03-01 10:00:00.000250+01").expect("a date");
        assert_eq!((date.seconds, date.fraction, date.last_digit), (1_772_355_600, 0.00025, 1e-6));
    }

    #[test]
    fn what_is_no_date_is_none() {
        for text in [
            "",
            "2026",
            "2026-03-01",
            "2026-02-29 10:00",
            "2026-13-01 10:00",
            "2026-03-01 25:00",
            "2026-03/01 10:00",
            "2026-03-01 10:00:00.",
            "2026-03-01 10:00 PST",
            "2026-03-01 10:00:00+1",
            "1.5",
            "é026-03-01 10:00",
        ] {
            assert_eq!(seconds(text), None, "{text}");
        }
    }
}
