//! The parameters that a mechanism declares.

use std::collections::HashSet;

use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::inertia_unit;

use crate::language::ast::mechanism::{DriveDeclaration, InertiaDeclaration, JointMotion, MechanismDeclaration};
use crate::language::ast::{ExprKind, Ident};
use tpm_units::Unit;

/// The parameters, each once, with their units.
pub(super) fn parameters(mechanism: &MechanismDeclaration) -> Vec<(&Ident, Option<Unit>)> {
    let mut seen = HashSet::new();
    let bodies = mechanism.bodies().flat_map(|body| match &body.inertia {
        Some(InertiaDeclaration::Parameters(names)) => names.as_slice(),
        _ => &[],
    });
    let inertias = bodies.enumerate().map(|(index, name)| (name, inertia_unit(index % NAMES.len())));
    let losses = mechanism.drives().flat_map(|drive| {
        let turns = turns(mechanism, drive);
        drive.losses.iter().map(move |(loss, name)| (name, loss.unit(turns)))
    });
    let all = inertias.chain(losses).map(|(name, unit)| (name, Unit::parse(&unit.to_string())));
    all.filter(|(name, _)| seen.insert(name.name.as_str())).collect()
}

/// Whether the joints that a drive moves turn: those that move by its coordinates without a factor.
pub(super) fn turns(mechanism: &MechanismDeclaration, drive: &DriveDeclaration) -> bool {
    let mut names = vec![drive.name.name.as_str()];
    if let Some(moves) = &drive.moves {
        moves.walk(&mut |part| {
            if let ExprKind::Name(name) = &part.kind {
                names.push(name);
            }
        });
    }
    !mechanism.bodies().filter_map(|body| body.joint.as_ref()).any(
        |joint| {
            joint.factor.is_none()
                && matches!(&joint.motion, JointMotion::Prismatic(coordinate, _) if names.contains(&coordinate.name.as_str()))
        },
    )
}
