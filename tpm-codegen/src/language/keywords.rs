//! The words of the language, and what each means.
//!
//! Invariant: a word for which the parser asks stands in [`KEYWORDS`], and no other does; a test reads the parser's source. Keywords
//! are contextual, so that a quantity may be called like any of them.

/// Statements of a model that begin with a word and a name.
pub(crate) const STATEMENTS: [&str; 13] = [
    "coordinate",
    "unmeasured",
    "presliding",
    "input",
    "parameter",
    "constant",
    "series",
    "let",
    "lump",
    "force",
    "eliminate",
    "taylor",
    "pattern",
];

/// Statements of a model that begin with a word and something else than a name, or with two words.
pub(crate) const OTHER_STATEMENTS: [&str; 5] = ["nonlinear", "kinetic", "potential", "dissipation", "mechanism"];

/// Statements of a pattern that begin with a word and a name or number.
pub(crate) const PATTERN_STATEMENTS: [&str; 3] = ["amplitude", "frequency", "harmonics"];

/// Statements of a mechanism.
pub(crate) const MECHANISM_STATEMENTS: [&str; 3] = ["gravity", "body", "drive"];

/// Statements of a body.
pub(crate) const BODY_STATEMENTS: [&str; 4] = ["fixed", "revolute", "prismatic", "inertia"];

/// Where a word belongs that begins no statement of a model: a statement of a block, or what other formats call something that the
/// language has under another name.
pub(crate) fn belongs(word: &str) -> Option<&'static str> {
    match word {
        _ if PATTERN_STATEMENTS.contains(&word) => Some("`pattern { ... }`"),
        _ if MECHANISM_STATEMENTS.contains(&word) => Some("`mechanism { ... }`"),
        _ if BODY_STATEMENTS.contains(&word) => Some("`mechanism { body NAME { ... } }`"),
        "link" => Some("`mechanism { body NAME { ... } }`, as a `body`"),
        "joint" => Some("`mechanism { body NAME { ... } }`, as `revolute q about z;` or `prismatic q along z;`"),
        _ => None,
    }
}

/// Every keyword with its use and its meaning, for editors.
pub const KEYWORDS: [(&str, &str, &str); 53] = [
    ("model", "model NAME { ... }", "a dynamics model; a file has one"),
    ("coordinate", "coordinate x [m], y [m];", "generalised coordinates, functions of the time"),
    (
        "unmeasured",
        "unmeasured y [m];",
        "coordinates that no sensor measures, which logs identify with the parameters by what other sensors feel of them",
    ),
    (
        "presliding",
        "presliding z of q over 0.001;",
        "how far dry friction has built up since a coordinate reversed, from -1 to 1: it follows from the motion, and has no sensor",
    ),
    ("of", "presliding z of q over 0.001;", "the coordinate that reverses"),
    (
        "over",
        "presliding z of q over 0.001;",
        "the travel over which all but 1/e of the friction builds up, in the unit of the coordinate",
    ),
    ("input", "input u [N];", "actuating forces, torques, voltages"),
    ("parameter", "parameter m [kg], k [N/m];", "numbers to be identified"),
    (
        "nonlinear",
        "nonlinear parameter vs [m/s] from 0.01 to 0.5;",
        "a parameter inside functions of the motion, identified from logs within an interval",
    ),
    ("constant", "constant g = 9.8 [m/s^2], th10 [rad];", "numbers that are known exactly, or at run time only"),
    ("let", "let s = x - x0;", "a name for an expression of what is defined above it"),
    ("kinetic", "kinetic = 1/2*m*dot(x)^2;", "the kinetic energy"),
    ("potential", "potential = 1/2*k*x^2;", "the potential energy"),
    ("dissipation", "dissipation = 1/2*c*dot(x)^2;", "Rayleigh's dissipation function"),
    ("force", "force q = ...;", "the generalised force on a coordinate; without one it is free"),
    ("series", "series f(q) [unit] about q0 order n as a0, ..., an;", "a function by its Taylor coefficients"),
    (
        "taylor",
        "taylor q about q0 order n;",
        "for tables: what does not expand finitely in q becomes a Taylor polynomial",
    ),
    ("lump", "lump NAME = m*L^2;", "a name for a lumped parameter"),
    ("eliminate", "eliminate x1, x2 as c;", "eliminates free coordinates; what remains has parameters c1, c2, ..."),
    ("pattern", "pattern NAME { ... }", "a reference motion; the name may be left out once"),
    (
        "amplitude",
        "amplitude lambda [m];",
        "an amplitude of a pattern; in `shape`, the coefficient of the lowest cosine",
    ),
    ("frequency", "frequency w [rad/s];", "the fundamental angular frequency of a pattern"),
    ("harmonics", "harmonics n;", "how many harmonics are kept of terms with infinitely many"),
    ("mechanism", "mechanism { ... }", "rigid bodies, joints and drives instead of equations"),
    ("gravity", "gravity (0, 0, -9.81);", "the acceleration of gravity in the frame of the base, m/s^2"),
    ("body", "body NAME on PARENT { ... }", "a rigid body; without `on` it stands on the base"),
    ("on", "body NAME on PARENT { ... }", "the body that this one stands on"),
    (
        "revolute",
        "revolute q about z at (x, y, z) turned (roll, pitch, yaw);",
        "the body turns by the coordinate q, or by a multiple of it, `1/2*q`",
    ),
    (
        "prismatic",
        "prismatic q along z at (x, y, z) turned (roll, pitch, yaw);",
        "the body slides by the coordinate q, or by a multiple of it, `-1*q`",
    ),
    ("fixed", "fixed at (x, y, z) turned (roll, pitch, yaw);", "the body moves with its parent"),
    ("inertia", "inertia parameters;", "what the body weighs: ten parameters, or known values"),
    ("parameters", "inertia parameters;", "the ten inertia parameters of the body are to be identified"),
    (
        "mass",
        "inertia mass m at (x, y, z) moments (Ixx, Ixy, Ixz, Iyy, Iyz, Izz);",
        "a known mass, kg, with its centre and its moments about that",
    ),
    ("moments", "moments (Ixx, Ixy, Ixz, Iyy, Iyz, Izz)", "known moments of inertia about the centre of mass, kg m^2"),
    ("at", "at (x, y, z)", "an origin in the frame of the parent, m"),
    ("turned", "turned (roll, pitch, yaw)", "turned about the fixed axes x, then y, then z"),
    ("about", "about z", "the axis of a joint, or the point of an expansion"),
    ("along", "along z", "the axis of a joint that slides"),
    ("drive", "drive q by INPUT with viscous, coulomb;", "what drives and brakes a joint"),
    ("by", "drive q by INPUT;", "the input that is the torque of a drive"),
    ("with", "with viscous, coulomb, offset, rotor", "the unknown torques of a drive"),
    ("viscous", "drive q with viscous;", "friction that grows with the velocity: parameter fv_q"),
    ("coulomb", "drive q with coulomb;", "dry friction: parameter fc_q"),
    ("offset", "drive q with offset;", "a constant torque: parameter f0_q"),
    ("rotor", "drive q with rotor;", "the inertia of the motor at the joint: parameter Ia_q"),
    ("load", "drive q with load;", "dry friction in proportion to the load: parameter fl_q"),
    (
        "near",
        "inertia parameters near (m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz);",
        "inertias with which the load of a drive is computed",
    ),
    ("from", "from 0.01 to 0.5", "the least value of a nonlinear parameter"),
    ("to", "from 0.01 to 0.5", "the largest value of a nonlinear parameter"),
    ("order", "order n", "the highest power that is kept"),
    ("as", "as a0, a1, ...", "the names of coefficients"),
    ("t", "cos(w*t)", "the time, s"),
    ("pi", "-pi/2", "the number pi"),
];

