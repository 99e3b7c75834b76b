//! Models written by hand: the ground that tests stand on without the language or the macro.

use crate::model::{Buffer, Dims, EvalError, Label, Model, require_len};
use crate::real::Real;

/// Implements a one-coordinate, one-input model of second order whose regressor row is an expression of (x, x', x'').
macro_rules! scalar_model {
    ($(#[$doc:meta])* $name:ident, $q:literal, $u:literal, [$($p:literal),+], |$x:ident, $v:ident, $a:ident| [$($term:expr),+]) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default)]
        pub(crate) struct $name;

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
    /// m y'' + d y' + k1 y + k3 y^3 = u.
    Silverbox, "y", "u", ["m", "d", "k1", "k3"], |x, v, a| [a, v, x, x * x * x]
);

/// Two carts, the second one free: m1 x1'' + k1 x1 + k2 x1^3 + k3 (x1 - x2) = F, m2 x2'' + k3 (x2 - x1) = 0
/// (Feng, Eqns 4.30, 4.31).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TwoCarts;

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
