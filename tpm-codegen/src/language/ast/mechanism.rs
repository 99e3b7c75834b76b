//! `mechanism { ... }`: bodies, the joints by which they stand on each other, and the drives of the joints.

use crate::language::ast::expr::{Expr, Ident};
use crate::source::Span;
use tpm_symbolic::mechanics::tree::mechanism::Loss;

/// The keyword of a drive's loss torque.
#[must_use]
pub fn loss_word(loss: Loss) -> &'static str {
    match loss {
        Loss::Viscous => "viscous",
        Loss::Coulomb => "coulomb",
        Loss::Offset => "offset",
        Loss::Rotor => "rotor",
        Loss::Load => "load",
    }
}

/// `mechanism { ... }`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct MechanismDeclaration {
    /// The place of the keyword.
    pub keyword: Span,
    /// Its statements.
    pub items: Vec<MechanismItem>,
}

/// A statement of a mechanism.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum MechanismItem {
    /// `gravity (0, 0, -9.81);`
    Gravity(VectorExpr),
    /// `body forearm on upperarm { ... }`
    Body(Box<BodyDeclaration>),
    /// `drive q1 by tau1 with viscous;`
    Drive(DriveDeclaration),
}

/// `(x, y, z)`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct VectorExpr {
    /// The components.
    pub components: [Expr; 3],
    /// The place from the opening to the closing parenthesis.
    pub span: Span,
}

/// Position and orientation relative to a frame: `at (x, y, z) turned (roll, pitch, yaw)`.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Placement {
    /// The origin; that of the frame when not given.
    pub at: Option<VectorExpr>,
    /// Angles about the fixed axes x, then y, then z; zero when not given.
    pub turned: Option<VectorExpr>,
}

/// `body NAME on PARENT { ... }`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct BodyDeclaration {
    /// The name.
    pub name: Ident,
    /// The parent body; the base when not given.
    pub parent: Option<Ident>,
    /// Its joint; a body without one is reported by the checks.
    pub joint: Option<JointDeclaration>,
    /// Its inertia; a frame without mass when not given.
    pub inertia: Option<InertiaDeclaration>,
    /// The ten parameters near which those of its inertia are, `inertia parameters near (m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz);`: friction
    /// in proportion to the load is that of the load with these.
    pub near: Option<Vec<Expr>>,
}

/// `revolute q about z at (0, 0, 0.3) turned (0, pi/2, 0);` and its like.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct JointDeclaration {
    /// The place of the keyword.
    pub keyword: Span,
    /// What moves.
    pub motion: JointMotion,
    /// The joint's position over its coordinate, `1/2` in `revolute 1/2*q about z`; one when not given.
    pub factor: Option<Expr>,
    /// Position and orientation of the joint in the frame of the parent.
    pub placement: Placement,
}

/// How the joint of a body moves.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum JointMotion {
    /// `fixed`
    Fixed,
    /// `revolute q about axis`
    Revolute(Ident, VectorExpr),
    /// `prismatic q along axis`
    Prismatic(Ident, VectorExpr),
}

impl JointMotion {
    /// The coordinate and the axis of a joint that moves.
    #[must_use]
    pub fn moving(&self) -> Option<(&Ident, &VectorExpr)> {
        match self {
            Self::Fixed => None,
            Self::Revolute(coordinate, axis) | Self::Prismatic(coordinate, axis) => Some((coordinate, axis)),
        }
    }
}

/// `inertia parameters;` or `inertia mass 2.5 at (0, 0, 0.1) moments (0.02, 0, 0, 0.02, 0, 0.01);`
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum InertiaDeclaration {
    /// The ten parameters are to be identified: `m_NAME`, `mx_NAME`, ..., `Izz_NAME`, all at the place of the statement.
    Parameters(Vec<Ident>),
    /// The inertia is known.
    Known(Box<KnownInertia>),
}

/// A known inertia.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct KnownInertia {
    /// The place of the keyword.
    pub keyword: Span,
    /// The mass, kg.
    pub mass: Expr,
    /// The centre of mass in the frame of the body, and the orientation of the axes of the moments relative to that
    /// frame.
    pub placement: Placement,
    /// Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the centre of mass, kg m^2; zero when not given.
    pub moments: Option<Vec<Expr>>,
}

