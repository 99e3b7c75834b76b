//! The interface of dynamics models, whether written by hand, compiled by the macro, or interpreted.
//!
//! Invariant: a model is linear in its unknown parameters theta, row by row:
//!
//! ```text
//! Phi(q, q', q'', ...; c) theta + known(q, q', q'', ...; c) = B(q, q', ...; c) u
//! ```
//!
//! with coordinates q, inputs u and constants c that are known at run time. Rows of free coordinates have a zero row in B.
//! Every matrix is row-major in a slice of the caller; nothing allocates; a slice of the wrong length is an error, not a panic.
//! A *motion* is one instant of all coordinates: `motion[n * coordinates + c]` is the n-th time derivative of coordinate c,
//! n = 0, ..., order, in the units of the model.

use crate::linear;
pub use crate::support::Label;
use crate::support::Real;
use core::fmt;

/// The sizes of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Dims {
    /// Number of coordinates q.
    pub coordinates: usize,
    /// Highest time derivative of any coordinate that the equations use.
    pub order: usize,
    /// Number of inputs u.
    pub inputs: usize,
    /// Number of equations.
    pub rows: usize,
    /// Number of unknown parameters in which the rows are linear.
    pub parameters: usize,
    /// Number of constants known at run time.
    pub constants: usize,
}

impl Dims {
    /// Length of a motion: the coordinates and their derivatives up to `order`.
    ///
    /// ```
    /// # use tpm_controller::model::*;
    /// let dims = Dims { coordinates: 2, order: 2, inputs: 1, rows: 2, parameters: 3, constants: 0 };
    /// assert_eq!((dims.motion_len(), dims.regressor_len(), dims.input_map_len()), (6, 6, 2));
    /// ```
    #[must_use]
    pub const fn motion_len(&self) -> usize {
        self.coordinates * (self.order + 1)
    }

    /// Length of the regressor matrix, rows times parameters.
    #[must_use]
    pub const fn regressor_len(&self) -> usize {
        self.rows * self.parameters
    }

    /// Length of the input map, rows times inputs.
    #[must_use]
    pub const fn input_map_len(&self) -> usize {
        self.rows * self.inputs
    }
}

/// The slices that a caller hands to a model, as errors name them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Buffer {
    /// Coordinates and their derivatives.
    Motion,
    /// Constants known at run time.
    Constants,
    /// Unknown parameters, or estimates of them.
    Parameters,
    /// Inputs.
    Inputs,
    /// Amplitudes and frequency of a pattern.
    Pattern,
    /// Harmonics of the equations' forces.
    Harmonics,
    /// Memory for intermediate values.
    Workspace,
    /// The result.
    Output,
}

impl fmt::Display for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Buffer::Motion => "motion",
            Buffer::Constants => "constants",
            Buffer::Parameters => "parameters",
            Buffer::Inputs => "inputs",
            Buffer::Pattern => "pattern",
            Buffer::Harmonics => "harmonics",
            Buffer::Workspace => "workspace",
            Buffer::Output => "output",
        })
    }
}

/// Why a model could not be evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum EvalError {
    /// A slice has the wrong length (a workspace may be longer than needed).
    Length {
        /// Which slice.
        buffer: Buffer,
        /// Entries that the model needs.
        needed: usize,
        /// Entries that were given.
        given: usize,
    },
    /// Forward dynamics need as many rows as coordinates.
    NotSquare {
        /// Equations of the model.
        rows: usize,
        /// Coordinates of the model.
        coordinates: usize,
    },
    /// The rows depend on the inputs otherwise than by `B u`, so that the regressor has no value without them.
    InputsNeeded,
    /// The matrix of the highest derivatives is singular, so that the rows do not determine them (a zero mass, for example).
    Singular {
        /// Coordinate whose highest derivative is not determined.
        coordinate: usize,
    },
}

