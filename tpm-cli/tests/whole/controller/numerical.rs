//! Reads "skip samples periods sample_time rows" and the parameters of the first run's feed-forward, then for every run by how much its own
//! are larger and so many samples with their reference; prints what follows from the differences of the runs, in the precision of the
//! argument, double or single.

mod shared;
#[allow(dead_code, unused_imports)]
mod two_carts;

use two_carts::run::{Applied, Estimator, Measured, Numerical, Parameters, Reference, RunFault, RunSampling, Sample};
use two_carts::support::Real;

fn found<T: Real>(text: &str) {
    let mut lines = text.lines();
    let (shape, prior) = (shared::numbers(lines.next(), 5), shared::numbers(lines.next(), 5));
    let sampling = RunSampling { sample_time: T::from_f64(shape[3]), held: true, delay: T::ZERO };
    let mut estimator = Estimator::new(shape[1] as u32, shape[2] as u32, sampling, None).expect("a run");
    let mut numerical = Numerical::default();
    while let Some(line) = lines.next() {
        let steps = shared::numbers(Some(line), 5);
        let mut reference = Reference::new(shape[1] as u32).expect("a period");
        estimator.begin(shape[1] as u32, shape[2] as u32).expect("a run");
        for number in 0..shape[4] as u32 {
            let line = lines.next().expect("a sample");
            let Some(number) = number.checked_sub(shape[0] as u32) else { continue };
            let row: Vec<T> = line.split(',').map(|word| T::from_f64(word.parse().expect("a number"))).collect();
            let _ = reference.push(number, &Measured { x1: row[4], x2: row[5] });
            let measured = Measured { x1: row[1], x2: row[2] };
            let _ = estimator.push(number, &Sample { measured, applied: Applied { F: row[3] } });
        }
        let changed = steps.iter().position(|step| step.abs() > 0.0);
        let taken = match changed {
            None => numerical.begin(&estimator, &reference),
            Some(place) => numerical.change(place, T::from_f64(steps[place]), &estimator, &reference),
        };
        taken.expect("a run");
        let beyond = numerical.change(5, T::ONE, &estimator, &reference);
        assert_eq!(beyond, Err(RunFault::Perturbation), "there is no sixth parameter");
    }
    let prior = Parameters::from_array([prior[0], prior[1], prior[2], prior[3], prior[4]].map(T::from_f64));
    let number = |number: Option<T>| number.map(Real::to_f64);
    match numerical.estimate(&prior) {
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
