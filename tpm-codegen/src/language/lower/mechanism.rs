//! Lowers mechanisms to trees of rigid bodies, and trees to equations of motion.
//!
//! Invariant: the geometry is exact. Axes are rational unit vectors, and the cosine and sine of every constant angle are rational.

use std::collections::HashMap;

use num_traits::{One, ToPrimitive, Zero};
use tpm_symbolic::expr::graph::{Coordinate, ExprId};
use tpm_symbolic::mechanics::tree::mechanism::{Drive, Label, Mechanism};
use tpm_symbolic::mechanics::tree::rotation::{self, Angle, Rotation};
use tpm_symbolic::mechanics::tree::{self, Body, Inertia, Joint, Tree};
use tpm_symbolic::number::rational::{self, Rational};

use super::Lowering;
use super::expression::{self, Lower};
use crate::diagnostic::Diagnostic;
use crate::language::ast::mechanism::{
    BodyDeclaration, DriveDeclaration, InertiaDeclaration, JointDeclaration, JointMotion, KnownInertia,
    MechanismDeclaration, MechanismItem, Placement, VectorExpr,
};
use crate::language::ast::{self, Expr, ExprKind, Item, Operation, Sign};
use crate::near;
use crate::source::Span;

impl<'a> Lowering<'a, '_, '_> {
    /// The mechanism of the model, its equations of motion, and the names of its parameters.
    pub(super) fn mechanism(&mut self, model: &'a ast::ModelDeclaration) {
        let declared = model.items.iter().find_map(|item| match item {
            Item::Mechanism(mechanism) => Some(mechanism),
            _ => None,
        });
        let Some(declared) = declared else { return };
        let Some(mechanism) = self.tree_of(declared) else { return };
        let first = self.model.symbols.len();
        self.model.equations = mechanism.equations(&mut self.model);
        let names: HashMap<String, ExprId> = self
            .model
            .parameters()
            .filter(|symbol| symbol.0 as usize >= first)
            .map(|symbol| (self.model.quantity(symbol).name.to_string(), symbol))
            .collect::<Vec<_>>()
            .into_iter()
            .map(|(name, symbol)| (name, self.model.graph.symbol(symbol)))
            .collect();
        let bodies = declared.bodies().flat_map(|body| match &body.inertia {
            Some(InertiaDeclaration::Parameters(names)) => names.as_slice(),
            _ => &[],
        });
        let losses = declared.drives().flat_map(|drive| drive.losses.iter().map(|(_, name)| name));
        for name in bodies.chain(losses) {
            if let Some(&expr) = names.get(&name.name) {
                self.names.insert(&name.name, expr);
            }
        }
        self.mechanism = Some(mechanism);
    }

    /// The tree with its drives, or `None` after every fault was added to the diagnostics.
    fn tree_of(&mut self, declared: &'a MechanismDeclaration) -> Option<Mechanism> {
        let order = inward_first(declared);
        let mut gravity = None;
        for item in &declared.items {
            if let MechanismItem::Gravity(vector) = item {
                let result = self.vector(vector);
                gravity = self.keep(result);
            }
        }
        let mut indices: HashMap<&str, usize> = HashMap::new();
        let (mut bodies, mut labels, mut near) = (Vec::new(), Vec::new(), Vec::new());
        for declaration in order {
            let parent = declaration.parent.as_ref().and_then(|parent| indices.get(parent.name.as_str()).copied());
            let result = self.body(declaration, parent);
            indices.insert(&declaration.name.name, labels.len());
            let term = self.terms.add(declaration.name.span);
            labels.push(Label { name: declaration.name.name.clone(), term });
            bodies.push(self.keep(result));
            let values = declaration.near.as_ref().map(|near| {
                near.iter().map(|value| expression::exact(value, &self.values)).collect::<Lower<Vec<Rational>>>()
            });
            near.push(values.and_then(|values| self.keep(values)));
        }
        let mut drives = Vec::new();
        for declaration in declared.drives() {
            let result = self.drive(declaration);
            drives.push(self.keep(result));
        }
        let bodies: Vec<Body> = bodies.into_iter().collect::<Option<_>>()?;
        let drives: Vec<Drive> = drives.into_iter().collect::<Option<_>>()?;
        let tree = Tree::new(gravity?, bodies)
            .map_err(|error| self.diagnostics.push(Diagnostic::error(declared.keyword, error.to_string())))
            .ok()?;
        Some(Mechanism { tree, labels, near, drives })
    }

