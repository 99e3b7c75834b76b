//! Models written by hand: the ground that tests stand on without the language or the macro.

use tpm_controller::Real;
use tpm_controller::model::{Buffer, Dims, EvalError, Label, Model, require_len};
#[cfg(feature = "differentiable")]
use tpm_interpret::{Interpreted, InterpretedDerivatives};

/// A model and the derivatives of its rows, from its text.
#[cfg(feature = "differentiable")]
pub fn differentiable(text: &str) -> (Interpreted, InterpretedDerivatives) {
    let source = tpm_codegen::source::Source::new("test", text);
    let Ok(parsed) = tpm_codegen::parse_model(&source) else { panic!("no model: {text}") };
    let prepared = tpm_symbolic::regressor::prepare::prepare(parsed.model).expect("linear in the parameters");
    let (model, form) = (&prepared.model, &prepared.form);
    (Interpreted::new(model, form), InterpretedDerivatives::new(model, form))
}

/// Implements a one-coordinate, one-input model of second order whose regressor row is an expression of (x, x', x'').
macro_rules! scalar_model {
    ($(#[$doc:meta])* $name:ident, $q:literal, $u:literal, [$($p:literal),+], |$x:ident, $v:ident, $a:ident| [$($term:expr),+]) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default)]
        pub struct $name;

        impl $name {
            const PARAMETERS: &'static [&'static str] = &[$($p),+];
        }

        impl<T: Real> Model<T> for $name {
            fn name(&self) -> &str {
                stringify!($name)
            }
            fn dims(&self) -> Dims {
                Dims { coordinates: 1, order: 2, inputs: 1, rows: 1, parameters: Self::PARAMETERS.len(), constants: 0 }
            }
            fn coordinate(&self, _: usize) -> Label<'_> {
                Label::bare($q)
            }
            fn input(&self, _: usize) -> Label<'_> {
                Label::bare($u)
            }
            fn parameter(&self, index: usize) -> Label<'_> {
                Label::bare(Self::PARAMETERS.get(index).copied().unwrap_or(""))
            }
            fn constant(&self, _: usize) -> Label<'_> {
                Label::bare("")
            }
            fn row(&self, _: usize) -> Label<'_> {
                Label::bare($u)
            }
            fn workspace_len(&self) -> usize {
                0
            }
            fn regressor(&self, motion: &[T], _: &[T], _: &mut [T], out: &mut [T]) -> Result<(), EvalError> {
                require_len(Buffer::Motion, motion.len(), 3)?;
                require_len(Buffer::Output, out.len(), Self::PARAMETERS.len())?;
                let ($x, $v, $a) = (motion[0], motion[1], motion[2]);
                out.copy_from_slice(&[$($term),+]);
                Ok(())
            }
            fn known(&self, _: &[T], _: &[T], _: &mut [T], out: &mut [T]) -> Result<(), EvalError> {
                require_len(Buffer::Output, out.len(), 1)?;
                out[0] = T::ZERO;
                Ok(())
            }
            fn input_map(&self, _: &[T], _: &[T], _: &mut [T], out: &mut [T]) -> Result<(), EvalError> {
                require_len(Buffer::Output, out.len(), 1)?;
                out[0] = T::ONE;
                Ok(())
            }
        }
    };
}

scalar_model!(
    /// m x'' + k1 x + k2 x'^2 = u (Feng, Eqn 3.24).
    MassSpringDrag, "x", "u", ["m", "k1", "k2"], |x, v, a| [a, x, v * v]
);
scalar_model!(
    /// M q'' + Fv q' + Fc sign(q') + OF = force.
    Emps, "q", "force", ["M", "Fv", "Fc", "OF"], |_x, v, a| [a, v, v.sign(), T::ONE]
);
scalar_model!(
    /// m x'' + d x' + k x + fc sign(x') = u.
    RubbingSpring, "x", "u", ["m", "d", "k", "fc"], |x, v, a| [a, v, x, v.sign()]
);
scalar_model!(
    /// m x'' + d x' + f0 = u: nothing holds the position.
    FreeCart, "x", "u", ["m", "d", "f0"], |_x, v, a| [a, v, T::ONE]
);
scalar_model!(
    /// m y'' + d y' + k1 y + k3 y^3 = u.
    Silverbox, "y", "u", ["m", "d", "k1", "k3"], |x, v, a| [a, v, x, x * x * x]
);

/// Two carts, the second one free: m1 x1'' + k1 x1 + k2 x1^3 + k3 (x1 - x2) = F, m2 x2'' + k3 (x2 - x1) = 0
/// (Feng, Eqns 4.30, 4.31).
#[derive(Clone, Copy, Debug, Default)]
pub struct TwoCarts;

