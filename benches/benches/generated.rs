//! Generated feed-forward plus regressor beside the same by hand, in time.

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tpm_benches::by_hand;
use tpm_models::{closed_loop_arm, mass_spring_drag};

fn slider(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("feed-forward and regressor, Feng 3.24");
    let (motion, theta) = ([0.3, -0.7, 1.1], [2.0, 40.0, 1.5]);
    group.bench_function("by hand", |b| b.iter(|| by_hand::slider(black_box(&motion), black_box(&theta))));
    let motion = mass_spring_drag::Motion::from_array(&motion);
    let theta = mass_spring_drag::Parameters::from_array(theta);
    group.bench_function("generated", |b| {
        b.iter(|| {
            let (motion, theta) = (black_box(&motion), black_box(&theta));
            (mass_spring_drag::feed_forward(motion, theta), mass_spring_drag::regressor(motion))
        });
    });
    group.finish();
}

fn arm(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("feed-forward and regressor, closed-loop arm");
    let (motion, theta, constants) = by_hand::arm_inputs();
    group.bench_function("by hand", |b| {
        b.iter(|| by_hand::arm(black_box(&motion), black_box(&theta), black_box(&constants)));
    });
    let motion = closed_loop_arm::Motion::from_array(&motion);
    let theta = closed_loop_arm::Parameters::from_array(theta);
    let constants = closed_loop_arm::Constants::from_array(constants);
    group.bench_function("generated", |b| {
        b.iter(|| {
            let (motion, theta, constants) = (black_box(&motion), black_box(&theta), black_box(&constants));
            (closed_loop_arm::feed_forward(motion, theta, constants), closed_loop_arm::regressor(motion, constants))
        });
    });
    group.finish();
}

criterion_group!(benches, slider, arm);
criterion_main!(benches);