    fn body(&mut self, declaration: &'a BodyDeclaration, parent: Option<usize>) -> Lower<Body> {
        let Some(joint) = &declaration.joint else {
            return Err(Diagnostic::error(declaration.name.span, "this body has no joint").help("give it one"));
        };
        let (origin, rotation) = self.placement(&joint.placement)?;
        let inertia = match &declaration.inertia {
            None => Inertia::None,
            Some(InertiaDeclaration::Parameters(_)) => Inertia::Unknown,
            Some(InertiaDeclaration::Known(known)) => Inertia::Known(self.known_inertia(known)?),
        };
        Ok(Body { parent, origin, rotation, joint: self.joint(joint)?, inertia })
    }

    fn joint(&mut self, declaration: &JointDeclaration) -> Lower<Joint> {
        let Some((name, axis)) = declaration.motion.moving() else { return Ok(Joint::Fixed) };
        let axis = self.axis(axis)?;
        let Some(coordinate) = self.coordinate(&name.name) else {
            return Err(Diagnostic::error(name.span, format!("`{}` is no coordinate", name.name)).help("declare it"));
        };
        let factor = match &declaration.factor {
            Some(factor) => expression::exact(factor, &self.values)?,
            None => Rational::one(),
        };
        if let Some(factor) = declaration.factor.as_ref().filter(|_| factor.is_zero()) {
            return Err(Diagnostic::error(factor.span, "with this factor, which is zero, the joint does not move")
                .help("write `fixed` for a joint that does not move"));
        }
        Ok(match declaration.motion {
            JointMotion::Prismatic(..) => Joint::Prismatic { coordinate, factor, axis },
            _ => Joint::Revolute { coordinate, factor, axis },
        })
    }

    fn vector(&mut self, vector: &VectorExpr) -> Lower<[ExprId; 3]> {
        let [x, y, z] = &vector.components;
        Ok([self.expression(x)?, self.expression(y)?, self.expression(z)?])
    }

    fn placement(&mut self, placement: &Placement) -> Lower<([ExprId; 3], Rotation)> {
        let origin = match &placement.at {
            Some(at) => self.vector(at)?,
            None => [self.model.graph.integer(0); 3],
        };
        let rotation = match &placement.turned {
            Some(turned) => {
                let [roll, pitch, yaw] = &turned.components;
                Rotation::roll_pitch_yaw(&[self.angle(roll)?, self.angle(pitch)?, self.angle(yaw)?])
            }
            None => Rotation::identity(),
        };
        Ok((origin, rotation))
    }

    /// A unit vector along an axis; the length of the written vector does not matter.
    fn axis(&self, vector: &VectorExpr) -> Lower<[Rational; 3]> {
        let [x, y, z] = &vector.components;
        let exact = |expr: &Expr| expression::exact(expr, &self.values);
        let direction = [exact(x)?, exact(y)?, exact(z)?];
        if direction.iter().all(Zero::is_zero) {
            return Err(Diagnostic::error(vector.span, "this axis is zero, which is no direction")
                .help("write `x`, `y`, `z`, or a vector such as (0, 0, 1)"));
        }
        rotation::unit_vector(&direction).ok_or_else(|| {
            let near = near::unit_vector(direction.map(|component| rational::to_f64(&component)));
            let help = match near {
                Some([x, y, z]) => {
                    format!("write the rational unit vector next to it, ({x}, {y}, {z}), or turn the joint's frame")
                }
                None => "turn the joint's frame".to_owned(),
            };
            Diagnostic::error(vector.span, "the length of this axis is no rational number").help(help)
        })
    }

