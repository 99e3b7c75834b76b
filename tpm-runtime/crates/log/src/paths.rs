//! Columns of recorders that name what is measured beside the joint: `position.elbow`, `/joint_states/effort/elbow`, `arm/elbow/velocity`.
//!
//! Invariant: a column is found only where no column has the signal's own name, and only where it is the only one that fits.

/// A quantity of a joint that a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Measured {
    Position,
    Velocity,
    Effort,
}

/// Words for what is measured, in small letters.
const WORDS: [(&str, Measured); 16] = [
    ("position", Measured::Position),
    ("positions", Measured::Position),
    ("pos", Measured::Position),
    ("angle", Measured::Position),
    ("velocity", Measured::Velocity),
    ("velocities", Measured::Velocity),
    ("vel", Measured::Velocity),
    ("speed", Measured::Velocity),
    ("rate", Measured::Velocity),
    ("effort", Measured::Effort),
    ("efforts", Measured::Effort),
    ("torque", Measured::Effort),
    ("torques", Measured::Effort),
    ("tau", Measured::Effort),
    ("force", Measured::Effort),
    ("forces", Measured::Effort),
];

/// Beginnings of the names of inputs that import gives to the drives of joints.
const DRIVES: [&str; 2] = ["tau_", "force_"];

fn measured(word: &str) -> Option<Measured> {
    let word = word.to_ascii_lowercase();
    WORDS.iter().find(|(own, _)| *own == word).map(|(_, measured)| *measured)
}

/// Whether the name of a column without its unit, a path of words between points, slashes or colons, ends in a signal.
pub(super) fn fits(column: &str, signal: &str) -> bool {
    let mut words: Vec<&str> = column.split(['.', '/', ':']).filter(|word| !word.is_empty()).collect();
    if words.len() < 2 {
        return false;
    }
    // The signal's own name at the end of the path, where the path does not say that something else of it is measured.
    let (joint, wanted) = of_signal(signal);
    let last_two = words.len() - 2;
    let said = words[last_two..].iter().position(|word| measured(word).is_some());
    let Some(said) = said else { return words.last() == Some(&signal) };
    let word = words.remove(last_two + said);
    let name = words.last().copied();
    measured(word) == Some(wanted) && (name == Some(joint) || name == Some(signal))
}

/// The joint of a signal, and what of it the signal is. An input is recognised by its name alone.
fn of_signal(signal: &str) -> (&str, Measured) {
    if let Some(joint) = signal.strip_prefix("dot(").and_then(|rest| rest.strip_suffix(')')) {
        return (joint, Measured::Velocity);
    }
    let drive = DRIVES.iter().find_map(|begin| signal.strip_prefix(begin));
    drive.map_or((signal, Measured::Position), |joint| (joint, Measured::Effort))
}

#[cfg(test)]
mod tests {
    use super::fits;

    #[test]
    fn paths_end_in_a_joint_and_what_is_measured_of_it() {
        for column in [
            "position.elbow",
            "/joint_states/position/elbow",
            "arm.elbow.pos",
            "/arm/elbow",
            "/js:position.elbow",
            "angle/elbow",
        ] {
            assert!(fits(column, "elbow"), "{column}");
            assert!(!fits(column, "dot(elbow)") && !fits(column, "tau_elbow") && !fits(column, "bow"), "{column}");
        }
        for column in ["velocity.elbow", "joint_states.elbow.velocity", "Velocity/elbow"] {
            assert!(fits(column, "dot(elbow)") && !fits(column, "elbow") && !fits(column, "tau_elbow"), "{column}");
        }
        for column in ["effort.elbow", "/joint_states/elbow/effort", "torque/elbow"] {
            assert!(fits(column, "tau_elbow") && fits(column, "force_elbow") && !fits(column, "elbow"), "{column}");
        }
        assert!(fits("/arm/tau_elbow", "tau_elbow") && fits("/arm/q1", "q1"));
        // A name alone is found elsewhere; a name that only ends in the same letters is another one.
        assert!(
            !fits("elbow", "elbow") && !fits("position.left_elbow", "elbow") && !fits("elbow.position.left", "elbow")
        );
    }
}
