//! The two-joint closed-loop arm of Feng, chapter 5, with its loop closed exactly.
//!
//! Links 3, 4 and 5 hang on link 12 as a four-bar loop, `l4 e^{j th2} + l5 e^{j th3} = l2 + l3 e^{j th4}`, angles relative to
//! link 12. The kinetic energy is `f1 th1'^2 + f3 th1' th2' + f2 th2'^2` with f1..f3 functions of th2 through the closure
//! (Feng, Appendix A), and Eqns 5.1, 5.2 are its Lagrange equations. Invariant: nothing is expanded; the slopes of f1..f3
//! come from the same formulas by automatic differentiation, so that power balances to rounding.

use std::ops::{Add, Div, Mul, Neg, Sub};
use tpm_controller::model::{Buffer, Dims, EvalError, Label, Model, require_len};

/// Geometry and masses of an arm (Feng, Figure 5.1), in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmGeometry {
    /// l1 to l5, m.
    pub lengths: [f64; 5],
    /// m12, m3, m4, m56, kg.
    pub masses: [f64; 4],
    /// r1, r3, r4, r5: from the joint to the centre of mass, m.
    pub centroids: [f64; 4],
    /// I12, I3, I4, I56, kg m^2.
    pub inertias: [f64; 4],
    /// Commanded units per N m.
    pub torque_scale: f64,
}

/// The arm as a plant with known constants and no parameters to identify.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosedLoopArm {
    geometry: ArmGeometry,
    /// A1 to A8 (Feng, Eqns A.3-A.10).
    constants: [f64; 8],
}

impl ClosedLoopArm {
    /// An arm of these links.
    #[must_use]
    pub fn new(geometry: ArmGeometry) -> Self {
        let ArmGeometry { lengths: [l1, l2, _, l4, _], masses: [m12, m3, m4, m56], .. } = geometry;
        let ArmGeometry { centroids: [r1, r3, r4, r5], inertias: [i12, i3, i4, i56], .. } = geometry;
        let constants = [
            m12 * r1 * r1
                + i12
                + m3 * (l1 + l2) * (l1 + l2)
                + m3 * r3 * r3
                + i3
                + m4 * (l1 * l1 + r4 * r4)
                + i4
                + m56 * (l1 * l1 + l4 * l4 + r5 * r5)
                + i56,
            m4 * l1 * r4 + m56 * l1 * l4,
            m56 * l1 * r5,
            m3 * (l1 + l2) * r3,
            m56 * l4 * r5,
            m4 * r4 * r4 + i4 + m56 * l4 * l4,
            m56 * r5 * r5 + i56,
            m3 * r3 * r3 + i3,
        ];
        ClosedLoopArm { geometry, constants }
    }

    /// A1 to A8 (Feng, Eqns A.3 to A.10), kg m^2.
    #[must_use]
    pub fn lumped_inertias(&self) -> [f64; 8] {
        self.constants
    }

    /// th3 and th4 with the loop closed, elbow up; not numbers where it cannot close.
    #[must_use]
    pub fn loop_angles(&self, th2: f64) -> (f64, f64) {
        let (th3, th4) = self.closed(Slope::of(th2));
        (th3.value, th4.value)
    }

    fn closed(&self, th2: Slope) -> (Slope, Slope) {
        let [_, l2, l3, l4, l5] = self.geometry.lengths.map(Slope::constant);
        let square = l2 * l2 + l4 * l4 - Slope::constant(2.0) * l2 * l4 * th2.cos();
        let d = square.sqrt();
        let beta = (l4 * th2.sin()).atan2(l2 - l4 * th2.cos());
        let two = Slope::constant(2.0);
        let at5 = ((square + l5 * l5 - l3 * l3) / (two * l5 * d)).acos();
        let at3 = ((square + l3 * l3 - l5 * l5) / (two * l3 * d)).acos();
        (at5 - beta, Slope::constant(std::f64::consts::PI) - at3 - beta)
    }