impl<T: Real> Model<T> for TwoCarts {
    fn name(&self) -> &str {
        "TwoCarts"
    }
    fn dims(&self) -> Dims {
        Dims { coordinates: 2, order: 2, inputs: 1, rows: 2, parameters: 5, constants: 0 }
    }
    fn coordinate(&self, index: usize) -> Label<'_> {
        Label::new(["x1", "x2"].get(index).copied().unwrap_or(""), "m")
    }
    fn input(&self, _: usize) -> Label<'_> {
        Label::new("F", "N")
    }
    fn parameter(&self, index: usize) -> Label<'_> {
        Label::bare(["m1", "m2", "k1", "k2", "k3"].get(index).copied().unwrap_or(""))
    }
    fn constant(&self, _: usize) -> Label<'_> {
        Label::bare("")
    }
    fn row(&self, index: usize) -> Label<'_> {
        Label::new(["F", "eq2"].get(index).copied().unwrap_or(""), "N")
    }
    fn workspace_len(&self) -> usize {
        0
    }
    fn regressor(&self, motion: &[T], _: &[T], _: &mut [T], out: &mut [T]) -> Result<(), EvalError> {
        require_len(Buffer::Motion, motion.len(), 6)?;
        require_len(Buffer::Output, out.len(), 10)?;
        let (x1, x2, a1, a2) = (motion[0], motion[1], motion[4], motion[5]);
        let zero = T::ZERO;
        out[..5].copy_from_slice(&[a1, zero, x1, x1 * x1 * x1, x1 - x2]);
        out[5..].copy_from_slice(&[zero, a2, zero, zero, x2 - x1]);
        Ok(())
    }
    fn known(&self, _: &[T], _: &[T], _: &mut [T], out: &mut [T]) -> Result<(), EvalError> {
        require_len(Buffer::Output, out.len(), 2)?;
        out.fill(T::ZERO);
        Ok(())
    }
    fn input_map(&self, _: &[T], _: &[T], _: &mut [T], out: &mut [T]) -> Result<(), EvalError> {
        require_len(Buffer::Output, out.len(), 2)?;
        out.copy_from_slice(&[T::ONE, T::ZERO]);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{Emps, MassSpringDrag, Silverbox, TwoCarts};
    use tpm_controller::model::{Buffer, EvalError, Model};

    #[test]
    fn inverse_and_forward_dynamics_undo_each_other() {
        let model: &dyn Model<f64> = &TwoCarts;
        let theta = [2.0, 1.0, 40.0, 300.0, 200.0];
        let motion = [0.3, 0.2, -1.0, 0.5, 7.0, 0.0];
        let mut scratch = vec![0.0; model.inverse_workspace_len()];
        let mut force = [0.0; 2];
        model.inverse_dynamics(&motion, &theta, &[], &mut scratch, &mut force).expect("lengths fit");
        // The free row fixes x2'' = k3 (x1 - x2) / m2 = 20; the driven one then reproduces x1''.
        let mut solved = [0.3, 0.2, -1.0, 0.5, f64::NAN, f64::NAN];
        let mut scratch = vec![0.0; model.forward_workspace_len()];
        model.forward_dynamics(&mut solved, &theta, &[], &[force[0]], &mut scratch).expect("regular");
        assert!((solved[4] - 7.0).abs() < 1e-14);
        assert!((solved[5] - 20.0).abs() < 1e-13);
    }

    #[test]
    fn a_small_mass_beside_a_large_force_loses_no_digits() {
        let model: &dyn Model<f64> = &Silverbox;
        let theta = [5.4e-6, 2.3e-4, 1e6, 4.0];
        let mut motion = [1.0, 1.0, 0.0];
        let mut scratch = vec![0.0; model.forward_workspace_len()];
        model.forward_dynamics(&mut motion, &theta, &[], &[0.0], &mut scratch).expect("regular");
        let expected = -(2.3e-4 + 1e6 + 4.0) / 5.4e-6;
        assert!((motion[2] / expected - 1.0).abs() < 1e-15);
    }

    #[test]
    fn friction_vanishes_at_rest() {
        let model: &dyn Model<f64> = &Emps;
        let mut phi = [0.0; 4];
        model.regressor(&[0.1, 0.0, 2.0], &[], &mut [], &mut phi).expect("lengths fit");
        assert_eq!(phi, [2.0, 0.0, 0.0, 1.0]);
        assert_eq!(model.parameter(3).name, "OF");
        assert_eq!(model.parameter(4).name, "");
    }

    #[test]
    fn wrong_lengths_and_zero_mass_are_named() {
        let model: &dyn Model<f32> = &MassSpringDrag;
        assert_eq!(
            model.regressor(&[0.0; 2], &[], &mut [], &mut [0.0; 3]),
            Err(EvalError::Length { buffer: Buffer::Motion, needed: 3, given: 2 })
        );
        let mut scratch = vec![0.0; model.forward_workspace_len()];
        assert_eq!(
            model.forward_dynamics(&mut [0.0; 3], &[0.0, 1.0, 1.0], &[], &[1.0], &mut scratch),
            Err(EvalError::Singular { coordinate: 0 })
        );
        assert_eq!(
            model.forward_dynamics(&mut [0.0; 3], &[1.0; 3], &[], &[1.0], &mut []),
            Err(EvalError::Length { buffer: Buffer::Workspace, needed: 3, given: 0 })
        );
    }
}
