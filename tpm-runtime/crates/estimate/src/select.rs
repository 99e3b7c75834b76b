//! Which harmonics carry information.
//!
//! Invariant: a harmonic is judged by what was measured there against the noise of the same record; no data set and no
//! model is known here (`DESIGN.md`, "Which harmonics are used?").

use num_complex::Complex;
use tpm_numerics::{alarm, tolerance};

/// Lines of the tail are grouped by so many before their residuals are compared.
const LINES_PER_BLOCK: usize = 8;
/// Fewest blocks for a comparison of the tail with the rest.
const LEAST_BLOCKS: usize = 5;
/// A block of the tail whose residual exceeds the median block so many times is not explained by the model.
const MOST_OVER_MEDIAN: f64 = 3.0;
/// A line stands alone when more than this many lines are missing below it.
const MOST_MISSING_LINES: usize = 16;

/// Whether a line stands out of its noise, and out of the rounding of the strongest line of its signal.
pub(super) fn visible(line: Complex<f64>, variance: f64, peak: f64) -> bool {
    let power = line.norm_sqr();
    power > alarm::VISIBLE_LINE * variance && power > (tolerance::LINE * peak).powi(2)
}

/// Highest line of a signal that is visible and no straggler of noise; 0 when none is.
pub(super) fn highest_visible(lines: &[Complex<f64>], variance: impl Fn(usize) -> f64, limit: usize) -> usize {
    let peak = strongest(lines);
    let found = (1..lines.len().min(limit + 1)).filter(|&k| visible(lines[k], variance(k), peak)).collect();
    let found = without_stragglers(found, |k| lines[k].norm_sqr() > alarm::LONE_LINE * variance(k));
    found.last().copied().unwrap_or(0)
}

/// Largest modulus of a line above the mean.
pub(super) fn strongest(lines: &[Complex<f64>]) -> f64 {
    lines.iter().skip(1).map(|z| z.norm()).fold(0.0, f64::max)
}

/// The lines up to the first wide gap behind which none is substantial: one line in many stands out of its noise by chance.
pub(super) fn without_stragglers(mut lines: Vec<usize>, substantial: impl Fn(usize) -> bool) -> Vec<usize> {
    let mut keep = lines.len();
    for i in (1..lines.len()).rev() {
        if substantial(lines[i]) {
            break;
        }
        if lines[i] - lines[i - 1] > MOST_MISSING_LINES.max(lines[i - 1] / 8) {
            keep = i;
        }
    }
    lines.truncate(keep);
    lines
}

/// The first line of a tail that the model does not explain, from the residual moduli of the used lines in ascending
/// order of the harmonic and the standard deviation that noise gives each; `None` when there is no such tail.
///
/// A model has an end of its band (an amplifier, a filter, a mode that it leaves out): beyond it residuals rise far above
/// noise and above the rest of the spectrum. Only a tail is cut, never the middle, and never half of the lines.
pub(super) fn unexplained_tail(harmonics: &[usize], residual: &[f64], noise: &[f64]) -> Option<usize> {
    let blocks: Vec<f64> = residual
        .chunks_exact(LINES_PER_BLOCK)
        .map(|b| (b.iter().map(|r| r * r).sum::<f64>() / LINES_PER_BLOCK as f64).sqrt())
        .collect();
    if blocks.len() < LEAST_BLOCKS {
        return None;
    }
    let mut sorted = blocks.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let mut cut = blocks.len();
    while cut > blocks.len() / 2 {
        let i = cut - 1;
        let of_noise = noise[i * LINES_PER_BLOCK..(i + 1) * LINES_PER_BLOCK].iter().map(|s| s * s).sum::<f64>()
            / LINES_PER_BLOCK as f64;
        if blocks[i] > MOST_OVER_MEDIAN * median && blocks[i] > MOST_OVER_MEDIAN * of_noise.sqrt() {
            cut -= 1;
        } else {
            break;
        }
    }
    (cut < blocks.len()).then(|| harmonics[cut * LINES_PER_BLOCK])
}

#[cfg(test)]
mod tests {
    use super::{highest_visible, unexplained_tail, without_stragglers};
    use num_complex::Complex;

    #[test]
    fn lines_that_stand_alone_are_dropped_unless_strong() {
        let lines = vec![1, 3, 10, 40, 300];
        assert_eq!(without_stragglers(lines.clone(), |_| false), [1, 3, 10]);
        assert_eq!(without_stragglers(lines.clone(), |k| k == 40), [1, 3, 10, 40]);
        assert_eq!(without_stragglers(lines, |k| k == 300), [1, 3, 10, 40, 300]);
        assert!(without_stragglers(vec![], |_| false).is_empty());
    }

    #[test]
    fn a_line_of_noise_far_above_all_others_does_not_widen_the_band() {
        let mut lines = vec![Complex::new(0.0, 0.0); 1000];
        (lines[1], lines[3], lines[988]) = (1.0.into(), 0.1.into(), 5e-3.into());
        assert_eq!(highest_visible(&lines, |_| 1e-6, 999), 3);
        // The same line above less noise is motion.
        assert_eq!(highest_visible(&lines, |_| 1e-8, 999), 988);
    }

    #[test]
    fn only_a_tail_above_noise_is_cut() {
        let harmonics: Vec<usize> = (1..=80).collect();
        let noise = vec![1e-3; 80];
        let flat = vec![1.0; 80];
        assert_eq!(unexplained_tail(&harmonics, &flat, &noise), None);
        let mut tail = flat.clone();
        tail[64..].fill(10.0);
        assert_eq!(unexplained_tail(&harmonics, &tail, &noise), Some(65));
        assert_eq!(unexplained_tail(&harmonics, &tail, &vec![5.0; 80]), None);
        let mut middle = flat;
        middle[16..24].fill(10.0);
        assert_eq!(unexplained_tail(&harmonics, &middle, &noise), None);
        assert_eq!(unexplained_tail(&harmonics[..20], &tail[60..], &noise[..20]), None);
    }
}
