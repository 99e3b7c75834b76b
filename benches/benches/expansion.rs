//! From the model in memory to the finished table.

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tpm_benches::catalogue::by_name;
use tpm_benches::chain::Cube;

fn expansion(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("expansion");
    for name in ["w1", "w2", "w3", "w4:4", "w4:8", "w4:16", "w4:24", "w4:32", "w5b:3", "w5b:5", "w6:2", "w6:4", "w6:8"]
    {
        let Some(workload) = by_name(name) else { continue };
        group.bench_function(name, |bencher| bencher.iter(|| black_box(&workload).expand()));
    }
    for carts in 2..=5 {
        let cube = Cube::new(carts);
        group.bench_function(format!("w5a:{carts}"), |bencher| bencher.iter(|| black_box(&cube).expand()));
    }
    group.finish();
}

criterion_group!(benches, expansion);
criterion_main!(benches);
