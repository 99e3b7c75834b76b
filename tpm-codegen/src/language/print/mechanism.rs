//! Writes mechanisms as text.

use std::fmt::{self, Display, Formatter};

use super::join;
use crate::language::ast::mechanism::{
    BodyDeclaration, DriveDeclaration, InertiaDeclaration, JointDeclaration, JointMotion, KnownInertia,
    MechanismDeclaration, MechanismItem, Placement, VectorExpr, loss_word,
};
use crate::language::ast::{Expr, ExprKind, Ident, Operation};
use num_traits::{One, Zero};

impl Display for MechanismDeclaration {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("mechanism {\n")?;
        for item in &self.items {
            match item {
                MechanismItem::Gravity(gravity) => writeln!(f, "        gravity {gravity};")?,
                MechanismItem::Body(body) => writeln!(f, "        {body}")?,
                MechanismItem::Drive(drive) => writeln!(f, "        {drive}")?,
            }
        }
        f.write_str("    }")
    }
}

impl Display for BodyDeclaration {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "body {} ", self.name.name)?;
        if let Some(parent) = &self.parent {
            write!(f, "on {} ", parent.name)?;
        }
        f.write_str("{\n")?;
        if let Some(joint) = &self.joint {
            writeln!(f, "            {joint}")?;
        }
        match &self.inertia {
            None => {}
            Some(InertiaDeclaration::Parameters(_)) => {
                f.write_str("            inertia parameters")?;
                if let Some(near) = &self.near {
                    f.write_str(" near (")?;
                    join(f, near.iter(), ", ")?;
                    f.write_str(")")?;
                }
                f.write_str(";\n")?;
            }
            Some(InertiaDeclaration::Known(known)) => writeln!(f, "            {known}")?,
        }
        f.write_str("        }")
    }
}

impl Display for JointDeclaration {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let moved = |coordinate: &Ident| {
            let name = Expr { kind: ExprKind::Name(coordinate.name.clone()), span: coordinate.span };
            let Some(factor) = &self.factor else { return name };
            let mut factors = match &factor.kind {
                ExprKind::Product(factors) => factors.clone(),
                _ => vec![(Operation::Times, factor.clone())],
            };
            factors.push((Operation::Times, name));
            Expr { kind: ExprKind::Product(factors), span: factor.span }
        };
        match &self.motion {
            JointMotion::Fixed => f.write_str("fixed")?,
            JointMotion::Revolute(coordinate, axis) => {
                write!(f, "revolute {} about {}", moved(coordinate), Axis(axis))?;
            }
            JointMotion::Prismatic(coordinate, axis) => {
                write!(f, "prismatic {} along {}", moved(coordinate), Axis(axis))?;
            }
        }
        write!(f, "{};", self.placement)
    }
}

impl Display for Placement {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let Some(at) = &self.at {
            write!(f, " at {at}")?;
        }
        if let Some(turned) = &self.turned {
            write!(f, " turned {turned}")?;
        }
        Ok(())
    }
}

impl Display for KnownInertia {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "inertia mass {}{}", self.mass, self.placement)?;
        if let Some(moments) = &self.moments {
            f.write_str(" moments (")?;
            join(f, moments, ", ")?;
            f.write_str(")")?;
        }
        f.write_str(";")
    }
}

impl Display for DriveDeclaration {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "drive {}", self.name.name)?;
        if let Some(moves) = &self.moves {
            write!(f, " = {moves}")?;
        }
        if let Some(input) = &self.input {
            write!(f, " by {}", input.name)?;
        }
        if !self.losses.is_empty() {
            f.write_str(" with ")?;
            join(f, self.losses.iter().map(|(loss, _)| loss_word(*loss)), ", ")?;
        }
        f.write_str(";")
    }
}

impl Display for VectorExpr {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("(")?;
        join(f, &self.components, ", ")?;
        f.write_str(")")
    }
}

/// An axis, by its letter where it is one of the frame's.
struct Axis<'a>(&'a VectorExpr);

impl Display for Axis<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let is = |expr: &Expr, one: bool| matches!(&expr.kind, ExprKind::Number(value) if if one { value.is_one() } else { value.is_zero() });
        for (index, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let others = (0..3).filter(|&other| other != index);
            if !others.into_iter().all(|other| is(&self.0.components[other], false)) {
                continue;
            }
            match &self.0.components[index].kind {
                ExprKind::Number(value) if value.is_one() => return f.write_str(letter),
                ExprKind::Negative(inner) if is(inner, true) => return write!(f, "-{letter}"),
                _ => {}
            }
        }
        self.0.fmt(f)
    }
}
