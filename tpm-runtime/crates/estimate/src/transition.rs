//! From one instant of a record to the next: which states a model has, how finely it is integrated, and where its force is unsure.

use crate::time_domain::LEAST_ARGUMENT;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{EvalError, Model};
use tpm_numerics::{Doubling, root_mean_square};

/// Shortest time between two stops of a machine, as a share of the time in which its motion goes to and fro.
pub(crate) const SHORTEST_PASSAGE: f64 = 0.02;
/// Transitions that one task linearises.
pub(crate) const TRANSITIONS_PER_TASK: usize = 256;
/// How much larger than friction's impulse the unknown force of a machine at rest may be.
const REST_FORCE_RATIO: f64 = 5.0;
/// How much of the force is unsure in the transitions beside one in which a sign jumps, as multiples of half the jump. The jump lies
/// anywhere within its transition, which moves the position by up to an eighth of what it would move in a transition with the whole jump.
const UNSURE_BESIDE_JUMP: [f64; 2] = [0.25, 0.0];
/// What is added where an input that jumps with the sign is interpolated: the mean errors of the polynomial through six samples of a
/// step.
const UNSURE_BY_INTERPOLATION: [f64; 2] = [0.114, 0.016];
/// Steps of integration from one instant to the next: doubled until the error is a small share of what a state changes in the record's
/// typical transition.
const INTEGRATION: Doubling = Doubling { least: 1, most: 16, settled: 1e-9 };
/// The same where a sign jumps within a step.
const INTEGRATION_OF_JUMPS: Doubling = Doubling { settled: 1e-3, ..INTEGRATION };
/// Transitions on which the number of steps is decided.
const TRANSITIONS_TRIED: usize = 64;

/// The states of a model, coordinate by coordinate, as coordinate and order; nothing where a coordinate has no derivative in the rows, or
/// the rows do not determine the motion.
pub(crate) fn states(model: &dyn Model<f64>) -> Option<Vec<(usize, usize)>> {
    let dims = model.dims();
    let orders: Vec<usize> = (0..dims.coordinates).map(|c| model.coordinate_order(c)).collect();
    let usable = dims.rows == dims.coordinates && orders.iter().all(|&order| order > 0);
    usable.then(|| orders.iter().enumerate().flat_map(|(c, &order)| (0..order).map(move |d| (c, d))).collect())
}

/// How many steps from one instant to the next leave no error of the integration that matters. `advance` puts the state that so many steps
/// reach from the begin of a transition into its last argument; `state` is the state at that begin, `switches` whether signs jump.
///
/// # Errors
/// [`EvalError`] when the model cannot be evaluated.
pub(crate) fn needed_steps<'t>(
    transitions: &[usize],
    switches: bool,
    state: impl Fn(usize) -> &'t [f64],
    mut advance: impl FnMut(usize, usize, &mut [f64]) -> Result<(), EvalError>,
) -> Result<usize, EvalError> {
    // A step across the jump of a sign is wrong by its nature and has a noise of its own, which the mean bears.
    let integration = if switches { INTEGRATION_OF_JUMPS } else { INTEGRATION };
    let stride = (transitions.len() / TRANSITIONS_TRIED).max(1);
    let n = transitions.first().map_or(0, |&first| state(first).len());
    let (mut coarse, mut fine) = (vec![0.0; n], vec![0.0; n]);
    let mut steps = integration.least;
    while steps < integration.most {
        let (mut moved, mut wrong) = (vec![0.0; n], vec![0.0; n]);
        for &k in transitions.iter().step_by(stride) {
            advance(k, steps, &mut coarse)?;
            advance(k, 2 * steps, &mut fine)?;
            for (i, from) in state(k).iter().enumerate() {
                moved[i] += (fine[i] - from).abs();
                wrong[i] += (fine[i] - coarse[i]).abs();
            }
        }
        if moved.iter().zip(&wrong).all(|(moved, wrong)| *wrong <= integration.settled * moved) {
            break;
        }
        steps *= 2;
    }
    Ok(steps)
}

