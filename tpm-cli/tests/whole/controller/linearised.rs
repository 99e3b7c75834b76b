//! Reads "skip samples periods sample_time", the parameters of the feed-forward, then samples with their reference; prints what the
//! estimator that the second argument names (error or hill) finds, in the precision of the first one, double or single.

mod shared;
#[allow(dead_code, unused_imports)]
mod two_carts;

use two_carts::run::{Applied, Estimator, Measured, Parameters, Reference, RunLinearisation, RunSampling, Sample};
use two_carts::support::Real;

fn found<T: Real>(text: &str, which: RunLinearisation) {
    let mut lines = text.lines();
    let (shape, prior) = (shared::numbers(lines.next(), 4), shared::numbers(lines.next(), 5));
    let sampling = RunSampling { sample_time: T::from_f64(shape[3]), held: true, delay: T::ZERO };
    let mut estimator = Estimator::new(shape[1] as u32, shape[2] as u32, sampling, None).expect("a run");
    let mut reference = Reference::new(shape[1] as u32).expect("a period");
    for (number, line) in lines.skip(shape[0] as usize).enumerate() {
        let row: Vec<T> = line.split(',').map(|word| T::from_f64(word.parse().expect("a number"))).collect();
        let _ = reference.push(number as u32, &Measured { x1: row[4], x2: row[5] });
        let measured = Measured { x1: row[1], x2: row[2] };
        let _ = estimator.push(number as u32, &Sample { measured, applied: Applied { F: row[3] } });
    }
    let prior = Parameters::from_array([prior[0], prior[1], prior[2], prior[3], prior[4]].map(T::from_f64));
    let number = |number: Option<T>| number.map(Real::to_f64);
    match estimator.estimate_about(which, &reference, &prior) {
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
    let which = match std::env::args().nth(2).as_deref() {
        Some("error") => RunLinearisation::Error,
        _ => RunLinearisation::Hill,
    };
    shared::run(|text| found::<f32>(text, which), |text| found::<f64>(text, which));
}
