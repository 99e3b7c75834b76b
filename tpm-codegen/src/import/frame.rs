//! Orientations of MJCF as roll, pitch and yaw.

/// A rotation matrix, by rows.
pub(super) type Turn = [[f64; 3]; 3];

pub(super) const NONE: Turn = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

pub(super) fn product(a: &Turn, b: &Turn) -> Turn {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// A vector of length one; nothing for zero.
fn unit(vector: [f64; 3]) -> Option<[f64; 3]> {
    let length = vector.iter().map(|component| component * component).sum::<f64>().sqrt();
    (length > 0.0 && length.is_finite()).then(|| vector.map(|component| component / length))
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The rotation of a quaternion (w, x, y, z) of any length but zero.
pub(super) fn of_quaternion(parts: [f64; 4]) -> Option<Turn> {
    let square: f64 = parts.iter().map(|part| part * part).sum();
    let [w, x, y, z] = parts;
    // Divided once, so that 0.7071 0.7071 0 0 is a right angle.
    let of = |a: f64, b: f64| 2.0 * (a + b) / square;
    let on = |a: f64, b: f64| (square - 2.0 * (a + b)) / square;
    (square > 0.0 && square.is_finite()).then(|| {
        [
            [on(y * y, z * z), of(x * y, -w * z), of(x * z, w * y)],
            [of(x * y, w * z), on(x * x, z * z), of(y * z, -w * x)],
            [of(x * z, -w * y), of(y * z, w * x), on(x * x, y * y)],
        ]
    })
}

/// The rotation by an angle about an axis; nothing for an axis of zero.
pub(super) fn about(axis: [f64; 3], angle: f64) -> Option<Turn> {
    let [x, y, z] = unit(axis)?;
    let (sin, cos) = (0.5 * angle).sin_cos();
    of_quaternion([cos, sin * x, sin * y, sin * z])
}

/// The rotation by three angles in a sequence of axes: small letters about axes that turn along, capital ones about axes at rest.
pub(super) fn of_euler(angles: [f64; 3], sequence: &str) -> Option<Turn> {
    let letters: Vec<char> = sequence.chars().collect();
    if letters.len() != 3 {
        return None;
    }
    let mut turn = NONE;
    for (letter, angle) in letters.into_iter().zip(angles) {
        let mut axis = [0.0; 3];
        axis["xyz".find(letter.to_ascii_lowercase())?] = 1.0;
        let own = about(axis, angle)?;
        turn = if letter.is_ascii_lowercase() { product(&turn, &own) } else { product(&own, &turn) };
    }
    Some(turn)
}

/// The rotation to a frame with these axes x and y, of which the second is made orthogonal to the first.
pub(super) fn of_axes(x: [f64; 3], y: [f64; 3]) -> Option<Turn> {
    let x = unit(x)?;
    let along: f64 = x.iter().zip(y).map(|(a, b)| a * b).sum();
    let y = unit(std::array::from_fn(|i| y[i] - along * x[i]))?;
    let z = cross(x, y);
    Some(std::array::from_fn(|i| [x[i], y[i], z[i]]))
}

/// The shortest rotation from the z axis to a direction.
pub(super) fn of_z_axis(direction: [f64; 3]) -> Option<Turn> {
    let z = unit(direction)?;
    let axis = cross([0.0, 0.0, 1.0], z);
    let sine = axis.iter().map(|component| component * component).sum::<f64>().sqrt();
    let angle = sine.atan2(z[2]);
    // Upside down, every horizontal axis is shortest; MuJoCo takes x.
    if sine < 1e-10 { about([1.0, 0.0, 0.0], angle) } else { about(axis, angle) }
}

/// Roll, pitch and yaw of a rotation. Where the pitch is upright, yaw is zero; the roll is taken from what the yaw leaves, so that the
/// three together are as exact as the rotation.
pub(super) fn roll_pitch_yaw(turn: &Turn) -> [f64; 3] {
    let level = turn[0][0].hypot(turn[1][0]);
    let pitch = (-turn[2][0]).atan2(level);
    let yaw = if level < 1e-9 { 0.0 } else { turn[1][0].atan2(turn[0][0]) };
    let (sin, cos) = yaw.sin_cos();
    let roll = (sin * turn[0][2] - cos * turn[1][2]).atan2(cos * turn[1][1] - sin * turn[0][1]);
    [roll, pitch, yaw]
}

#[cfg(test)]
mod tests {
    use super::{Turn, about, of_axes, of_euler, of_quaternion, of_z_axis, product, roll_pitch_yaw};
    use std::f64::consts::{FRAC_PI_2, PI};

    fn turned(turn: &Turn, vector: [f64; 3]) -> [f64; 3] {
        turn.map(|row| row.iter().zip(vector).map(|(entry, component)| entry * component).sum())
    }

    fn near(a: &Turn, b: &Turn) -> bool {
        a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-14)
    }

    /// Rz(yaw) Ry(pitch) Rx(roll).
    fn again([roll, pitch, yaw]: [f64; 3]) -> Turn {
        let axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
        let turns = axes.into_iter().zip([yaw, pitch, roll]).map(|(axis, angle)| about(axis, angle).expect("an axis"));
        turns.reduce(|a, b| product(&a, &b)).expect("three")
    }

    #[test]
    fn angles_give_the_rotation_again_near_upright_too() {
        let quaternions = [
            [1.0, 0.0, 0.0, 0.0],
            [0.7, 0.0, 0.7, 0.0],
            [0.5, 0.5, 0.5, 0.5],
            [0.3, -0.4, 0.2, 0.9],
            [0.7, 1e-9, 0.7, 3e-7],
            [0.6, 0.1, -0.6, 0.1000001],
        ];
        for parts in quaternions {
            let turn = of_quaternion(parts).expect("not zero");
            assert!(near(&again(roll_pitch_yaw(&turn)), &turn), "{parts:?}");
        }
        let upright = roll_pitch_yaw(&of_quaternion([0.7, 0.0, 0.7, 0.0]).expect("not zero"));
        assert!((upright[1] - FRAC_PI_2).abs() < 1e-15 && upright[0] == 0.0 && upright[2] == 0.0, "{upright:?}");
    }

    #[test]
    fn spellings_of_one_orientation_agree() {
        // A quarter turn about z.
        let quarter = of_quaternion([1.0, 0.0, 0.0, 1.0]).expect("not zero");
        assert!(near(&about([0.0, 0.0, 2.0], FRAC_PI_2).expect("an axis"), &quarter));
        assert!(near(&of_axes([0.0, 3.0, 0.0], [-1.0, 5.0, 0.0]).expect("axes"), &quarter));
        assert!(near(&of_euler([0.0, 0.0, FRAC_PI_2], "xyz").expect("a sequence"), &quarter));
        // The same turns, written about axes that turn along and, in the other order, about axes at rest.
        let along = of_euler([0.1, 0.2, 0.3], "xyz").expect("a sequence");
        assert!(near(&along, &of_euler([0.3, 0.2, 0.1], "ZYX").expect("a sequence")));
        assert!(near(&of_euler([0.1, 0.2, 0.3], "XYZ").expect("a sequence"), &again([0.1, 0.2, 0.3])));
        let down = of_z_axis([0.0, 0.0, -1.0]).expect("an axis");
        assert!(near(&down, &about([1.0, 0.0, 0.0], PI).expect("an axis")));
        let tilted = turned(&of_z_axis([0.6, 0.0, 0.8]).expect("an axis"), [0.0, 0.0, 1.0]);
        assert!((tilted[0] - 0.6).abs() < 1e-15 && (tilted[2] - 0.8).abs() < 1e-15);
        assert_eq!((of_quaternion([0.0; 4]), of_z_axis([0.0; 3]), of_euler([0.0; 3], "xyw")), (None, None, None));
    }
}
