//! Reads "skip samples periods sample_time", priors, then samples; prints what the estimator of a run finds, in the precision
//! of the argument, double or single.

mod shared;
#[allow(dead_code, unused_imports)]
mod two_carts;

use two_carts::run::{Applied, Estimator, Measured, Parameters, RunSampling, Sample};
use two_carts::support::Real;

fn found<T: Real>(text: &str) {
    let mut lines = text.lines();
    let (shape, prior) = (shared::numbers(lines.next(), 4), shared::numbers(lines.next(), 5));
    let sampling = RunSampling { sample_time: T::from_f64(shape[3]), held: true, delay: T::ZERO };
    let limits = Some(Applied { F: T::from_f64(400.0) });
    let mut estimator = Estimator::new(shape[1] as u32, shape[2] as u32, sampling, limits).expect("a run");
    for line in lines.skip(shape[0] as usize) {
        let row: Vec<f64> = line.split(',').map(|word| word.parse().expect("a number")).collect();
        // A sample that was left out shows in the time.
        let number = (row[0] / shape[3]).round() - shape[0];
        let row: Vec<T> = row.into_iter().map(T::from_f64).collect();
        let measured = Measured { x1: row[1], x2: row[2] };
        let _ = estimator.push(number as u32, &Sample { measured, applied: Applied { F: row[3] } });
        if number + 1.0 >= shape[1] * shape[2] {
            break;
        }
    }
    let prior = Parameters::from_array([prior[0], prior[1], prior[2], prior[3], prior[4]].map(T::from_f64));
    let number = |number: Option<T>| number.map(Real::to_f64);
    match estimator.estimate(&prior) {
        Ok(estimate) => {
            shared::print_found(
                estimate.parameters.into_array().map(number),
                estimate.deviations.into_array().map(number),
                &[estimate.chi_squared.to_f64(), estimate.noise.x1.to_f64()],
            );
        }
        Err(fault) => println!("1 {fault}"),
    }
}

fn main() {
    shared::run(found::<f32>, found::<f64>);
}