/// `P = h + J h^2/2 + J^2 h^3/6 + J^3 h^4/24` into `power`, for the `n` by `n` matrix J of the rates of the states by the states: a step of
/// length `h` has the transition `1 + J P`, and forcings with rates g move the state by `P g`.
pub(crate) fn integral(jacobian: &[f64], n: usize, h: f64, power: &mut Vec<f64>, product: &mut Vec<f64>) {
    power.clear();
    power.resize(n * n, 0.0);
    (0..n).for_each(|s| power[s * n + s] = h);
    for order in (2..=4).rev() {
        product.clear();
        product.resize(n * n, 0.0);
        multiply(jacobian, power, n, n, product);
        for (i, (to, value)) in power.iter_mut().zip(&*product).enumerate() {
            *to = value * h / order as f64 + if i % (n + 1) == 0 { h } else { 0.0 };
        }
    }
}

/// How loose every switch's force is in every transition, as a multiple of half its jump, from the `arguments` of all switches at every
/// instant. `shortest_passage` is the least number of instants between two stops.
///
/// While a machine is at rest for L transitions its friction is unknown but the same for all of them; independent forces have its
/// impulse when their variance is L times as large. What is assumed there is wrong in the same way at every stop, so that the forces are
/// given [`REST_FORCE_RATIO`] times that size.
pub(crate) fn loose(arguments: &[f64], switches: usize, shortest_passage: usize, hold: Hold) -> Vec<f64> {
    let instants = arguments.len().checked_div(switches).unwrap_or(0);
    let transitions = instants.saturating_sub(1);
    let mut loose = vec![0.0; transitions * switches];
    for s in 0..switches {
        let of = |k: usize| arguments[k * switches + s];
        let band = LEAST_ARGUMENT * root_mean_square((0..instants).map(of));
        let unsure = |k: usize| slow(of(k), of(k + 1), band);
        // While it is at rest a machine's velocity is noise, which may stand above the band for some instants.
        let mut free: Vec<bool> = (0..transitions).map(unsure).collect();
        let mut last: Option<usize> = None;
        for k in 0..transitions {
            if free[k] {
                if let Some(before) = last.filter(|before| k - before <= shortest_passage) {
                    free[before..k].fill(true);
                }
                last = Some(k);
            }
        }
        let mut k = 0;
        while k < transitions {
            let first = k;
            while k < transitions && free[k] {
                k += 1;
            }
            let size = REST_FORCE_RATIO * ((k - first) as f64).sqrt();
            for transition in first..k {
                loose[transition * switches + s] = size;
            }
            if k > first {
                for (distance, share) in unsure_beside(hold).into_iter().enumerate() {
                    for at in [first.checked_sub(distance + 1), Some(k + distance)].into_iter().flatten() {
                        if let Some(at) = loose.get_mut(at * switches + s) {
                            *at = at.max(REST_FORCE_RATIO * share);
                        }
                    }
                }
            }
            k += 1;
        }
    }
    loose
}

/// How much of the force is unsure one and two transitions beside one in which a sign jumps.
fn unsure_beside(hold: Hold) -> [f64; 2] {
    match hold {
        Hold::Zoh => UNSURE_BESIDE_JUMP,
        Hold::None => {
            [UNSURE_BESIDE_JUMP[0] + UNSURE_BY_INTERPOLATION[0], UNSURE_BESIDE_JUMP[1] + UNSURE_BY_INTERPOLATION[1]]
        }
    }
}

/// Whether a signal is within a band or crosses zero between two instants.
pub(crate) fn slow(before: f64, after: f64, band: f64) -> bool {
    before.abs() < band || after.abs() < band || (before > 0.0) != (after > 0.0)
}

/// `out += a b` for row-major matrices, a n by n and b n by `width`.
pub(crate) fn multiply(a: &[f64], b: &[f64], n: usize, width: usize, out: &mut [f64]) {
    for i in 0..n {
        for j in 0..n {
            let factor = a[i * n + j];
            if factor.abs() > 0.0 {
                for (to, value) in out[i * width..(i + 1) * width].iter_mut().zip(&b[j * width..(j + 1) * width]) {
                    *to += factor * value;
                }
            }
        }
    }
}