/// `drive q1 by tau1 with viscous, coulomb;` or `drive wrist = q5 + q6 by u6;`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct DriveDeclaration {
    /// The driven coordinate; for a combination of coordinates, the name of the drive.
    pub name: Ident,
    /// The combination of coordinates, with constant factors, that the drive moves.
    pub moves: Option<Expr>,
    /// The input that is the torque of the drive.
    pub input: Option<Ident>,
    /// Its unknown loss torques, with the parameters that describe them.
    pub losses: Vec<(Loss, Ident)>,
}

impl MechanismDeclaration {
    /// The bodies, in the order of the text.
    pub fn bodies(&self) -> impl Iterator<Item = &BodyDeclaration> {
        self.items.iter().filter_map(|item| if let MechanismItem::Body(body) = item { Some(&**body) } else { None })
    }

    /// The drives, in the order of the text.
    pub fn drives(&self) -> impl Iterator<Item = &DriveDeclaration> {
        self.items.iter().filter_map(|item| if let MechanismItem::Drive(drive) = item { Some(drive) } else { None })
    }

    /// The expressions of the geometry: gravity, origins, angles, axes, known inertias.
    pub fn geometry(&self) -> Vec<&Expr> {
        let mut found = Vec::new();
        for item in &self.items {
            match item {
                MechanismItem::Gravity(gravity) => found.extend(&gravity.components),
                MechanismItem::Body(body) => body.geometry(&mut found),
                MechanismItem::Drive(_) => {}
            }
        }
        found
    }

    pub(super) fn forget_spans(&mut self) {
        self.keyword = Span::default();
        for item in &mut self.items {
            match item {
                MechanismItem::Gravity(gravity) => gravity.forget_spans(),
                MechanismItem::Body(body) => body.forget_spans(),
                MechanismItem::Drive(drive) => {
                    drive.name.span = Span::default();
                    drive.moves.iter_mut().for_each(Expr::forget_spans);
                    drive.input.iter_mut().for_each(|name| name.span = Span::default());
                    drive.losses.iter_mut().for_each(|(_, name)| name.span = Span::default());
                }
            }
        }
    }
}

impl BodyDeclaration {
    fn geometry<'a>(&'a self, found: &mut Vec<&'a Expr>) {
        if let Some(joint) = &self.joint {
            found.extend(joint.motion.moving().into_iter().flat_map(|(_, axis)| &axis.components));
            found.extend(&joint.factor);
            found.extend(joint.placement.expressions());
        }
        found.extend(self.near.iter().flatten());
        if let Some(InertiaDeclaration::Known(known)) = &self.inertia {
            found.push(&known.mass);
            found.extend(known.placement.expressions());
            found.extend(known.moments.iter().flatten());
        }
    }

    fn forget_spans(&mut self) {
        self.name.span = Span::default();
        self.parent.iter_mut().for_each(|name| name.span = Span::default());
        if let Some(joint) = &mut self.joint {
            joint.keyword = Span::default();
            joint.factor.iter_mut().for_each(Expr::forget_spans);
            joint.placement.forget_spans();
            if let JointMotion::Revolute(coordinate, axis) | JointMotion::Prismatic(coordinate, axis) =
                &mut joint.motion
            {
                coordinate.span = Span::default();
                axis.forget_spans();
            }
        }
        match &mut self.inertia {
            None => {}
            Some(InertiaDeclaration::Parameters(names)) => {
                self.near.iter_mut().flatten().for_each(Expr::forget_spans);
                names.iter_mut().for_each(|name| name.span = Span::default());
            }
            Some(InertiaDeclaration::Known(known)) => {
                known.keyword = Span::default();
                known.mass.forget_spans();
                known.placement.forget_spans();
                known.moments.iter_mut().flatten().for_each(Expr::forget_spans);
            }
        }
    }
}

impl Placement {
    fn expressions(&self) -> impl Iterator<Item = &Expr> {
        self.at.iter().chain(&self.turned).flat_map(|vector| &vector.components)
    }

    fn forget_spans(&mut self) {
        self.at.iter_mut().chain(&mut self.turned).for_each(VectorExpr::forget_spans);
    }
}

impl VectorExpr {
    fn forget_spans(&mut self) {
        self.span = Span::default();
        self.components.iter_mut().for_each(Expr::forget_spans);
    }
}
