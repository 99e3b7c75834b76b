//! Logs of arms of two joints, for tests.

use crate::model::{DeclaredModel, Identifiable as _};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;
use std::fmt::Write;

const SAMPLES: usize = 6000;
const SAMPLE_TIME: f64 = 4e-3;
/// Steps of Euler's rule from one sample to the next, by which friction builds up.
const STEPS: usize = 200;
/// The lines of either joint: frequency, Hz, amplitude, rad, and phase.
const LINES: [[(f64, f64, f64); 2]; 2] = [[(0.21, 0.5, 0.3), (0.57, 0.2, 1.0)], [(0.34, 0.6, 2.0), (0.83, 0.2, 0.1)]];

/// A joint's angle, its rate and its acceleration at a time.
fn joint(c: usize, t: f64) -> [f64; 3] {
    let mut motion = [0.0; 3];
    for (frequency, size, phase) in LINES[c] {
        let w = 2.0 * PI * frequency;
        let (s, cosine) = (w * t + phase).sin_cos();
        motion[0] += size * s;
        motion[1] += size * w * cosine;
        motion[2] -= size * w * w * s;
    }
    motion
}

/// A log of an arm with coordinates q1, q2 and inputs u1, u2, given its parameters, along sums of sines. The second joint reads so much more,
/// rad, and the torques are so many times what they are.
pub(super) fn log(arm: &DeclaredModel, truth: &[f64], zero: f64, gains: [f64; 2]) -> tempfile::NamedTempFile {
    let model = arm.evaluated();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let mut draw = move || -> f64 { StandardNormal.sample(&mut rng) };
    let mut text = String::from("t_s,q1,q2,u1,u2\n");
    let (mut work, mut rows) = (vec![0.0; model.workspace_len()], vec![0.0; model.dims().regressor_len()]);
    let coordinates = model.dims().coordinates;
    let mut motion = vec![0.0; model.dims().motion_len()];
    for k in 0..SAMPLES {
        let t = k as f64 * SAMPLE_TIME;
        for c in 0..2 {
            for (d, value) in joint(c, t).into_iter().enumerate() {
                motion[d * coordinates + c] = value;
            }
        }
        for (z, built) in motion.iter_mut().enumerate().take(coordinates).skip(2) {
            let Some(own) = model.presliding(z).filter(|_| k > 0) else { continue };
            for step in 0..STEPS {
                let h = SAMPLE_TIME / STEPS as f64;
                let moved = h * joint(own.of, t - SAMPLE_TIME + (step as f64 + 0.5) * h)[1];
                *built += (moved - moved.abs() * *built) / own.travel;
            }
        }
        model.regressor(&motion, &[], &mut work, &mut rows).expect("lengths fit");
        let force = |row: usize| {
            let row = &rows[truth.len() * row..][..truth.len()];
            row.iter().zip(truth).map(|(own, truth)| own * truth).sum::<f64>()
        };
        let read = [motion[0], motion[1] + zero].map(|q| q + 1e-5 * draw());
        let torque = [gains[0] * force(0), gains[1] * force(1)].map(|u| u + 0.05 * draw());
        writeln!(text, "{t:.3},{:.9},{:.9},{:.9},{:.9}", read[0], read[1], torque[0], torque[1])
            .expect("a string takes everything");
    }
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    file
}