impl fmt::Display for EvalError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            EvalError::Length { buffer, needed, given } => {
                write!(f, "the {buffer} slice has {given} entries, the model needs {needed}")
            }
            EvalError::NotSquare { rows, coordinates } => write!(
                f,
                "the model has {rows} equations for {coordinates} coordinates, so that its motion is not determined by them"
            ),
            EvalError::InputsNeeded => f.write_str(
                "an input stands in a function, beside the motion or with a gain of its own, so that the equations have no value without the inputs; only a simulation uses this model",
            ),
            EvalError::Singular { coordinate } => write!(
                f,
                "the equations do not determine the highest derivative of coordinate {coordinate}; is a mass or an inertia zero?"
            ),
        }
    }
}

impl core::error::Error for EvalError {}

/// Requires a slice of exactly `needed` entries.
///
/// ```
/// # use tpm_controller::model::*;
/// let short = EvalError::Length { buffer: Buffer::Motion, needed: 3, given: 2 };
/// assert_eq!(require_len(Buffer::Motion, 2, 3), Err(short));
/// ```
///
/// # Errors
/// [`EvalError::Length`] that names the slice.
pub fn require_len(buffer: Buffer, given: usize, needed: usize) -> Result<(), EvalError> {
    if given == needed { Ok(()) } else { Err(EvalError::Length { buffer, needed, given }) }
}

/// A slice of exactly N entries as an array.
///
/// ```
/// # use tpm_controller::model::*;
/// assert_eq!(fixed(Buffer::Inputs, &[1.0, 2.0]), Ok(&[1.0, 2.0]));
/// ```
///
/// # Errors
/// [`EvalError::Length`] that names the slice.
pub fn fixed<T, const N: usize>(buffer: Buffer, slice: &[T]) -> Result<&[T; N], EvalError> {
    let wrong = EvalError::Length { buffer, needed: N, given: slice.len() };
    slice.try_into().map_err(|_| wrong)
}

/// Copies results into the caller's output.
///
/// ```
/// # use tpm_controller::model::*;
/// let mut out = [0.0; 2];
/// assert_eq!((store(&[1.0, 2.0], &mut out), out), (Ok(()), [1.0, 2.0]));
/// ```
///
/// # Errors
/// [`EvalError::Length`] when the output has another length.
pub fn store<T: Copy>(results: &[T], out: &mut [T]) -> Result<(), EvalError> {
    require_len(Buffer::Output, out.len(), results.len())?;
    // Not `copy_from_slice`, whose own length check could panic as far as a linker knows.
    for (slot, &result) in out.iter_mut().zip(results) {
        *slot = result;
    }
    Ok(())
}

/// The first `needed` entries of a workspace and the rest.
///
/// ```
/// # use tpm_controller::model::*;
/// let mut workspace = [0.0; 5];
/// let (own, rest) = split_workspace(&mut workspace, 2)?;
/// assert_eq!((own.len(), rest.len()), (2, 3));
/// # Ok::<(), EvalError>(())
/// ```
///
/// # Errors
/// [`EvalError::Length`] when the workspace is shorter.
pub fn split_workspace<T>(workspace: &mut [T], needed: usize) -> Result<(&mut [T], &mut [T]), EvalError> {
    let given = workspace.len();
    workspace.split_at_mut_checked(needed).ok_or(EvalError::Length { buffer: Buffer::Workspace, needed, given })
}

/// How far dry friction has built up since a coordinate reversed, from -1 to 1. From one position to the next, between which the
/// coordinate moves one way, it goes on by
///
/// ```text
/// D := s - (s - D) exp(-|step| / travel),    s the sign of the step
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Presliding<T> {
    /// The coordinate that reverses.
    pub of: usize,
    /// The travel over which all but 1/e of it builds up, in the unit of that coordinate.
    pub travel: T,
}

/// How many coordinates of a model move on their own; those that follow from others stand behind them.
pub fn moving<T: Real>(model: &dyn Model<T>) -> usize {
    (0..model.dims().coordinates).take_while(|&c| model.presliding(c).is_none()).count()
}

