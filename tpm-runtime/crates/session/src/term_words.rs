//! Terms that a model may lack in the words of the model language, with what each of them means; `q` is the name of a coordinate.

use std::borrow::Cow;

/// A term, and its meaning.
pub(super) type Words = (String, Cow<'static, str>);

/// An input that acts later than it is recorded.
pub(super) fn late(input: &str) -> String {
    format!("rate of {input}")
}

pub(super) fn offset() -> Words {
    ("1".into(), "a constant force, or an offset of a sensor or an input".into())
}

pub(super) fn power(q: &str, exponent: u32) -> Words {
    (format!("{q}^{exponent}"), "a force that is not linear in the position".into())
}

pub(super) fn rate_power(q: &str, exponent: u32) -> Words {
    (format!("dot({q})^{exponent}"), "a force that is not linear in the velocity".into())
}

pub(super) fn drag(q: &str) -> Words {
    (format!("dot({q})*abs(dot({q}))"), "drag that grows with the square of the velocity".into())
}

pub(super) fn friction(q: &str) -> Words {
    (format!("sign(dot({q}))"), "dry (Coulomb) friction".into())
}

pub(super) fn stribeck(q: &str) -> Words {
    (format!("sign(dot({q}))*exp(-(dot({q})/vs)^2)"), "friction that is larger at low speed (Stribeck)".into())
}
