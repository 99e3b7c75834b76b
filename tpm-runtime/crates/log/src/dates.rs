//! Stamps that are dates with times of day, as ISO 8601 writes them: `2026-03-01T10:00:00.125+01:00`.
//!
//! Between date and time stands a `T` or a blank, the date may be separated by `-` or `/`, or be written as `01.03.2026`, seconds and their
//! fraction may be missing, and a zone may follow: `Z`, `+01:00`, `+0100` or `+01`. A stamp without a zone is read as one of UTC: only differences are used.
//! A time of day alone, with its seconds, is one of the first day: `10:00:00.125`.

use crate::stamps::last_digit;
use chrono::{DateTime, NaiveDateTime};

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

impl Date {
    /// The date in a field; nothing for any other text.
    pub(super) fn of(field: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(field).ok()?.trim();
        if text.as_bytes().get(2) == Some(&b':') && text.as_bytes().get(5) == Some(&b':') {
            return Date::of(format!("1970-01-01 {text}").as_bytes());
        }
        let (date, time) = text.split_at_checked(10).filter(|_| text.as_bytes()[0].is_ascii_digit())?;
        let time = time.strip_prefix(['T', 't', ' '])?.trim_start();
        // The digits of the clock, of the fraction and the zone.
        let clock = time.find(|sign: char| !sign.is_ascii_digit() && sign != ':').unwrap_or(time.len());
        let (clock, rest) = time.split_at(clock);
        let (decimals, zone) = match rest.strip_prefix(['.', ',']) {
            Some(rest) => rest.split_at(rest.find(|sign: char| !sign.is_ascii_digit()).unwrap_or(rest.len())),
            None => ("0", rest),
        };
        if decimals.is_empty() {
            return None;
        }
        let (date_form, separator, digits) = match date.as_bytes()[4] {
            b'/' => ("%Y/%m/%d", "/", [4, 2, 2]),
            b'-' => ("%Y-%m-%d", "-", [4, 2, 2]),
            _ => ("%d.%m.%Y", ".", [2, 2, 4]),
        };
        let clock_form = if clock.len() > 5 { "%H:%M:%S" } else { "%H:%M" };
        // Years of four digits and months and days of two; the library would take fewer.
        if date.split(separator).map(str::len).ne(digits) || !matches!(clock.len(), 5 | 8) {
            return None;
        }
        let (text, form) = (format!("{date} {clock}"), format!("{date_form} {clock_form}"));
        let seconds = match zone.trim() {
            "" | "Z" | "z" | "UTC" => NaiveDateTime::parse_from_str(&text, &form).ok()?.and_utc().timestamp(),
            zone => DateTime::parse_from_str(&format!("{text} {zone}"), &format!("{form} %#z")).ok()?.timestamp(),
        };
        let fraction = format!("0.{decimals}");
        let unit = if rest.len() > zone.len() { last_digit(fraction.as_bytes(), b'.') } else { 1.0 };
        Some(Date { seconds, fraction: fraction.parse().ok()?, last_digit: unit })
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