    /// f1, f2, f3 and their slopes, in commanded units.
    #[must_use]
    pub fn functions(&self, th2: f64) -> [(f64, f64); 3] {
        let q2 = Slope::of(th2);
        let (q3, q4) = self.closed(q2);
        let [_, _, l3, l4, l5] = self.geometry.lengths.map(Slope::constant);
        let [a1, a2, a3, a4, a5, a6, a7, a8] = self.constants.map(Slope::constant);
        let half = Slope::constant(0.5);
        let between = (q2 - q3).cos();
        // dth3/dth2 and dth4/dth2 in the loop.
        let r3 = l4 * (q4 - q2).sin() / (l5 * (q3 - q4).sin());
        let r4 = l4 * (q3 - q2).sin() / (l3 * (q3 - q4).sin());
        let f1 = half * a1 + a2 * q2.cos() + a3 * q3.cos() + a4 * q4.cos() + a5 * between;
        let f2 = half * a6 + half * a7 * r3 * r3 + half * a8 * r4 * r4 + a5 * between * r3;
        let f3 =
            a6 + a2 * q2.cos() + a5 * between + (a7 + a3 * q3.cos() + a5 * between) * r3 + (a8 + a4 * q4.cos()) * r4;
        [f1, f2, f3].map(|f| (self.geometry.torque_scale * f.value, self.geometry.torque_scale * f.slope))
    }
}

/// A value with its derivative by th2.
#[derive(Clone, Copy, Debug)]
struct Slope {
    value: f64,
    slope: f64,
}

impl Slope {
    const fn of(value: f64) -> Self {
        Slope { value, slope: 1.0 }
    }

    const fn constant(value: f64) -> Self {
        Slope { value, slope: 0.0 }
    }

    fn sin(self) -> Self {
        Slope { value: self.value.sin(), slope: self.slope * self.value.cos() }
    }

    fn cos(self) -> Self {
        Slope { value: self.value.cos(), slope: -self.slope * self.value.sin() }
    }

    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Slope { value, slope: self.slope / (2.0 * value) }
    }

    fn acos(self) -> Self {
        Slope { value: self.value.acos(), slope: -self.slope / (1.0 - self.value * self.value).sqrt() }
    }

    fn atan2(self, x: Self) -> Self {
        let size = self.value * self.value + x.value * x.value;
        Slope { value: self.value.atan2(x.value), slope: (self.slope * x.value - self.value * x.slope) / size }
    }
}

impl Add for Slope {
    type Output = Slope;
    fn add(self, other: Self) -> Self {
        Slope { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl Sub for Slope {
    type Output = Slope;
    fn sub(self, other: Self) -> Self {
        Slope { value: self.value - other.value, slope: self.slope - other.slope }
    }
}

impl Neg for Slope {
    type Output = Slope;
    fn neg(self) -> Self {
        Slope { value: -self.value, slope: -self.slope }
    }
}

impl Mul for Slope {
    type Output = Slope;
    fn mul(self, other: Self) -> Self {
        Slope { value: self.value * other.value, slope: self.slope * other.value + self.value * other.slope }
    }
}

impl Div for Slope {
    type Output = Slope;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Slope { value, slope: (self.slope - value * other.slope) / other.value }
    }
}

impl Model<f64> for ClosedLoopArm {
    fn name(&self) -> &str {
        "ClosedLoopArm"
    }

    fn dims(&self) -> Dims {
        Dims { coordinates: 2, order: 2, inputs: 2, rows: 2, parameters: 0, constants: 0 }
    }

    fn coordinate(&self, index: usize) -> Label<'_> {
        ["th1", "th2"].get(index).map_or(Label::bare(""), |name| Label::new(name, "rad"))
    }

    fn input(&self, index: usize) -> Label<'_> {
        ["tau1", "tau2"].get(index).map_or(Label::bare(""), |name| Label::bare(name))
    }

