//! Reads "skip samples periods sample_time", the priors of M, m and L, then samples; prints the physical parameters that follow from a run
//! of the cart-pendulum with their deviations, in the precision of the argument, double or single.

mod shared;
#[allow(dead_code, unused_imports)]
mod cart_pendulum;

use cart_pendulum::run::{Applied, Estimator, Measured, Parameters, Physical, RunSampling, Sample};
use cart_pendulum::support::Real;

fn found<T: Real>(text: &str) {
    let mut lines = text.lines();
    let (shape, prior) = (shared::numbers(lines.next(), 4), shared::numbers(lines.next(), 3));
    let sampling = RunSampling { sample_time: T::from_f64(shape[3]), held: true, delay: T::ZERO };
    let mut estimator = Estimator::new(shape[1] as u32, shape[2] as u32, sampling, None).expect("a run");
    for (number, line) in lines.skip(shape[0] as usize).enumerate() {
        let row: Vec<T> = line.split(',').map(|word| T::from_f64(word.parse().expect("a number"))).collect();
        let (measured, applied) = (Measured { x: row[1], theta: row[2] }, Applied { F: row[3], tau: row[4] });
        let _ = estimator.push(number as u32, &Sample { measured, applied });
    }
    let [mass, bob, length] = [prior[0], prior[1], prior[2]].map(T::from_f64);
    let lumped = Parameters::from_array([mass + bob, bob * length, bob * length * length]);
    let physical = Physical { M: mass, m: bob, L: length };
    let number = |number: Option<T>| number.map(Real::to_f64);
    match estimator.estimate(&lumped).and_then(|estimate| estimate.physical(&physical)) {
        Ok(estimate) => {
            shared::print_found(
                estimate.parameters.into_array().map(number),
                estimate.deviations.into_array().map(number),
                &[estimate.chi_squared.to_f64()],
            );
        }
        Err(fault) => println!("1 {fault}"),
    }
}

fn main() {
    shared::run(found::<f32>, found::<f64>);
}