/// The words of a statement behind which an operand or a list begins; the statement by its first word.
pub(crate) fn clauses_of(statement: &str) -> &'static [&'static str] {
    match statement {
        "gravity" => &["gravity"],
        "revolute" => &["about", "at", "turned"],
        "prismatic" => &["along", "at", "turned"],
        "fixed" => &["at", "turned"],
        "inertia" => &["mass", "at", "turned", "moments", "near"],
        "drive" => &["by", "with"],
        "series" => &["about", "order", "as"],
        "taylor" => &["about", "order"],
        "eliminate" => &["as"],
        "nonlinear" => &["from", "to"],
        "presliding" => &["of", "over"],
        _ => &[],
    }
}

#[cfg(test)]
mod tests {
    use super::{BODY_STATEMENTS, KEYWORDS, MECHANISM_STATEMENTS, PATTERN_STATEMENTS, STATEMENTS, clauses_of};
    use crate::language::ast::EnergyKind;
    use crate::language::ast::mechanism::loss_word;
    use std::collections::BTreeSet;
    use tpm_symbolic::mechanics::tree::mechanism::Loss;

    /// The words that stand as literals where the parser compares a token with a word.
    fn asked(source: &'static str) -> impl Iterator<Item = &'static str> {
        ["word(", "before_axis("]
            .into_iter()
            .flat_map(move |call| source.split(call).skip(1))
            .filter_map(|inside| inside.split(')').next()?.split('"').nth(1))
    }

    #[test]
    fn the_keywords_are_the_words_that_the_parser_asks_for() {
        let mut parsed: BTreeSet<&str> = asked(include_str!("parse.rs")).collect();
        parsed.extend(asked(include_str!("parse/mechanism.rs")));
        assert!(parsed.contains("turned") && parsed.contains("along"), "the parser's source is read: {parsed:?}");
        parsed
            .extend(STATEMENTS.iter().chain(&PATTERN_STATEMENTS).chain(&MECHANISM_STATEMENTS).chain(&BODY_STATEMENTS));
        parsed.extend(EnergyKind::ALL.map(EnergyKind::keyword));
        parsed.extend(Loss::ALL.map(loss_word));
        // Words that the parser compares together with the token behind them, and the names that are always there.
        parsed.extend(["mechanism", "nonlinear", "t", "pi"]);
        let listed: BTreeSet<&str> = KEYWORDS.iter().map(|(word, ..)| *word).collect();
        assert_eq!(listed, parsed);
        assert_eq!(listed.len(), KEYWORDS.len(), "a word stands twice");
        for (word, usage, _) in KEYWORDS {
            assert!(usage.contains(word), "`{usage}` does not show `{word}`");
            assert!(clauses_of(word).iter().all(|clause| listed.contains(clause)));
        }
    }
}
