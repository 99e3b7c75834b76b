//! Trees of rigid bodies: equations of motion by recursive Newton-Euler.
//!
//! A body is attached to its parent, which is another body or the base, by a joint. The joint's frame is placed in the
//! parent's frame by an origin and a rotation, and the body's frame moves from there along or about the joint's axis.
//! The inertia of a body consists of ten parameters about the body's own frame,
//!
//! ```text
//! m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz        (mx = m times the x of the centre of mass, Ixy = -int x y dm)
//! ```
//!
//! in which the torques are linear. With the angular velocity w, the angular acceleration e and the acceleration a of the frame
//! (gravity subtracted at the base), all in the frame of the body,
//!
//! ```text
//! U = [e]x + [w]x [w]x ,       force f = m a + U h ,       moment n = I e + w x I w + h x a ,       h = (mx, my, mz) .
//! ```
//!
//! Points on the axis of a revolute joint have the same motion on both links that it connects. Along an axis of both
//! frames U e_k is therefore equal to that of the carrying link, and two components of e follow from it. Masses on such
//! an axis may be assigned to the carrying link or to the carried one. Before torques are computed with numerical
//! inertias, they are assigned to the carrying link.
//!
//! The torque of joint j is the power of these wrenches along its screw: with the angular velocity and the velocity (s, v) that a
//! unit rate of joint j alone gives to the frame of a body outward of it, the body adds s.n + v.f. The screws are sent outward
//! (`DESIGN.md`, "Why do arms have recursions of their own?").
//!
//! Invariants: nothing is multiplied out; cos q and sin q are atoms of the graph; every product and sum with a zero or a one of
//! the geometry is folded; every intermediate value is one node, so that a plan computes it once. The text grows with the number
//! of bodies times the depth of the tree.

mod about_centre;
mod bodies;
mod composite;
mod inertia;
mod links;
pub mod mechanism;
mod motion;
mod regressor;
pub mod rotation;
mod torque;
mod vector;

pub use about_centre::AboutCentre;
pub use bodies::{Body, Joint, Tree, TreeError};
pub use inertia::{Inertia, InertiaFault, NAMES, about_origin, fault};
pub use regressor::{Entry, JointRow};
pub use vector::Vector;