/// What is given the rows at many instants: the number of an instant, Phi and the known terms.
pub type Take<'a, T> = dyn FnMut(usize, &[T], &[T]) + 'a;

/// A dynamics model, linear in its unknown parameters (see the module's invariant).
///
/// Indices given to the naming methods are below the matching member of [`Dims`]; beyond it an implementation returns an
/// empty [`Label`] rather than panic.
pub trait Model<T: Real>: Send + Sync {
    /// Name of the model.
    fn name(&self) -> &str;
    /// Sizes, which never change during the lifetime of the model.
    fn dims(&self) -> Dims;

    /// The text in which the model was declared, from which its exact form, patterns and physical parameters can be
    /// derived again; nothing for a model that was written by hand.
    fn source(&self) -> Option<&str> {
        None
    }

    /// Name and unit of a coordinate.
    fn coordinate(&self, index: usize) -> Label<'_>;
    /// Whether sensors measure a coordinate.
    fn is_measured(&self, index: usize) -> bool {
        let _ = index;
        true
    }
    /// What a coordinate follows from that has no sensor and no equation of its own: how far the friction of another one has built up.
    /// Nothing for every other coordinate.
    fn presliding(&self, index: usize) -> Option<Presliding<T>> {
        let _ = index;
        None
    }
    /// Name and unit of an input.
    fn input(&self, index: usize) -> Label<'_>;
    /// Name and unit of a parameter in which the rows are linear (a lumped one has its canonical name).
    fn parameter(&self, index: usize) -> Label<'_>;
    /// Least and largest value of a parameter in which the rows are nonlinear, and only linearised about a point;
    /// nothing for every other parameter.
    fn parameter_interval(&self, index: usize) -> Option<[T; 2]> {
        let _ = index;
        None
    }
    /// Name and unit of a constant that is known at run time.
    fn constant(&self, index: usize) -> Label<'_>;
    /// Name and unit of a row: the input's name when its right-hand side contains exactly one, else eq1, eq2, ...
    fn row(&self, index: usize) -> Label<'_>;

    /// Highest derivative of one coordinate that the rows use, at most `dims().order`.
    ///
    /// Slots of a motion above it are not read.
    fn coordinate_order(&self, index: usize) -> usize {
        let _ = index;
        self.dims().order
    }

    /// Entries of workspace that [`regressor`](Model::regressor), [`known`](Model::known) and
    /// [`input_map`](Model::input_map) need.
    fn workspace_len(&self) -> usize;

    /// Phi: rows x parameters, row-major, into `out`.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the workspace is too short.
    fn regressor(&self, motion: &[T], constants: &[T], workspace: &mut [T], out: &mut [T]) -> Result<(), EvalError>;

    /// The terms without an unknown parameter, on the left-hand side: one number per row into `out`.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the workspace is too short.
    fn known(&self, motion: &[T], constants: &[T], workspace: &mut [T], out: &mut [T]) -> Result<(), EvalError>;

    /// B: rows x inputs, row-major, into `out`.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the workspace is too short.
    fn input_map(&self, motion: &[T], constants: &[T], workspace: &mut [T], out: &mut [T]) -> Result<(), EvalError>;

    /// Whether the rows depend on the inputs otherwise than by `B u`. [`regressor`](Model::regressor) and [`known`](Model::known)
    /// then are [`EvalError::InputsNeeded`], and [`rows_under`](Model::rows_under) takes their place.
    fn needs_inputs(&self) -> bool {
        false
    }

    /// Phi and the known terms under given inputs, into `phi` and `known`; the workspace is as long as that of
    /// [`regressor`](Model::regressor).
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the workspace is too short.
    fn rows_under(
        &self,
        motion: &[T],
        inputs: &[T],
        constants: &[T],
        workspace: &mut [T],
        (phi, known): (&mut [T], &mut [T]),
    ) -> Result<(), EvalError> {
        require_len(Buffer::Inputs, inputs.len(), self.dims().inputs)?;
        self.regressor(motion, constants, workspace, phi)?;
        self.known(motion, constants, workspace, known)
    }

