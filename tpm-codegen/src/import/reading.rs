//! Exact numbers of a description, and the recognition of rounded ones.

use std::collections::{BTreeMap, BTreeSet};

use num_traits::{ToPrimitive, Zero};
use tpm_symbolic::mechanics::tree::rotation::{self, Angle};
use tpm_symbolic::number::rational::{self, Rational};

use crate::import::options::Angles;
use crate::near;
use crate::source::{Source, Span};

/// Largest distance of an angle from a multiple of pi/2 at which it is read as this multiple, rad.
const RIGHT: f64 = 1e-4;
/// Smallest nonzero length, m. Smaller ones are read as zero, since they remain of rotations by rounded angles in
/// computer-aided design.
pub(super) const NO_LENGTH: f64 = 1e-12;
/// Largest angle, rad: of larger ones too few digits are left once whole turns are subtracted.
const LARGEST_ANGLE: i64 = 1_000_000;
/// Rounding of an angle that was computed, rad.
pub(super) const ROUNDING: f64 = 1e-12;
/// Most angles that a sentence lists.
const MOST_ANGLES: usize = 5;
/// Half a turn, rad.
const PI: f64 = std::f64::consts::PI;

/// An exact number with its text in the language.
#[derive(Clone, Debug)]
pub(super) struct Exact {
    pub(super) value: Rational,
    pub(super) text: String,
}

impl Exact {
    pub(super) fn zero() -> Self {
        Self { value: Rational::zero(), text: "0".to_owned() }
    }

    /// The number of a decimal as written, or of a quotient.
    pub(super) fn new(value: Rational, written: &str) -> Self {
        if value.is_zero() {
            return Self::zero();
        }
        let digits = written.strip_prefix('-').unwrap_or(written);
        let (mantissa, exponent) = digits.split_once(['e', 'E']).unwrap_or((digits, "0"));
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, "0"));
        let plain = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        let literal = plain(whole) && plain(fraction) && plain(exponent.trim_start_matches(['-', '+']));
        let text = if literal { written.to_owned() } else { value.to_string() };
        Self { value, text }
    }
}

/// An angle with its text in the language.
#[derive(Clone, Debug)]
pub(super) struct ExactAngle {
    pub(super) angle: Angle,
    pub(super) text: String,
}

impl ExactAngle {
    pub(super) fn zero() -> Self {
        Self { angle: Angle::quarter_turns(0), text: "0".to_owned() }
    }

    pub(super) fn is_zero(&self) -> bool {
        self.text == "0"
    }
}

/// Whether a number can be an angle in rad.
pub(super) fn is_angle(value: &Rational) -> bool {
    rational::abs(value) <= rational::integer(LARGEST_ANGLE)
}

/// Numbers that were read as values other than the written ones: places by text and meaning.
pub(super) struct Readings<'a> {
    source: &'a Source,
    angles: Angles,
    found: BTreeMap<(String, String), Vec<usize>>,
    /// Angles that were read as neighbours with a rational cosine and sine: lines by text.
    neighbours: BTreeMap<String, Vec<usize>>,
    /// What else there is to say.
    remarks: Vec<String>,
}

impl<'a> Readings<'a> {
    pub(super) fn new(source: &'a Source, angles: Angles) -> Self {
        Self { source, angles, found: BTreeMap::new(), neighbours: BTreeMap::new(), remarks: Vec::new() }
    }

    /// Adds a sentence to those of the readings.
    pub(super) fn remark(&mut self, sentence: String) {
        self.remarks.push(sentence);
    }

    fn note(&mut self, written: &str, meaning: &str, span: Span) {
        let line = self.source.position(span.start).line;
        self.found.entry((written.to_owned(), meaning.to_owned())).or_default().push(line);
    }

    /// One sentence for every text and what it was read as, and one for all angles whose cosine and sine were made rational: the quotient
    /// of two numbers of eight digits that stands for such an angle in the model says nothing to a reader.
    pub(super) fn sentences(&self) -> Vec<String> {
        let mut sentences: Vec<(usize, String)> = Vec::new();
        for ((written, meaning), lines) in &self.found {
            sentences.push((lines[0], format!("{written} is read as {meaning} ({})", places(lines))));
        }
        let all: Vec<usize> = self.neighbours.values().flatten().copied().collect();
        if let Some(first) = all.iter().min() {
            let texts: Vec<&str> = self.neighbours.keys().map(String::as_str).collect();
            let sentence = match texts[..] {
                [text] => format!(
                    "{text} is read as an angle with a rational cosine and sine, which differs from it by rounding"
                ),
                _ => {
                    let (told, rest) = texts.split_at(texts.len().min(MOST_ANGLES));
                    let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
                    let told = told.join(", ");
                    format!(
                        "{told}{more} are read as angles with rational cosines and sines, which differ from them by rounding"
                    )
                }
            };
            sentences.push((*first, format!("{sentence} ({})", places(&all))));
        }
        sentences.sort();
        sentences.into_iter().map(|(_, sentence)| sentence).chain(self.remarks.iter().cloned()).collect()
    }