    fn parameter(&self, _: usize) -> Label<'_> {
        Label::bare("")
    }

    fn constant(&self, _: usize) -> Label<'_> {
        Label::bare("")
    }

    fn row(&self, index: usize) -> Label<'_> {
        self.input(index)
    }

    fn workspace_len(&self) -> usize {
        0
    }

    fn regressor(&self, motion: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
        require_len(Buffer::Motion, motion.len(), 6)?;
        require_len(Buffer::Output, out.len(), 0)
    }

    fn known(&self, motion: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
        require_len(Buffer::Output, out.len(), 2)?;
        let &[_, th2, w1, w2, acceleration1, acceleration2] = motion else {
            return Err(EvalError::Length { buffer: Buffer::Motion, needed: 6, given: motion.len() });
        };
        let [(f1, d1), (f2, d2), (f3, d3)] = self.functions(th2);
        // Feng, Eqns 5.1 and 5.2.
        out[0] = 2.0 * f1 * acceleration1 + f3 * acceleration2 + 2.0 * d1 * w1 * w2 + d3 * w2 * w2;
        out[1] = f3 * acceleration1 + 2.0 * f2 * acceleration2 - d1 * w1 * w1 + d2 * w2 * w2;
        Ok(())
    }

    fn input_map(&self, _: &[f64], _: &[f64], _: &mut [f64], out: &mut [f64]) -> Result<(), EvalError> {
        require_len(Buffer::Output, out.len(), 4)?;
        out.copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::{ArmGeometry, ClosedLoopArm};
    use tpm_controller::model::Model as _;
    use tpm_motion::Plant;

    /// Two arms that fit the torques of Feng's Table 5.1 about equally well.
    pub(crate) const RIGS: [(ArmGeometry, f64, [f64; 9]); 2] = [
        (
            ArmGeometry {
                lengths: [0.100445980, 0.437018273, 0.431160162, 0.100730344, 0.698343839],
                masses: [13.8171105, 14.5860601, 0.347198293, 14.5243601],
                centroids: [0.0232551886, 0.472033879, -0.00871691643, 0.354996550],
                inertias: [0.382864809, 0.553814730, 0.000659058087, 0.197504354],
                torque_scale: 344.359168,
            },
            5.42161682,
            [2375.0, 891.0, 149.0, 209.0, 171.0, -225.0, -965.0, -807.0, 337.0],
        ),
        (
            ArmGeometry {
                lengths: [0.102832525, 0.490489504, 0.312920196, 0.100188506, 0.698860106],
                masses: [2.05213335, 2.64063002, 14.0523521, 14.7652820],
                centroids: [0.572369221, 0.343367718, 0.00419312107, 0.544407488],
                inertias: [0.0446111264, 0.0527107853, 0.00656877595, 0.231334601],
                torque_scale: 461.049672,
            },
            5.56496917,
            [2366.0, 731.0, -136.0, 207.0, 152.0, -163.0, -1078.0, -1024.0, 316.0],
        ),
    ];

    #[test]
    fn taylor_coefficients_are_those_of_the_rigs() {
        for (geometry, th20, expected) in RIGS {
            let arm = ClosedLoopArm::new(geometry);
            let h = 1e-4;
            for (i, expected) in expected.chunks_exact(3).enumerate() {
                let (value, slope) = arm.functions(th20)[i];
                let bend = (arm.functions(th20 + h)[i].1 - arm.functions(th20 - h)[i].1) / (4.0 * h);
                for (found, expected) in [value, slope, bend].into_iter().zip(expected) {
                    assert!((found - expected).abs() <= 0.51, "f{}: {found} {expected}", i + 1);
                }
                // The slope carried along is that of the function.
                let quotient = (arm.functions(th20 + h)[i].0 - arm.functions(th20 - h)[i].0) / (2.0 * h);
                assert!((quotient - slope).abs() < 1e-4, "{quotient} {slope}");
            }
        }
    }

    #[test]
    fn the_loop_closes_and_energy_is_kept() {
        for (geometry, th20, _) in RIGS {
            let arm = ClosedLoopArm::new(geometry);
            let [_, l2, l3, l4, l5] = geometry.lengths;
            let (th3, th4) = arm.loop_angles(th20);
            assert!((l4 * th20.cos() + l5 * th3.cos() - l2 - l3 * th4.cos()).abs() < 1e-14);
            assert!((l4 * th20.sin() + l5 * th3.sin() - l3 * th4.sin()).abs() < 1e-14);
            let energy = |motion: &[f64]| {
                let [(f1, _), (f2, _), (f3, _)] = arm.functions(motion[1]);
                f1 * motion[2] * motion[2] + f3 * motion[2] * motion[3] + f2 * motion[3] * motion[3]
            };
            let mut plant = Plant::new(&arm, &[], &[]).expect("square");
            plant.reset(&[0.0, th20, 0.3, -0.4, 0.0, 0.0]).expect("six entries");
            let before = energy(plant.motion());
            plant.advance(&[0.0, 0.0], 0.5, 2000).expect("it moves freely");
            assert!((energy(plant.motion()) / before - 1.0).abs() < 1e-9);
            assert_eq!(arm.dims().parameters, 0);
        }
    }
}