    /// An angle whose cosine and sine are rational: quarter turns, or twice the arc tangent of a rational number.
    fn angle(&self, expr: &Expr) -> Lower<Angle> {
        if expr.is_zero() {
            return Ok(Angle::quarter_turns(0));
        }
        let (expr, sign) = match &expr.kind {
            ExprKind::Negative(inner) => (&**inner, -1),
            _ => (expr, 1),
        };
        if let Some(multiple) = expression::multiple_of_pi(expr, &self.values)? {
            let quarters = multiple * rational::integer(2 * sign);
            if let Some(count) = quarters.is_integer().then(|| quarters.to_integer().to_i64()).flatten() {
                return Ok(Angle::quarter_turns(count));
            }
            return Err(no_angle(expr.span, Some(rational::to_f64(&quarters) * std::f64::consts::FRAC_PI_2)));
        }
        if let Some((y, x)) = expression::half_tangent(expr, &self.values)? {
            return match (y.is_zero(), x.is_zero()) {
                (true, true) => Err(Diagnostic::error(expr.span, "the point (0, 0) has no angle")
                    .help("one of the arguments must not be 0")),
                (false, true) => Ok(Angle::quarter_turns(2)),
                _ => Ok(Angle::half_tangent(&(y / x * rational::integer(sign)))),
            };
        }
        let value = expression::exact(expr, &self.values).ok().map(|value| rational::to_f64(&value) * sign as f64);
        Err(no_angle(expr.span, value))
    }

    /// The ten parameters about the body's frame. Values that no body can have are refused where all of them are known
    /// exactly.
    fn known_inertia(&mut self, known: &KnownInertia) -> Lower<[ExprId; 10]> {
        let zero = Expr { kind: ExprKind::Number(Rational::zero()), span: known.keyword };
        let moments: [&Expr; 6] = match known.moments.as_deref() {
            Some([xx, xy, xz, yy, yz, zz]) => [xx, xy, xz, yy, yz, zz],
            _ => [&zero; 6],
        };
        let mut exact = Vec::with_capacity(7);
        for expr in std::iter::once(&known.mass).chain(moments) {
            exact.extend(expression::exact(expr, &self.values));
        }
        if let [mass, moments @ ..] = exact.as_slice()
            && let Ok(moments) = <&[Rational; 6]>::try_from(moments)
            && let Some(fault) = tree::fault(mass, moments)
        {
            return Err(Diagnostic::error(known.keyword, format!("no body has this inertia: {fault}")).help(
                "check signs and units; moments are about the centre of mass, in the order Ixx, Ixy, Ixz, Iyy, Iyz, Izz",
            ));
        }
        let mass = self.expression(&known.mass)?;
        let (centre, rotation) = self.placement(&known.placement)?;
        let mut values = [mass; 6];
        for (value, expr) in values.iter_mut().zip(moments) {
            *value = self.expression(expr)?;
        }
        Ok(tree::about_origin(&mut self.model.graph, mass, &centre, &values, &rotation))
    }

    fn drive(&mut self, declaration: &DriveDeclaration) -> Lower<Drive> {
        let moves = match &declaration.moves {
            None => vec![(self.joint_coordinate(&declaration.name.name, declaration.name.span)?, Rational::one())],
            Some(expr) => self.combination(expr)?,
        };
        let input = declaration.input.as_ref().and_then(|input| self.model.find_symbol(&input.name));
        let losses = declaration.losses.iter().map(|(loss, _)| *loss).collect();
        let term = self.terms.add(declaration.name.span);
        Ok(Drive { name: declaration.name.name.clone(), moves, input, losses, term })
    }

