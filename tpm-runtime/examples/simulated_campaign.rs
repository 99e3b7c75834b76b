//! A whole identification on a simulated machine: slow and small first, then faster and larger.
#![allow(clippy::print_stdout, reason = "an example prints")]

use tpm_runtime::experiment::Experiment;
use tpm_runtime::session;

tpm_runtime::model! {
    model Slider {
        coordinate x [m];
        input u [N];
        parameter m [kg], d [N*s/m], k [N/m];
        m*ddot(x) + d*dot(x) + k*x = u;

        pattern {
            amplitude lambda [m];
            frequency w [rad/s];
            x = rest_to_rest(lambda, w, 3);
        }
    }
}

const EXPERIMENT: &str = r#"
[plant]
parameters = { m = 2.0, d = 5.0, k = 40.0 }
sensors.x = { noise = 1e-4 }
[control]
sample_time = 1e-3
derivative_filter = 5e-3
feedback = [{ input = "u", coordinate = "x", kp = 400.0, kd = 60.0 }]
[schedule]
measure_time = 8.0
stages = [{ lambda = 0.1, w = 3.0 }, { lambda = 0.3, w = 6.0 }]
"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let result = session::on_simulated_plant(&Slider, Experiment::parse(EXPERIMENT)?)?;
    println!("{result}");
    Ok(())
}
