//! Jumps of a reading that are the answer of the machine to steps of an input.
//!
//! A current answers a step of the voltage within a sample, as a speed does one of the force on little mass. By itself such an answer
//! looks like the beginning of another recording. The hypothesis that the jumps b_k are answers is
//!
//! ```text
//! b_k = g s_k + e_k ,      s_k the change of the input over the samples beside the jump,
//! ```
//!
//! with one g for all of them. It is kept if g s explains nearly all of the squares of the jumps, which needs several steps of different
//! size or sign: another recording begins once, with an input that has nothing to do with the one before.

/// Fewest jumps that are taken as answers.
const FEWEST_ANSWERS: usize = 4;
/// Largest share of the squares of the jumps that the steps leave unexplained.
const MOST_UNEXPLAINED: f64 = 0.1;
/// Least range of the steps, as a share of the largest: one run written again and again begins with the same step each time.
const LEAST_VARIETY: f64 = 0.5;
/// Samples before a jump in which the step of the input may lie, and samples behind it.
const SAMPLES_BEFORE: usize = 3;
const SAMPLES_BEHIND: usize = 1;

/// The change of an input beside a jump before sample `k`.
fn step(input: &[f64], k: usize) -> f64 {
    input[(k + SAMPLES_BEHIND).min(input.len() - 1)] - input[k.saturating_sub(SAMPLES_BEFORE)]
}

/// The jumps of a reading that no input explains: those of `jumps` (a sample and the jump before it) which are no answers to steps.
pub(super) fn without_answers(jumps: Vec<(usize, f64)>, inputs: &[impl AsRef<[f64]>]) -> Vec<(usize, f64)> {
    let mut left = jumps;
    for input in inputs {
        let steps: Vec<f64> = left.iter().map(|(k, _)| step(input.as_ref(), *k)).collect();
        // Outliers, such as one recording that begins among the answers, are left out of g one by one.
        let mut taken: Vec<usize> = (0..left.len()).filter(|at| steps[*at] != 0.0).collect();
        while taken.len() >= FEWEST_ANSWERS {
            let sum = |f: &dyn Fn(usize) -> f64| taken.iter().map(|at| f(*at)).sum::<f64>();
            let gain = sum(&|at| left[at].1 * steps[at]) / sum(&|at| steps[at] * steps[at]);
            let largest = taken.iter().map(|at| steps[*at].abs()).fold(0.0, f64::max);
            let (low, high) = taken
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), at| (l.min(steps[*at]), h.max(steps[*at])));
            if high - low < LEAST_VARIETY * largest {
                break;
            }
            let rest = |at: usize| left[at].1 - gain * steps[at];
            if sum(&|at| rest(at) * rest(at)) <= MOST_UNEXPLAINED * sum(&|at| left[at].1 * left[at].1) {
                let mut at = 0;
                left.retain(|_| {
                    at += 1;
                    !taken.contains(&(at - 1))
                });
                break;
            }
            let worst = taken.iter().copied().max_by(|a, b| rest(*a).abs().total_cmp(&rest(*b).abs()));
            // Most jumps must be answers: with few of many any gain is found.
            if 4 * (taken.len() - 1) < 3 * left.len() {
                break;
            }
            taken.retain(|at| Some(*at) != worst);
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::without_answers;

    #[test]
    fn answers_to_steps_are_told_from_other_recordings() {
        let levels = [0.0, 6.0, -3.0, 4.5, 1.0, -6.0, 2.0, 5.0, -1.0, 3.0];
        let input: Vec<f64> = (0..1_000).map(|k: usize| levels[k / 100]).collect();
        // The answer begins one sample behind the step, and scatters.
        let answer = |n: usize| (100 * n + 1, 0.4 * (levels[n] - levels[n - 1]) * (1.0 + 0.1 * (n as f64).sin()));
        let answers: Vec<(usize, f64)> = (1..10).map(answer).collect();
        assert_eq!(without_answers(answers.clone(), std::slice::from_ref(&input)), []);
        // Another recording in the middle of a level, one at a step, and few jumps.
        let mut with_join = answers.clone();
        with_join.insert(3, (350, 9.0));
        assert_eq!(without_answers(with_join, std::slice::from_ref(&input)), [(350, 9.0)]);
        let mut at_step = answers.clone();
        at_step[4].1 *= -4.0;
        assert_eq!(without_answers(at_step.clone(), std::slice::from_ref(&input)), [at_step[4]]);
        let few = answers[..3].to_vec();
        assert_eq!(without_answers(few.clone(), std::slice::from_ref(&input)), few);
        // A record that repeats one run: its jumps lie where the run begins again.
        let again: Vec<(usize, f64)> = (1..10).map(|n| (100 * n, 2.0)).collect();
        let saw: Vec<f64> = (0..1_000).map(|k| f64::from(k % 100)).collect();
        assert_eq!(without_answers(again.clone(), &[saw]), again);
        // Jumps of either sign that have nothing to do with the steps.
        let other: Vec<(usize, f64)> = (1..10).map(|n| (100 * n, if n % 2 == 0 { 2.0 } else { -2.0 })).collect();
        let slow: Vec<f64> = (0..1_000).map(|k| (0.002 * f64::from(k)).sin()).collect();
        assert_eq!(without_answers(other.clone(), &[slow]), other);
    }
}