    /// A combination of coordinates with constant factors: `q5 + 2*q6`.
    fn combination(&self, expr: &Expr) -> Lower<Vec<(Coordinate, Rational)>> {
        let mut found: Vec<(Coordinate, Rational)> = Vec::new();
        for (sign, term) in expr.terms() {
            let (coordinate, factor) = self.moved(term)?;
            let factor = if sign == Sign::Minus { -factor } else { factor };
            match found.iter_mut().find(|(known, _)| *known == coordinate) {
                Some((_, sum)) => *sum += factor,
                None => found.push((coordinate, factor)),
            }
        }
        found.retain(|(_, factor)| !factor.is_zero());
        if found.is_empty() {
            return Err(Diagnostic::error(expr.span, "this drive moves nothing").help("write, for example, `q5 + q6`"));
        }
        Ok(found)
    }

    /// A coordinate times a number.
    fn moved(&self, term: &Expr) -> Lower<(Coordinate, Rational)> {
        let refused = || {
            Diagnostic::error(term.span, "a drive moves a constant combination of coordinates")
                .help("write, for example, `q5 + q6` or `q1 - 1/2*q2`")
        };
        match &term.kind {
            ExprKind::Name(name) => Ok((self.joint_coordinate(name, term.span)?, Rational::one())),
            ExprKind::Negative(inner) => {
                let (coordinate, factor) = self.moved(inner)?;
                Ok((coordinate, -factor))
            }
            ExprKind::Product(factors) => {
                let is_coordinate =
                    |factor: &Expr| matches!(&factor.kind, ExprKind::Name(name) if self.coordinate(name).is_some());
                let at = factors
                    .iter()
                    .position(|(operation, factor)| *operation == Operation::Times && is_coordinate(factor))
                    .ok_or_else(refused)?;
                let ExprKind::Name(name) = &factors[at].1.kind else { return Err(refused()) };
                let coordinate = self.joint_coordinate(name, term.span)?;
                let mut others = factors.clone();
                others.remove(at);
                let one = Expr { kind: ExprKind::Number(Rational::one()), span: term.span };
                others.insert(0, (Operation::Times, one));
                let others = Expr { kind: ExprKind::Product(others), span: term.span };
                Ok((coordinate, expression::exact(&others, &self.values).map_err(|_| refused())?))
            }
            _ => Err(refused()),
        }
    }

    fn joint_coordinate(&self, name: &str, span: Span) -> Lower<Coordinate> {
        self.coordinate(name).ok_or_else(|| {
            Diagnostic::error(span, format!("`{name}` is no coordinate"))
                .help("a drive moves joints, by their coordinates")
        })
    }
}

/// The bodies, each after its parent, otherwise in the order of the text. There are no cycles.
fn inward_first(mechanism: &MechanismDeclaration) -> Vec<&BodyDeclaration> {
    let bodies: HashMap<&str, &BodyDeclaration> =
        mechanism.bodies().map(|body| (body.name.name.as_str(), body)).collect();
    let mut placed: Vec<&str> = Vec::new();
    let mut order = Vec::new();
    for body in mechanism.bodies() {
        let mut waiting = vec![body];
        while let Some(parent) = waiting.last().and_then(|last| last.parent.as_ref()) {
            match bodies.get(parent.name.as_str()) {
                Some(parent) if waiting.len() <= bodies.len() => waiting.push(parent),
                _ => break,
            }
        }
        for body in waiting.into_iter().rev() {
            if !placed.contains(&body.name.name.as_str()) {
                placed.push(&body.name.name);
                order.push(body);
            }
        }
    }
    order
}

/// The fault of a constant angle without rational cosine and sine, with a nearby one that has them where its value
/// (rad) is known.
fn no_angle(span: Span, value: Option<f64>) -> Diagnostic {
    let rule = "write a multiple of pi/2, or `2*atan2(p, q)` with rational p and q";
    let help = match value.and_then(|value| Some((value, near::rational((value / 2.0).tan())?))) {
        Some((value, tangent)) => {
            let text = format!("2*atan2({}, {})", tangent.numer(), tangent.denom());
            format!("{rule}; `{text}` lies within 1e-15 of {value}")
        }
        None => rule.to_owned(),
    };
    Diagnostic::error(span, "the cosine and sine of this angle are not rational").help(help)
}