    /// A length; a length below [`NO_LENGTH`] is read as zero.
    pub(super) fn length(&mut self, value: Rational, written: &str, span: Span) -> Exact {
        let size = rational::to_f64(&value).abs();
        if self.angles == Angles::Recognised && size > 0.0 && size < NO_LENGTH {
            self.note(written, "0", span);
            return Exact::zero();
        }
        Exact::new(value, written)
    }

    /// An angle whose cosine and sine are rational, near one that [`is_angle`].
    pub(super) fn angle(&mut self, value: &Rational, written: &str, span: Span) -> ExactAngle {
        if value.is_zero() {
            return ExactAngle::zero();
        }
        let radians = rational::to_f64(value);
        let quarters = (radians / (PI / 2.0)).round();
        let is_right = (radians - quarters * (PI / 2.0)).abs() <= RIGHT;
        if let Some(count) = quarters.to_i64().filter(|_| is_right && self.angles == Angles::Recognised) {
            let text = quarter_turns(count);
            self.note(written, &text, span);
            return ExactAngle { angle: Angle::quarter_turns(count), text };
        }
        // Whole turns are subtracted, so that the tangent of the half angle is small.
        let turned = (radians / (2.0 * PI)).round();
        let tangent = near::rational(((radians - turned * 2.0 * PI) / 2.0).tan()).unwrap_or_else(Rational::zero);
        let text = format!("2*atan2({}, {})", tangent.numer(), tangent.denom());
        let line = self.source.position(span.start).line;
        self.neighbours.entry(written.to_owned()).or_default().push(line);
        ExactAngle { angle: Angle::half_tangent(&tangent), text }
    }

    /// An angle that was computed, from a quaternion for example, so that its last digits are rounding: within [`ROUNDING`] of a multiple
    /// of pi/2 it is this multiple, however numbers are read.
    pub(super) fn computed(&mut self, radians: f64, span: Span) -> ExactAngle {
        let quarters = (radians / (PI / 2.0)).round();
        if (radians - quarters * (PI / 2.0)).abs() <= ROUNDING
            && let Some(count) = quarters.to_i64()
        {
            return ExactAngle { angle: Angle::quarter_turns(count), text: quarter_turns(count) };
        }
        let written = radians.to_string();
        let value = rational::parse(&written).unwrap_or_else(Rational::zero);
        self.angle(&value, &written, span)
    }

    /// A rational unit vector along an axis that is not zero, with the texts of its components.
    pub(super) fn axis(&mut self, axis: &[Exact; 3], written: &str, span: Span) -> ([Rational; 3], String) {
        let direction = axis.each_ref().map(|component| component.value.clone());
        let letters = ["x", "y", "z"];
        if let Some(unit) = rotation::unit_vector(&direction) {
            let single = unit.iter().position(|component| rational::abs(component) == rational::integer(1));
            let text = match single {
                Some(index) if unit[index] < Rational::zero() => format!("-{}", letters[index]),
                Some(index) => letters[index].to_owned(),
                None => format!("({}, {}, {})", axis[0].text, axis[1].text, axis[2].text),
            };
            return (unit, text);
        }
        // Components are scaled before they are rounded to floats, whose squares have an end.
        let largest = direction.iter().map(rational::abs).max().unwrap_or_else(Rational::zero);
        let scaled = direction.map(|component| rational::to_f64(&(component / &largest)));
        let unit = near::unit_vector(scaled).expect("invariant: the largest component is 1");
        let text = format!("({}, {}, {})", unit[0], unit[1], unit[2]);
        self.note(&format!("the axis {written}"), &format!("the unit vector {text}"), span);
        (unit, text)
    }
}

/// Lines in words, each once, in ascending order.
fn places(lines: &[usize]) -> String {
    let lines: BTreeSet<usize> = lines.iter().copied().collect();
    let texts: Vec<String> = lines.iter().map(ToString::to_string).collect();
    format!("line{} {}", if texts.len() == 1 { "" } else { "s" }, texts.join(", "))
}

/// Quarter turns in the language.
fn quarter_turns(count: i64) -> String {
    let sign = if count < 0 { "-" } else { "" };
    match count.unsigned_abs() {
        0 => "0".to_owned(),
        1 => format!("{sign}pi/2"),
        2 => format!("{sign}pi"),
        size if size % 2 == 0 => format!("{sign}{}*pi", size / 2),
        size => format!("{sign}{size}*pi/2"),
    }
}