    /// Phi and the known terms at many instants, whose motions stand one behind the other: `take` is given the number of an instant and both.
    /// The workspace is as long as that of [`regressor`](Model::regressor); `phi` and `known` hold one instant.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the workspace is too short.
    fn rows_along(
        &self,
        motions: &[T],
        constants: &[T],
        workspace: &mut [T],
        (phi, known): (&mut [T], &mut [T]),
        take: &mut Take<'_, T>,
    ) -> Result<(), EvalError> {
        for (instant, motion) in motions.chunks(self.dims().motion_len().max(1)).enumerate() {
            self.regressor(motion, constants, workspace, phi)?;
            self.known(motion, constants, workspace, known)?;
            take(instant, phi, known);
        }
        Ok(())
    }

    /// The derivative of the rows with respect to the parameters at given values; it equals the regressor where the
    /// rows are linear in all of them. Rows x parameters, row-major, into `out`; the workspace is as long as that of
    /// [`regressor`](Model::regressor).
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the workspace is too short.
    fn sensitivity(
        &self,
        motion: &[T],
        parameters: &[T],
        constants: &[T],
        workspace: &mut [T],
        out: &mut [T],
    ) -> Result<(), EvalError> {
        require_len(Buffer::Parameters, parameters.len(), self.dims().parameters)?;
        self.regressor(motion, constants, workspace, out)
    }

    /// Entries of workspace that [`inverse_dynamics`](Model::inverse_dynamics) needs.
    fn inverse_workspace_len(&self) -> usize {
        self.workspace_len() + self.dims().regressor_len()
    }

    /// Phi theta + known: the generalised force B u that the motion needs, one number per row into `out`.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the workspace is too short.
    fn inverse_dynamics(
        &self,
        motion: &[T],
        parameters: &[T],
        constants: &[T],
        workspace: &mut [T],
        out: &mut [T],
    ) -> Result<(), EvalError> {
        let dims = self.dims();
        require_len(Buffer::Parameters, parameters.len(), dims.parameters)?;
        require_len(Buffer::Output, out.len(), dims.rows)?;
        let (scratch, rest) = split_workspace(workspace, self.workspace_len())?;
        let (phi, _) = split_workspace(rest, dims.regressor_len())?;
        self.known(motion, constants, scratch, out)?;
        self.regressor(motion, constants, scratch, phi)?;
        if dims.parameters > 0 {
            for (force, row) in out.iter_mut().zip(phi.chunks_exact(dims.parameters)) {
                for (&entry, &value) in row.iter().zip(parameters) {
                    *force += entry * value;
                }
            }
        }
        Ok(())
    }

    /// Entries of workspace that [`forward_dynamics`](Model::forward_dynamics) needs.
    fn forward_workspace_len(&self) -> usize {
        difference_workspace_len(self)
    }

    /// Solves the rows for the highest derivative of every coordinate and writes them into their slots of `motion`.
    ///
    /// `motion` holds the lower derivatives on entry; the slots of the highest ones may hold anything. The rows must be
    /// affine in them, as equations of motion are, and neither the input map nor other factors of `known` may depend on
    /// them. A model without an explicit matrix of the highest derivatives computes it with [`forward_by_differences`].
    ///
    /// # Errors
    /// [`EvalError::NotSquare`] unless there are as many rows as coordinates, [`EvalError::Singular`] when the rows do not
    /// determine a highest derivative, [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the
    /// workspace is too short.
    fn forward_dynamics(
        &self,
        motion: &mut [T],
        parameters: &[T],
        constants: &[T],
        inputs: &[T],
        workspace: &mut [T],
    ) -> Result<(), EvalError> {
        forward_by_differences(self, motion, parameters, constants, inputs, workspace)
    }
}

