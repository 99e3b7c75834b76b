//! `tpm frf`: the frequency response of a machine from a log.

use crate::failure::{Failure, Outcome};
use crate::input::measured::{EstimatorChoice, Measured, MeasuredArgs};
use crate::output::file;
use clap::ValueEnum;
use tpm_runtime::frequency::ResponseLine;
use tpm_runtime::report::{Align, TextTable, cells, number};

/// Most lines that the text table shows.
const SHOWN: usize = 24;

/// How the response is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// What was averaged, and some lines, for reading.
    Text,
    /// Every line of the band.
    Csv,
    /// Everything (tpm.frf/1).
    Json,
}

/// Options of `tpm frf`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    measured: MeasuredArgs,
    /// How to write the response.
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let measured = Measured::new(&args.measured)?;
    let text = match args.format {
        Format::Text => text(args, &measured),
        Format::Csv => csv(args, &measured),
        Format::Json => json(args, &measured)?,
    };
    measured.plot(&args.measured, &[], None)?;
    file::emit(args.measured.output.as_deref(), &text)?;
    if args.format != Format::Text {
        for gap in measured.response.gaps(measured.low, measured.high) {
            file::remark(&format!("warning: {gap}"));
        }
    }
    Ok(())
}

/// Real part, imaginary part, magnitude and phase (deg) of the chosen estimate at a line.
fn value(args: &Args, line: &ResponseLine) -> [f64; 4] {
    let h = match args.measured.estimator {
        EstimatorChoice::H1 => line.h1,
        EstimatorChoice::H2 => line.h2,
    };
    [h.re, h.im, h.norm(), h.arg().to_degrees()]
}

fn text(args: &Args, measured: &Measured) -> String {
    let mut text = measured.describe(&args.measured);
    let mut table = TextTable::new(&[
        ("frequency [Hz]", Align::Right),
        ("magnitude", Align::Decimal),
        ("phase [deg]", Align::Right),
        ("coherence", Align::Right),
        ("std of H", Align::Decimal),
    ]);
    let usable: Vec<&ResponseLine> =
        measured.response.band(measured.low, measured.high).filter(|line| line.usable).collect();
    let (low, high) = (measured.low.max(usable.first().map_or(0.0, |line| line.hertz())), measured.high);
    let mut last = None;
    for i in 0..SHOWN {
        let wanted = low * (high / low).powf(i as f64 / (SHOWN - 1) as f64);
        let nearest = usable.iter().min_by(|a, b| (a.hertz() - wanted).abs().total_cmp(&(b.hertz() - wanted).abs()));
        if let Some(line) = nearest.filter(|line| last != Some(line.frequency)) {
            last = Some(line.frequency);
            let [_, _, magnitude, phase] = value(args, line);
            let [magnitude, std] = cells(Some(magnitude), Some(line.std));
            table.row(&[number(line.hertz()), magnitude, format!("{phase:.2}"), format!("{:.4}", line.coherence), std]);
        }
    }
    text.push('\n');
    text.push_str(&table.finish());
    for gap in measured.response.gaps(measured.low, measured.high) {
        text.push_str(&format!("warning: {gap}\n"));
    }
    text
}

fn csv(args: &Args, measured: &Measured) -> String {
    let mut text = "frequency_hz,re,im,magnitude,phase_deg,coherence,std,radius_95,usable\n".to_owned();
    for line in measured.response.band(measured.low, measured.high) {
        let [re, im, magnitude, phase] = value(args, line);
        let radius = measured.response.radius(line, 0.95);
        text.push_str(&format!(
            "{},{re},{im},{magnitude},{phase},{},{},{radius},{}\n",
            line.hertz(),
            line.coherence,
            line.std,
            u8::from(line.usable)
        ));
    }
    text
}

fn json(args: &Args, measured: &Measured) -> Result<String, Failure> {
    let response = &measured.response;
    // JSON has no infinity: a value that is not finite becomes null.
    let finite = |value: f64| value.is_finite().then_some(value);
    let lines: Vec<serde_json::Value> = response
        .band(measured.low, measured.high)
        .map(|line| {
            let [re, im, ..] = value(args, line);
            serde_json::json!({
                "frequency_hz": line.hertz(), "re": re, "im": im, "coherence": line.coherence,
                "std": finite(line.std), "radius_95": finite(response.radius(line, 0.95)), "usable": line.usable,
            })
        })
        .collect();
    let effect = response.hold_effect(measured.low, measured.high);
    let gaps: Vec<String> = response.gaps(measured.low, measured.high).iter().map(ToString::to_string).collect();
    let whole = serde_json::json!({
        "schema": "tpm.frf/1",
        "input": args.measured.input, "output": args.measured.measured,
        "estimator": match args.measured.estimator { EstimatorChoice::H1 => "h1", EstimatorChoice::H2 => "h2" },
        "sample_time": response.sample_time, "samples": measured.log.len(),
        "segment": response.welch.segment, "overlap": response.welch.overlap,
        "window": response.welch.window.to_string(), "hold": response.welch.hold.to_string(),
        "segments": response.segments, "averages": response.averages,
        "hold_effect": {"median": effect.median, "largest": effect.largest},
        "lines": lines, "warnings": gaps,
    });
    file::json(&whole)
}
