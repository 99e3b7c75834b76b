//! Masses and moments of the shapes (`geom`) of a body, as MuJoCo finds them where the body has no `inertial`.

use super::{Walk, decimal, sum};
use crate::diagnostic::Diagnostic;
use crate::import::description::{Inertial, Origin};
use crate::import::elements::{number, span};
use crate::import::frame;
use num_traits::Zero;
use roxmltree::Node;
use tpm_symbolic::number::rational::{self, Rational, integer, ratio};

/// The help for a shape whose mass is not known.
const WEIGH: &str = "add an `inertial` to the body, or give the shape no mass (`mass=\"0\"`) where it is only seen";

/// A shape filled evenly.
struct Solid {
    volume: Rational,
    /// Moments about the centre over the mass, along the shape's own axes.
    spread: [Rational; 3],
}

/// Volume and spread of a shape; the sizes are half lengths and radii, as MuJoCo orders them. `None` for what is no solid, or has too few sizes.
fn solid(kind: &str, sizes: &[Rational]) -> Option<Solid> {
    let square = |value: &Rational| value * value;
    let thirds = |count: i64| ratio(count, 3) * decimal(std::f64::consts::PI);
    Some(match (kind, sizes) {
        ("sphere", [r, ..]) => {
            Solid { volume: thirds(4) * r * square(r), spread: std::array::from_fn(|_| ratio(2, 5) * square(r)) }
        }
        ("ellipsoid" | "box", [a, b, c, ..]) => {
            let (volume, share) = if kind == "box" { (integer(8), ratio(1, 3)) } else { (thirds(4), ratio(1, 5)) };
            let [x, y, z] = [a, b, c].map(square);
            Solid { volume: volume * a * b * c, spread: [&y + &z, &x + &z, &x + &y].map(|sum| sum * &share) }
        }
        ("cylinder", [r, h, ..]) => {
            let across = ratio(1, 4) * square(r) + ratio(1, 3) * square(h);
            Solid { volume: thirds(6) * square(r) * h, spread: [across.clone(), across, ratio(1, 2) * square(r)] }
        }
        ("capsule", [r, h, ..]) => {
            let (rod, ball) = (solid("cylinder", sizes)?, solid("sphere", sizes)?);
            let volume = &rod.volume + &ball.volume;
            if volume.is_zero() {
                return None;
            }
            let share = &ball.volume / &volume;
            // The half balls stand at the ends: by Steiner's theorem, to their common centre and back to their own.
            let ends = square(h) + ratio(3, 4) * r * h;
            let of = |axis: usize| {
                let moved = if axis < 2 { ends.clone() } else { Rational::zero() };
                (integer(1) - &share) * &rod.spread[axis] + &share * (&ball.spread[axis] + moved)
            };
            Solid { spread: std::array::from_fn(of), volume }
        }
        _ => return None,
    })
}

impl<'a, 'i> Walk<'_, '_, '_, '_, 'a, 'i> {
    /// What a shape adds to its body, whose link has its origin at `at`: nothing where it has no mass; a fault where its mass is not known.
    pub(super) fn shape(
        &mut self,
        geom: Node<'a, 'i>,
        class: Option<&'a str>,
        at: &[Rational; 3],
    ) -> Result<Option<Inertial>, Box<Diagnostic>> {
        let kind = self.attribute(geom, class, "type").unwrap_or("sphere");
        let group = self.attribute(geom, class, "group").and_then(|text| text.parse().ok()).unwrap_or(0);
        let given = self.numbers::<1>(geom, class, "mass").map(|[(mass, _)]| mass);
        let density = self.numbers::<1>(geom, class, "density").map_or_else(|| integer(1000), |[(density, _)]| density);
        let weight = given.as_ref().unwrap_or(&density);
        if weight.is_zero() || !self.compiler.groups.contains(&group) || ["plane", "hfield"].contains(&kind) {
            return Ok(None);
        }
        let fault = |message: String| Box::new(Diagnostic::error(span(geom), message).help(WEIGH));
        if self.attribute(geom, class, "shellinertia") == Some("true") {
            return Err(fault(
                "the mass of this shape is in its surface (`shellinertia`), which is not read here".to_owned(),
            ));
        }
        if let Some(mesh) = self.attribute(geom, class, "mesh") {
            return Err(fault(format!("the mass of this shape is that of the mesh `{mesh}`, which is not read here")));
        }
        let written = self.attribute(geom, class, "size").unwrap_or_default();
        let sizes: Option<Vec<Rational>> = written.split_whitespace().map(number).collect();
        let mut sizes = sizes.unwrap_or_default();
        let mut origin = self.origin(geom, class);
        if let Some([a, b, c, d, e, f]) = self.numbers::<6>(geom, class, "fromto") {
            let ([a, b, c], [d, e, f]) = ([a, b, c].map(|(value, _)| value), [d, e, f].map(|(value, _)| value));
            let way = [d - &a, e - &b, f - &c];
            let direction = way.each_ref().map(rational::to_f64);
            let half = decimal(direction.iter().map(|part| part * part).sum::<f64>().sqrt() / 2.0);
            sizes.truncate(1);
            if ["box", "ellipsoid"].contains(&kind) {
                sizes.extend(sizes.first().cloned());
            }
            sizes.push(half);
            let middle = [a, b, c].iter().zip(&way).map(|(from, way)| from + ratio(1, 2) * way).collect::<Vec<_>>();
            origin = Origin::none();
            for (component, middle) in origin.at.iter_mut().zip(&middle) {
                *component = sum(component, middle);
            }
            if let Some(turn) = frame::of_z_axis(direction) {
                let angles = frame::roll_pitch_yaw(&turn);
                origin.turned = angles.map(|angle| self.reader.readings.computed(angle, span(geom)));
            }
        }
        let solid = solid(kind, &sizes)
            .filter(|solid| sizes.iter().all(|size| *size >= Rational::zero()) && !solid.volume.is_zero());
        let Some(solid) = solid else {
            let message =
                format!("the shape `{kind}` of the size `{written}` has no volume from which its mass follows");
            return Err(fault(message));
        };
        for (component, moved) in origin.at.iter_mut().zip(at) {
            *component = sum(component, &-moved);
        }
        let mass = given.unwrap_or_else(|| density * &solid.volume);
        let [x, y, z] = solid.spread.map(|spread| spread * &mass);
        let zero = Rational::zero;
        Ok(Some(Inertial { span: span(geom), origin, moments: [x, zero(), zero(), y, zero(), z], mass }))
    }
}
