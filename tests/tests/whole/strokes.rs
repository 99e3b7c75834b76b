//! Generated strokes in Rust beside those of the runtime.

use crate::generated::strokes::mass_spring_drag::Pattern;
use std::f64::consts::PI;
use tpm_runtime::motion::stroke::{Stroke, repeated};
use tpm_runtime::motion::trajectory::{HarmonicSeries, Line, Trajectory};

#[test]
fn generated_strokes_with_rests_are_the_reference_of_a_campaign() {
    let pattern = Pattern { lambda: 0.3, w: PI };
    let lines = vec![Line { harmonic: 1, cos: 0.3, sin: 0.0 }, Line { harmonic: 3, cos: -0.3 / 9.0, sin: 0.0 }];
    let trajectory = Trajectory { frequency: PI, coordinates: vec![HarmonicSeries { mean: 0.0, lines }] };
    let halves = [(0.0, PI), (PI, 2.0 * PI)];
    let strokes = halves.map(|phases| Stroke { trajectory: trajectory.clone(), phases, dwell: 0.5 });
    let reference = repeated(&strokes);
    for n in 0..300 {
        let time = f64::from(n) / 100.0;
        // A stroke of a second and a rest of half a second, forth and back.
        let forth = time < 1.5;
        let since = if forth { time } else { time - 1.5 };
        let (from, to) = if forth { (0.0, PI) } else { (PI, 2.0 * PI) };
        let x = pattern.stroke(since, from, to).x;
        let mut motion = [0.0; 3];
        reference.motion(reference.frequency * time, &mut motion);
        let scale = 0.3 * 4.0 / 3.0;
        let bounds = [1e-6 * scale, 1e-4 * scale * PI, 5e-3 * scale * PI * PI];
        for ((found, expected), bound) in motion.into_iter().zip([x.value, x.dot, x.ddot]).zip(bounds) {
            assert!((found - expected).abs() < bound, "{time}: {motion:?} {x:?}");
        }
    }
    let resting = pattern.stroke(7.0, 0.0, PI).x;
    assert_eq!((resting.dot, resting.ddot), (0.0, 0.0));
}
