//! `tpm convert`: a log in another format.

use crate::failure::{Failure, Outcome};
use crate::input::choice::one_of;
use crate::input::log::ColumnArgs;
use crate::output::{file, writable};
use clap::builder::TypedValueParser;
use std::path::{Path, PathBuf};
use tpm_runtime::log::{Track, TrackFormat};
use tpm_runtime::session::SessionError;

/// What stands above the options in the help.
const BEGINNING: &str = "Write a log in another format: `tpm convert run.mat --to csv`.\n\n\
    Reads every format that `tpm identify` reads, and writes all its columns of numbers row by row: readings and units as they are, missing \
    ones as missing ones, the time in seconds as t_s. What was assumed and what is left out, such as columns of text, is said.";

/// What stands below the options in the help.
const ENDING: &str = "MCAP holds the rows as messages of joint states (sensor_msgs/msg/JointState, topic /log), which PlotJuggler, Foxglove \
    and Rerun plot: every column is a joint, and its readings are the positions. A message has the columns that were read at its stamp, so that each keeps \
    its own times, where CSV and Parquet have empty fields. Its stamps are whole nanoseconds.\n\
    Exit codes: 0 written, 2 bad input, of which nothing is written.";

/// Options of `tpm convert`.
#[derive(clap::Args)]
#[command(long_about = BEGINNING, after_help = ENDING)]
pub(crate) struct Args {
    /// The log, in any format that is read.
    log: PathBuf,
    /// The format to write. MCAP and Parquet are features of the build.
    #[arg(long, value_parser = format())]
    to: TrackFormat,
    /// The file to write, which must not be there yet; the log's name with the ending of the format when not given.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    columns: ColumnArgs,
}

/// A format that is written, by the ending of its files.
fn format() -> impl TypedValueParser<Value = TrackFormat> {
    one_of([
        (TrackFormat::Csv, "csv", "Text in columns"),
        (TrackFormat::Mcap, "mcap", "A recording of ROS 2"),
        (TrackFormat::Parquet, "parquet", "A table of data frames"),
    ])
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let output =
        args.output.clone().unwrap_or_else(|| args.log.with_extension(args.to.to_string().to_ascii_lowercase()));
    writable(Some(&output), None)?;
    let named = file::named(Some(&output));
    if named.is_some_and(Path::exists) && !named.is_some_and(tpm_runtime::report::is_special) {
        return Err(Failure::Input(format!(
            "{} is there already; type another name (-o), or remove the file first",
            output.display()
        )));
    }
    let request = args.columns.request(&args.log)?;
    let (track, said) = Track::of_log(&args.log, &request.reading.columns).map_err(SessionError::from)?;
    let bytes = track.written(args.to).map_err(SessionError::from)?;
    match named {
        Some(path) => file::write_file(path, &bytes)?,
        None if args.to == TrackFormat::Csv => file::print_content(&String::from_utf8_lossy(&bytes))?,
        None => {
            return Err(Failure::Input(format!("{} is no text for a terminal; name a file (-o)", args.to)));
        }
    }
    said.iter().for_each(|remark| file::remark(&format!("remark: {remark}")));
    let (rows, columns) = (track.time.len(), track.signals.len());
    if named.is_some() {
        file::remark(&format!("{}: {rows} rows, time and {columns} columns", output.display()));
    }
    Ok(())
}
