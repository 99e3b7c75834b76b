//! The parameters of a slider, from a log of its motion.
#![allow(clippy::print_stdout, reason = "an example prints")]

use std::fmt::Write as _;
use tpm_runtime::session::{self, DeclaredModel, LogRequest};

const MODEL: &str = "
model Slider {
    coordinate x [m];
    input u [N];
    parameter m [kg], d [N*s/m], k [N/m];

    m*ddot(x) + d*dot(x) + k*x = u;
}";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A model of your own stands in a file: DeclaredModel::open("slider.tpm").
    let model = DeclaredModel::parse("slider.tpm", MODEL)?;
    let file = std::env::temp_dir().join(format!("slider-{}.csv", std::process::id()));
    std::fs::write(&file, recorded()?)?;
    let result = session::from_log(&model, LogRequest::new(&file).map("x", "position"))?;
    std::fs::remove_file(&file)?;
    println!("{result}");
    Ok(())
}

/// What a controller would have written down of a slider of 2 kg, 5 N s/m and 40 N/m, over five periods.
fn recorded() -> Result<String, std::fmt::Error> {
    let mut text = String::from("t_s,position,u\n");
    for n in 0..5000 {
        let t = f64::from(n) * 1e-3;
        let (s1, c1) = (2.0 * std::f64::consts::PI * t).sin_cos();
        let (s3, c3) = (6.0 * std::f64::consts::PI * t).sin_cos();
        let w = 2.0 * std::f64::consts::PI;
        let (x, v, a) = (0.2 * c1 - 0.02 * c3, w * (0.06 * s3 - 0.2 * s1), w * w * (0.18 * c3 - 0.2 * c1));
        writeln!(text, "{t},{x},{}", 2.0 * a + 5.0 * v + 40.0 * x)?;
    }
    Ok(text)
}
