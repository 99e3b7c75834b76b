//! A machine of one's own behind the trait `Bench`: whoever can play a trial and record it can be identified.
#![allow(clippy::print_stdout, reason = "an example prints")]

use tpm_runtime::experiment::Experiment;
use tpm_runtime::motion::{Bench, BenchError, Ending, Record, Trial};
use tpm_runtime::session::{self, DeclaredModel};

const MODEL: &str = "model Slider { coordinate x [m]; input u [N]; parameter m [kg], d [N*s/m];
    m*ddot(x) + d*dot(x) = u;
    pattern { amplitude lambda [m]; frequency w [rad/s]; x = rest_to_rest(lambda, w, 3); } }";
const EXPERIMENT: &str = "[control]\nsample_time = 1e-3
feedback = [{ input = 'u', coordinate = 'x', kp = 400.0, kd = 60.0 }]
[schedule]\nmeasure_time = 8.0\nstages = [{ lambda = 0.1, w = 3.0 }, { lambda = 0.3, w = 6.0 }]";

/// Stands for the driver of real hardware: here, 2 kg and 5 N s/m, integrated exactly between samples.
struct Driver;

impl Bench for Driver {
    fn play(&mut self, trial: &Trial) -> Result<Record, BenchError> {
        let (step, pole) = (trial.control.sample_time, (-2.5 * trial.control.sample_time).exp());
        let (mut x, mut v, mut xs, mut us) = (trial.reference[0], trial.reference[1], Vec::new(), Vec::new());
        for n in (0..trial.samples()).map(|n| n % trial.samples_per_period) {
            let (wanted, gain) = (&trial.reference[3 * n..3 * n + 3], &trial.control.gains[0]);
            let u = trial.feed_forward[n] - gain.proportional * (x - wanted[0]) - gain.derivative * (v - wanted[1]);
            xs.push(x);
            us.push(u);
            x += u / 5.0 * step + (v - u / 5.0) * (1.0 - pole) / 2.5;
            v = u / 5.0 + (v - u / 5.0) * pole;
        }
        Ok(Record::new(step, vec![xs], vec![us], Ending::Complete))
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let model = DeclaredModel::parse("slider.tpm", MODEL)?;
    println!("{}", session::on_machine(&model, Experiment::parse(EXPERIMENT)?, &mut Driver)?);
    Ok(())
}