/// Entries of workspace that [`forward_by_differences`] needs.
pub fn difference_workspace_len<T: Real, M: Model<T> + ?Sized>(model: &M) -> usize {
    let dims = model.dims();
    model.workspace_len() + 2 * dims.regressor_len() + dims.input_map_len() + dims.rows * (dims.coordinates + 2)
}

/// [`Model::forward_dynamics`] by regressor, known terms and input map alone: the matrix of the highest derivatives is the
/// difference of the rows at unit and at zero values of each.
///
/// Differences are taken per column, before the parameters enter, so that a small mass beside a large spring force loses no
/// digits.
///
/// # Errors
/// [`EvalError::NotSquare`] unless there are as many rows as coordinates, [`EvalError::Singular`] when the rows do not
/// determine a highest derivative, [`EvalError::Length`] when a slice has another length than [`Dims`] says, or the workspace
/// is shorter than [`difference_workspace_len`].
pub fn forward_by_differences<T: Real, M: Model<T> + ?Sized>(
    model: &M,
    motion: &mut [T],
    parameters: &[T],
    constants: &[T],
    inputs: &[T],
    workspace: &mut [T],
) -> Result<(), EvalError> {
    let dims = model.dims();
    require_forward(dims, motion, parameters, inputs)?;
    let n = dims.coordinates;
    let (scratch, rest) = split_workspace(workspace, model.workspace_len())?;
    let (phi_zero, rest) = split_workspace(rest, dims.regressor_len())?;
    let (phi_unit, rest) = split_workspace(rest, dims.regressor_len())?;
    let (map, rest) = split_workspace(rest, dims.input_map_len())?;
    let (matrix, rest) = split_workspace(rest, n * n)?;
    let (known_unit, rest) = split_workspace(rest, n)?;
    let (right, _) = split_workspace(rest, n)?;

    for c in 0..n {
        motion[model.coordinate_order(c) * n + c] = T::ZERO;
    }
    model.regressor(motion, constants, scratch, phi_zero)?;
    model.known(motion, constants, scratch, right)?;
    for c in 0..n {
        let slot = model.coordinate_order(c) * n + c;
        motion[slot] = T::ONE;
        model.regressor(motion, constants, scratch, phi_unit)?;
        model.known(motion, constants, scratch, known_unit)?;
        motion[slot] = T::ZERO;
        for r in 0..n {
            let mut entry = known_unit[r] - right[r];
            for (j, &value) in parameters.iter().enumerate() {
                let at = r * dims.parameters + j;
                entry += (phi_unit[at] - phi_zero[at]) * value;
            }
            matrix[r * n + c] = entry;
        }
    }
    model.input_map(motion, constants, scratch, map)?;
    for r in 0..n {
        let mut sum = -right[r];
        for (j, &value) in parameters.iter().enumerate() {
            sum -= phi_zero[r * dims.parameters + j] * value;
        }
        for (j, &value) in inputs.iter().enumerate() {
            sum += map[r * dims.inputs + j] * value;
        }
        right[r] = sum;
    }
    linear::solve_in_place(matrix, right).map_err(|coordinate| EvalError::Singular { coordinate })?;
    for c in 0..n {
        motion[model.coordinate_order(c) * n + c] = right[c];
    }
    Ok(())
}

/// Requires as many rows as coordinates, and slices that fit the model's sizes.
///
/// # Errors
/// [`EvalError::NotSquare`], or [`EvalError::Length`] that names the slice.
pub fn require_forward<T>(dims: Dims, motion: &[T], parameters: &[T], inputs: &[T]) -> Result<(), EvalError> {
    if dims.rows != dims.coordinates {
        return Err(EvalError::NotSquare { rows: dims.rows, coordinates: dims.coordinates });
    }
    require_len(Buffer::Motion, motion.len(), dims.motion_len())?;
    require_len(Buffer::Parameters, parameters.len(), dims.parameters)?;
    require_len(Buffer::Inputs, inputs.len(), dims.inputs)
}
