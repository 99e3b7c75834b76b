//! Reads "skip samples periods sample_time", the priors of M, m and L, then samples; prints the physical parameters that follow from a run
//! of the cart-pendulum with their deviations, in the precision of the argument, double or single.

#[allow(dead_code, unused_imports)]
mod cart_pendulum;

use cart_pendulum::run::{Applied, Estimator, Measured, Parameters, Physical, RunSampling, Sample};
use cart_pendulum::support::Real;
use std::io::Read;

fn found<T: Real>(text: &str) {
    let mut lines = text.lines();
    let mut numbers = |count: usize| -> Vec<f64> {
        let line = lines.next().unwrap_or_default();
        let numbers = line.split_whitespace().map(|word| word.parse().expect("a number")).collect::<Vec<f64>>();
        assert_eq!(numbers.len(), count);
        numbers
    };
    let (shape, prior) = (numbers(4), numbers(3));
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
    match estimator.estimate(&lumped).and_then(|estimate| estimate.physical(&physical)) {
        Ok(estimate) => {
            println!("0");
            let values = estimate.parameters.into_array().into_iter().zip(estimate.deviations.into_array());
            values.for_each(|(value, deviation)| {
                let of = |number: Option<T>| number.map_or(f64::NAN, Real::to_f64);
                println!("{:?}\n{:?}", of(value), of(deviation));
            });
            println!("{:?}", estimate.chi_squared.to_f64());
        }
        Err(fault) => println!("1 {fault}"),
    }
}

fn main() {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text).expect("readable");
    match std::env::args().nth(1).as_deref() {
        Some("single") => found::<f32>(&text),
        _ => found::<f64>(&text),
    }
}
