//! `tpm excite`: an input that excites a band of frequencies, as a run to be played.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::model;
use crate::output::file;
use std::path::{Path, PathBuf};
use tpm_runtime::frequency::{Excitation, Phases};
use tpm_runtime::report::number;
use tpm_runtime::session::{ExcitationRequest, Identifiable as _};

/// Options of `tpm excite`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// The input that is excited; the model's only one when not given.
    #[arg(long, value_name = "NAME")]
    input: Option<String>,
    /// Time between samples, s.
    #[arg(long, value_name = "SECONDS")]
    sample_time: f64,
    /// Length of the run, s.
    #[arg(long, value_name = "SECONDS")]
    duration: f64,
    /// Largest magnitude of the input: a signal beyond it is refused, and the controller cuts there.
    #[arg(long, value_name = "VALUE")]
    limit: Option<f64>,
    /// Write the samples to this file, and the terms of the run beside it, to the name that ends in .json; `-` prints
    /// the samples alone.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(subcommand)]
    signal: Signal,
}

/// The signal.
#[derive(clap::Subcommand)]
enum Signal {
    /// Gaussian values, each held for a while; the band ends at 1/hold Hz.
    Noise {
        /// Standard deviation, unit of the input.
        #[arg(long, value_name = "VALUE")]
        std: f64,
        /// Time for which each value is held, a multiple of the sample time, s.
        #[arg(long = "hold-time", alias = "hold", value_name = "SECONDS")]
        hold: f64,
        /// Seed of the values.
        #[arg(long, value_name = "N", default_value_t = 1)]
        seed: u64,
    },
    /// Lines of equal amplitude at all multiples of 1/period in a band; repeats after every period.
    Multisine {
        /// Root mean square, unit of the input.
        #[arg(long, value_name = "VALUE")]
        rms: f64,
        /// Lowest frequency, Hz.
        #[arg(long, value_name = "HZ")]
        low: f64,
        /// Highest frequency, Hz.
        #[arg(long, value_name = "HZ")]
        high: f64,
        /// Samples in a period.
        #[arg(long = "period-samples", alias = "period", value_name = "N")]
        period: usize,
        /// Random phases from this seed; Schroeder's, which keep the peak low, when not given.
        #[arg(long, value_name = "N")]
        seed: Option<u64>,
    },
    /// A sine whose frequency rises evenly over the whole run.
    Chirp {
        /// Amplitude, unit of the input.
        #[arg(long, value_name = "VALUE")]
        amplitude: f64,
        /// Frequency at the start, Hz.
        #[arg(long, value_name = "HZ")]
        low: f64,
        /// Frequency at the end, Hz.
        #[arg(long, value_name = "HZ")]
        high: f64,
    },
}

impl Signal {
    const fn excitation(&self) -> Excitation {
        match *self {
            Self::Noise { std, hold, seed } => Excitation::Noise { std, hold, seed },
            Self::Multisine { rms, low, high, period, seed } => {
                let phases = match seed {
                    Some(seed) => Phases::Random { seed },
                    None => Phases::Schroeder,
                };
                Excitation::Multisine { period, low, high, rms, phases }
            }
            Self::Chirp { amplitude, low, high } => Excitation::Chirp { low, high, amplitude },
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let terms = args.output.with_extension("json");
    if terms == args.output {
        let what = format!("-o {}: the terms of the run take the name ending in .json", args.output.display());
        return Err(Failure::Input(format!("{what}; give the samples another")));
    }
    let declared = model(&args.file)?;
    let plant = declared.evaluated();
    let names: Vec<&str> = (0..plant.dims().inputs).map(|i| plant.input(i).name).collect();
    let input = match (&args.input, names.as_slice()) {
        (Some(name), _) => names.iter().position(|other| other == name),
        (None, [_]) => Some(0),
        (None, _) => None,
    };
    let input = input.ok_or_else(|| {
        Failure::Input(format!("--input names the input that is excited; the model has {}", names.join(", ")))
    })?;
    let request = ExcitationRequest {
        excitation: args.signal.excitation(),
        input,
        sample_time: args.sample_time,
        duration: args.duration,
        limit: args.limit.unwrap_or(f64::INFINITY),
    };
    let run = request.run(plant).map_err(|error| Failure::Input(error.to_string()))?;
    if file::named(Some(&args.output)).is_none() {
        file::remark("remark: the terms of the run go beside a file: -o run.csv");
        return file::print_content(&run.samples);
    }
    let text = file::json(&run.terms)?;
    file::write_files(&[(Path::new(&args.output), run.samples.as_bytes()), (&terms, text.as_bytes())])?;
    let segment = match args.signal {
        Signal::Multisine { period, .. } => format!(" --periodic --segment {period}"),
        // Segments of a chirp hold different frequencies.
        Signal::Chirp { .. } => String::from(", and tpm fit with --whole"),
        Signal::Noise { .. } => String::new(),
    };
    file::print(&format!(
        "{} of {}: {} samples every {} s, root mean square {}, largest magnitude {}, crest factor {:.3}\nwrote {} and {}\n\
         its log, with the columns t_s, {} and the coordinates: tpm frf LOG --input {} --measured NAME --hold zoh{segment}\n",
        names[input],
        plant.name(),
        run.samples.lines().count() - 1,
        number(args.sample_time),
        number(run.rms),
        number(run.peak),
        run.crest,
        args.output.display(),
        terms.display(),
        names[input],
        names[input],
    ))
}
