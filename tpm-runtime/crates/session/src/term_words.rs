//! Terms that a model may lack in the words of the model language, with what each of them means; `q` is the name of a coordinate.

use crate::refinement_report::MissingTerm;
use std::borrow::Cow;
use tpm_controller::model::{Label, Model};
use tpm_estimate::{Lacking, TermKind};

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

/// A term that the model lacks in the words of the model.
pub(super) fn lacking(model: &dyn Model<f64>, lacking: &Lacking) -> MissingTerm {
    let name = |label: Label<'_>| label.name.to_string();
    let own = lacking.term;
    let q = || name(model.coordinate(own.of));
    let v = || format!("dot({})", q());
    let apart = || match own.other {
        Some(other) => (
            format!("({} - {})", q(), name(model.coordinate(other))),
            format!("(dot({}) - dot({}))", q(), name(model.coordinate(other))),
        ),
        None => (q(), v()),
    };
    let is_rate = own.kind.is_force() && own.other.is_none() && model.coordinate_order(own.of) == 1;
    let (term, meaning): Words = match own.kind {
        TermKind::Power(exponent) if is_rate => {
            (raised(q(), exponent), "damping, a loss or a drag that the model lacks".into())
        }
        TermKind::Play if is_rate => (format!("sign({})", q()), "dry (Coulomb) friction".into()),
        TermKind::Offset => offset(),
        TermKind::Friction => friction(&q()),
        TermKind::Stribeck => stribeck(&q()),
        TermKind::Presliding(_) => {
            (format!("presliding of {}", q()), "dry friction that builds up again after every reversal".into())
        }
        TermKind::RatePower(1) => (v(), "viscous damping".into()),
        TermKind::RatePower(exponent) => rate_power(&q(), exponent),
        TermKind::Drag => drag(&q()),
        TermKind::Power(1) => (q(), "a spring".into()),
        TermKind::Power(exponent) => power(&q(), exponent),
        TermKind::PositionFriction(exponent) => {
            (format!("{}*sign({})", raised(q(), exponent), v()), "dry friction that depends on the position".into())
        }
        TermKind::PositionDamping(exponent) => {
            (format!("{}*{}", raised(q(), exponent), v()), "damping that depends on the position".into())
        }
        TermKind::Inertia(0) => (format!("ddot({})", q()), "an inertia of its own, as that of a rotor".into()),
        TermKind::Inertia(exponent) => {
            (format!("{}*ddot({})", raised(q(), exponent), q()), "an inertia that depends on the position".into())
        }
        TermKind::Sine(multiple) => {
            (angle("sin", multiple, &q()), "a force that is a sine of the position, as gravity is".into())
        }
        TermKind::Cosine(multiple) => {
            (angle("cos", multiple, &q()), "a force that is a sine of the position, as gravity is".into())
        }
        TermKind::Ripple { half_waves, .. } => (
            format!("a ripple over {}, {half_waves} half waves in its range", q()),
            "cogging, or the ripple of a gear".into(),
        ),
        TermKind::Drift => ("time".into(), "a constant force that drifts".into()),
        TermKind::DriftingDamping => (format!("{} * time", v()), "damping that changes over the record (drift)".into()),
        TermKind::DriftingFriction => {
            (format!("sign({}) * time", v()), "dry friction that changes over the record (drift)".into())
        }
        TermKind::LoadFriction => {
            (format!("abs(force)*sign({})", v()), "dry friction in proportion to the force (gear)".into())
        }
        TermKind::Play => (format!("sign({})", q()), "play in a spring about zero".into()),
        TermKind::DeadZone => ("sign(force)".into(), "a dead zone of the input".into()),
        TermKind::Delay => {
            let input = name(model.input(own.of));
            let meaning = format!("{input} acts {:.3} ms later than it is recorded (delay)", 1e3 * lacking.value);
            (late(&input), meaning.into())
        }
        TermKind::InputGain => {
            let input = name(model.input(own.of));
            let meaning = format!(
                "what acts is {:.4} times the recorded {input}, as the other forces have it (gain of a sensor, or another unit)",
                lacking.value
            );
            (input, meaning.into())
        }
        TermKind::PositionOffset => {
            let unit = model.coordinate(own.of).unit.map_or_else(String::new, |unit| format!(" {unit}"));
            let meaning =
                format!("{} is by {:.3e}{unit} larger than it is recorded (offset of a sensor)", q(), lacking.value);
            (format!("derivative by {}", q()), meaning.into())
        }
        TermKind::PairPower(1) => (apart().0, "a spring between the coordinates".into()),
        TermKind::PairPower(exponent) => {
            (raised(apart().0, exponent), "a force between the coordinates that is not linear in their distance".into())
        }
        TermKind::PairDamping => (apart().1, "damping between the coordinates".into()),
        TermKind::PairAsymmetry => {
            (format!("abs{}", apart().1), "damping between the coordinates that differs with the direction".into())
        }
        TermKind::PairDrag => (format!("{0}*abs{0}", apart().1), "drag between the coordinates".into()),
        TermKind::PairPlay => (format!("sign{}", apart().0), "play in a spring between the coordinates".into()),
        TermKind::PairFriction => (format!("sign{}", apart().1), "dry friction between the coordinates".into()),
        TermKind::PairPositionDamping => (
            format!("{}*{}", apart().0, apart().1),
            "damping between the coordinates that depends on their distance".into(),
        ),
        TermKind::PairInertia => {
            let other = own.other.map_or_else(String::new, |other| name(model.coordinate(other)));
            (format!("ddot({other}) and ddot({})", q()), "an inertia that couples the coordinates".into())
        }
        TermKind::RelativeInertia => {
            let other = own.other.map_or_else(String::new, |other| name(model.coordinate(other)));
            let meaning =
                "an inertia between the coordinates, as that of a beam which turns when its ends do not move alike";
            (format!("(ddot({}) - ddot({other}))", q()), meaning.into())
        }
        TermKind::Chain { even, against } => {
            let function = if even { "cos" } else { "sin" };
            let angles: Vec<String> =
                (own.of..=own.other.unwrap_or(own.of)).map(|c| name(model.coordinate(c))).collect();
            let sum = angles.join(if against { " - " } else { " + " });
            let meaning =
                "a force that is a sine of this angle, as gravity of a link, in the rows of all of its joints";
            (format!("{function}({sum})"), meaning.into())
        }
        TermKind::Limit => (
            format!("{0} beyond {1:.4}", name(model.input(own.of)), lacking.value),
            format!("clipping: the input is limited (saturation) at about {:.4}", lacking.value).into(),
        ),
        TermKind::Reading { multiple, .. } => {
            let often = if multiple == 1 { "once".to_owned() } else { format!("{multiple} times") };
            let unit = model.coordinate(own.of).unit.map_or_else(String::new, |unit| format!(" {unit}"));
            let meaning = format!(
                "the reading of {} errs by {:.3e}{unit} {often} a turn (a wheel that is not centred)",
                q(),
                lacking.value.abs()
            );
            (format!("{} on its reading", angle("sin", multiple, &q())), meaning.into())
        }
        TermKind::Backlash => (
            format!("sign({}) on its reading", v()),
            format!("backlash or hysteresis between machine and sensor, {:.3e} to either side", lacking.value.abs())
                .into(),
        ),
        _ => ("a term".into(), "".into()),
    };
    MissingTerm {
        of: own,
        term,
        row: own.row.map(|row| name(model.row(row))),
        value: lacking.value,
        std: lacking.std,
        gain: lacking.gain,
        meaning: meaning.into_owned(),
    }
}

fn angle(function: &str, multiple: u32, coordinate: &str) -> String {
    if multiple == 1 { format!("{function}({coordinate})") } else { format!("{function}({multiple}*{coordinate})") }
}

/// A factor to a power.
fn raised(of: String, exponent: u32) -> String {
    if exponent == 1 { of } else { format!("{of}^{exponent}") }
}
