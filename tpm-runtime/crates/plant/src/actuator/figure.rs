//! Figures of motors along a motion, and of tracking errors.
//!
//! Invariant: the limit lines in the torque-speed plane are those of steady operation (i' = 0). The voltage across the
//! inductance shows in the panel of the voltage over time.

use crate::actuator::drive::Tracking;
use crate::actuator::motor::Motor;
use crate::actuator::requirement::{Requirement, Sample};
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};

/// Points of a limit line.
const LIMIT_POINTS: usize = 200;

/// Torque over speed with the limits, and the voltage over one period, for every motor; `names` are those of the inputs.
#[must_use]
pub fn torque_speed(title: &str, found: &[Requirement], motors: &[Option<Motor>], names: &[String]) -> Figure {
    let mut panels = Vec::new();
    for requirement in found {
        let Some(motor) = motors.get(requirement.input).copied().flatten() else { continue };
        let name = names.get(requirement.input).map_or("", String::as_str);
        panels.push(plane(requirement, &motor, name));
        panels.push(voltage(requirement, &motor, name));
    }
    Figure::new(title, panels)
}

fn plane(requirement: &Requirement, motor: &Motor, name: &str) -> Panel {
    let k = motor.torque_constant;
    let closed = |value: fn(&Sample) -> f64| -> Vec<(f64, f64)> {
        let samples = requirement.samples.iter().chain(requirement.samples.first());
        samples.map(|sample| (sample.speed, k * value(sample))).collect()
    };
    let fastest = requirement.samples.iter().map(|sample| sample.speed.abs()).fold(0.0, f64::max);
    let highest = requirement.samples.iter().map(|sample| k * sample.current.abs()).fold(0.0, f64::max);
    let mut traces = vec![
        Trace::new("torque along the motion", 0, Curve::Line(closed(|sample| sample.current))),
        Trace::new("motion-independent part of it", 2, Curve::Dashed(closed(|sample| sample.independent))),
    ];
    let reach = 1.15 * fastest.max(1e-3);
    let speeds: Vec<f64> = (0..=LIMIT_POINTS).map(|i| reach * (2.0 * i as f64 / LIMIT_POINTS as f64 - 1.0)).collect();
    let roof = 1.25 * highest.max((k * motor.limits.current).min(4.0 * highest)).max(1e-6);
    let mut line = |label: &str, colour: usize, torque: &dyn Fn(f64) -> f64| {
        for (sign, label) in [(1.0, label), (-1.0, "")] {
            // The plane is symmetric about its origin.
            let points = speeds.iter().map(|&speed| (speed, sign * torque(sign * speed)));
            let points = points.map(|(x, y)| (x, if y.abs() <= roof { y } else { f64::NAN })).collect();
            traces.push(Trace::new(label, colour, Curve::Line(points)));
        }
    };
    if motor.limits.current.is_finite() {
        line("current limit", 1, &|_| k * motor.limits.current);
    }
    if motor.limits.voltage.is_finite() {
        line("voltage limit, steady", 3, &|speed| {
            k * (motor.limits.voltage - motor.back_emf * speed) / motor.resistance
        });
    }
    if motor.limits.power.is_finite() {
        line("power limit, steady", 4, &|speed| {
            let emf = motor.back_emf * speed;
            let root = (emf * emf + 4.0 * motor.resistance * motor.limits.power).sqrt();
            k * (root - emf) / (2.0 * motor.resistance)
        });
    }
    Panel {
        x: Axis::linear(&format!("speed of the rotor of {name} [rad/s]")).from_to(-reach, reach),
        y: Axis::linear("torque of the current [N m]").from_to(-roof, roof),
        traces,
    }
}

fn voltage(requirement: &Requirement, motor: &Motor, name: &str) -> Panel {
    let over = |value: fn(&Sample) -> f64| -> Vec<(f64, f64)> {
        requirement.samples.iter().map(|sample| (sample.time, value(sample))).collect()
    };
    let mut traces = vec![
        Trace::new("voltage", 0, Curve::Line(over(|sample| sample.voltage))),
        Trace::new("for the motion-independent part", 2, Curve::Dashed(over(|sample| sample.independent_voltage))),
    ];
    let last = requirement.samples.last().map_or(0.0, |sample| sample.time);
    if motor.limits.voltage.is_finite() {
        for (label, value) in [("voltage limit", motor.limits.voltage), ("", -motor.limits.voltage)] {
            traces.push(Trace::new(label, 3, Curve::Line(vec![(0.0, value), (last, value)])));
        }
    }
    Panel { x: Axis::linear("time [s]").from_to(0.0, last), y: Axis::linear(&format!("voltage of {name} [V]")), traces }
}

/// Tracking errors over one period as in Feng, Figure 6.5: one panel per coordinate, the split scheme solid, the common one
/// dashed; `names` are those of the coordinates with their units.
#[must_use]
pub fn tracking_errors(title: &str, common: &Tracking, split: &Tracking, names: &[String]) -> Figure {
    let mut panels = Vec::new();
    for (c, name) in names.iter().enumerate() {
        let points = |found: &Tracking| -> Vec<(f64, f64)> {
            let errors = found.errors.get(c).map_or(&[][..], Vec::as_slice);
            found.times.iter().copied().zip(errors.iter().copied()).collect()
        };
        let last = split.times.last().copied().unwrap_or(1.0);
        let traces = vec![
            Trace::new("split feed-forward", 0, Curve::Line(points(split))),
            Trace::new("common feed-forward", 1, Curve::Dashed(points(common))),
        ];
        panels.push(Panel {
            x: Axis::linear("time [s]").from_to(0.0, last),
            y: Axis::linear(&format!("error of {name}")),
            traces,
        });
    }
    Figure::new(title, panels)
}
