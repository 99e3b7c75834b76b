//! Fourier transforms of whole periods.
//!
//! Invariant: a phasor a_c - j a_s stands for `a_c cos + a_s sin`, one-sided from harmonic 1 on, and the mean is at 0. A
//! transform of a length is planned once per thread; results do not depend on how often a plan was used before.

use num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::cell::RefCell;
use std::sync::Arc;

std::thread_local! {
    static PLANNER: RefCell<RealFftPlanner<f64>> = RefCell::new(RealFftPlanner::new());
}

/// The transform of `points` real values.
pub fn forward(points: usize) -> Arc<dyn RealToComplex<f64>> {
    PLANNER.with_borrow_mut(|planner| planner.plan_fft_forward(points))
}

/// The inverse transform to `points` real values.
pub fn inverse(points: usize) -> Arc<dyn ComplexToReal<f64>> {
    PLANNER.with_borrow_mut(|planner| planner.plan_fft_inverse(points))
}

/// One period of a signal, or of its derivative of order `derivative`, at `points` equally spaced times. `lines` are
/// its one-sided phasors from the mean on, of which those up to `harmonics` are used; `fundamental` is in rad/s.
pub fn synthesise(
    lines: &[Complex<f64>],
    derivative: usize,
    fundamental: f64,
    harmonics: usize,
    points: usize,
) -> Vec<f64> {
    let transform = inverse(points);
    let mut spectrum = transform.make_input_vec();
    for (k, slot) in spectrum.iter_mut().enumerate().take(harmonics.min(points / 2 - 1) + 1) {
        let Some(&line) = lines.get(k) else { break };
        *slot = if k == 0 {
            if derivative == 0 { Complex::new(line.re, 0.0) } else { Complex::new(0.0, 0.0) }
        } else {
            line * 0.5 * Complex::new(0.0, k as f64 * fundamental).powu(derivative as u32)
        };
    }
    let mut out = transform.make_output_vec();
    transform
        .process(&mut spectrum, &mut out)
        .expect("invariant: the mean is real and the buffers were made for this transform");
    out
}

/// One-sided phasors 0 to `harmonics` of a period sampled evenly, every `stride`-th value from `offset`.
pub fn analyse(values: &[f64], offset: usize, stride: usize, harmonics: usize) -> Vec<Complex<f64>> {
    let mut series: Vec<f64> = values.iter().skip(offset).step_by(stride).copied().collect();
    let points = series.len();
    let transform = forward(points);
    let mut spectrum = transform.make_output_vec();
    transform.process(&mut series, &mut spectrum).expect("invariant: buffers were made for this transform");
    let scale = 1.0 / points as f64;
    (0..=harmonics)
        .map(|k| match spectrum.get(k) {
            Some(z) if k == 0 => z * scale,
            Some(z) => z * (2.0 * scale),
            None => Complex::new(0.0, 0.0),
        })
        .collect()
}

/// Two-sided Fourier coefficients of a period sampled evenly, from the mean on. Those of negative harmonics are the
/// conjugates, since the series is real.
pub fn two_sided(series: &[f64]) -> Vec<Complex<f64>> {
    let mut lines = analyse(series, 0, 1, (series.len() / 2).saturating_sub(1));
    lines.iter_mut().skip(1).for_each(|line| *line *= 0.5);
    lines
}

/// The two-sided coefficient of a positive or negative harmonic; zero beyond the end of the list.
pub fn coefficient(two_sided: &[Complex<f64>], harmonic: isize) -> Complex<f64> {
    let line = two_sided.get(harmonic.unsigned_abs()).copied().unwrap_or_default();
    if harmonic < 0 { line.conj() } else { line }
}
