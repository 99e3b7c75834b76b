//! `tpm feedforward`: the common and the split feed-forward side by side, on the simulated machine, with filters and motors.

use crate::failure::{Failure, Outcome};
use crate::output::{file, picture};
use crate::verbs::actuator::{MachineArgs, Moved, Use};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;
use tpm_runtime::model::Model as _;
use tpm_runtime::motion::trajectory::Trajectory;
use tpm_runtime::plant::actuator::{
    Drive, DriveError, FileFault, Limit, LoopFile, LoopPoles, Motor, Tracking, tracking_errors,
};
use tpm_runtime::report::{Align, TextTable, number};

/// Number of configurations along the reference at which the loop is linearised.
const CONFIGURATIONS: usize = 16;

/// Options of `tpm feedforward`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    machine: MachineArgs,
    /// The loop file: feedback and filters.
    #[arg(long = "loop", value_name = "FILE")]
    control: PathBuf,
    /// A motor file; forces are exact and unlimited where no motor is given.
    #[arg(long, value_name = "FILE")]
    motor: Option<PathBuf>,
    /// Draw the tracking errors of both schemes into this file, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON (tpm.feedforward/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Names of the schemes, the common one first, and whether the scheme splits the feed-forward.
const SCHEMES: [(&str, bool); 2] = [("common", false), ("split", true)];

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(path) = &args.plot {
        picture::Picture::of(path)?;
    }
    // The simulated machine leaves its reference.
    let moved = args.machine.moved(Use::AnyMotion)?;
    let motors = args.motor.as_deref().map_or_else(|| Ok(Vec::new()), |path| moved.motors(path))?;
    let text = tpm_runtime::report::read_text(&args.control).map_err(|error| Failure::read(&args.control, error))?;
    let at = |fault: FileFault| Failure::Input(format!("{}: {fault}", args.control.display()));
    let file = LoopFile::parse(&text).map_err(at)?;
    let settle = file.settle_periods().map_err(at)?;
    let changed = file.plant().map_err(at)?;
    let plant =
        moved.with_parameters(changed.into_iter()).map_err(|(name, message)| at(file.refuse_plant(&name, message)))?;
    let trajectory = moved.machine.trajectory(&moved.amplitudes, moved.frequency);
    let demand = moved.machine.demand();
    let mut found = Vec::with_capacity(SCHEMES.len());
    for (name, split) in SCHEMES {
        let scheme = file.scheme(moved.machine.model(), split).map_err(at)?;
        let drive = Drive::new(&demand, &plant, &motors, &scheme);
        let failed = |error: DriveError| Failure::Input(format!("the {name} scheme: {error}"));
        let poles = drive.stability(&trajectory, CONFIGURATIONS).map_err(failed)?;
        if poles.unstable() {
            return Err(Failure::Input(unstable(&moved, &trajectory, name, &poles)));
        }
        let tracking = drive.track(&trajectory, settle, &poles).map_err(failed)?;
        found.push((name, poles, tracking));
    }
    let [(_, _, common), (_, _, split)] = found.as_slice() else { unreachable!("invariant: there are two schemes") };
    if let Some(path) = &args.plot {
        let title = format!("{}: {}", moved.model.name, moved.motion());
        picture::draw(path, &tracking_errors(&title, common, split, &coordinates(&moved)))?;
    }
    let text =
        if args.json { file::json(&as_json(&moved, &found, &motors))? } else { as_text(&moved, &found, &motors) };
    file::emit(args.output.as_deref(), &text)
}

/// Names of the coordinates with their units.
fn coordinates(moved: &Moved) -> Vec<String> {
    let model = moved.machine.model();
    (0..model.dims().coordinates).map(|c| model.coordinate(c).to_string()).collect()
}

fn unstable(moved: &Moved, trajectory: &Trajectory, name: &str, found: &LoopPoles) -> String {
    let model = moved.machine.model();
    let mut motion = vec![0.0; model.dims().coordinates];
    trajectory.motion(found.phase, &mut motion);
    let place: Vec<String> = motion
        .iter()
        .enumerate()
        .map(|(c, value)| {
            // Cosines of quarter turns leave rounding errors, which are printed as zero.
            let value = if value.abs() < 1e-12 { 0.0 } else { *value };
            format!("{} = {}", model.coordinate(c).name, number(value))
        })
        .collect();
    let poles: Vec<String> = found
        .poles
        .iter()
        .take_while(|pole| pole.re > 0.0)
        .filter(|pole| pole.im >= 0.0)
        .map(|pole| match pole.im {
            0.0 => number(pole.re),
            _ => format!("{} +- {}j", number(pole.re), number(pole.im)),
        })
        .collect();
    format!(
        "the {name} scheme is unstable, so nothing was run: linearised at rest in {} the loop has poles at {} rad/s; lower the gains, raise the filter's frequency, or leave the feedback unfiltered",
        place.join(", "),
        poles.join(", ")
    )
}

fn as_text(moved: &Moved, found: &[(&str, LoopPoles, Tracking)], motors: &[Option<Motor>]) -> String {
    let mut text = format!("{}: {}\n\n", moved.model.name, moved.motion());
    let mut table = TextTable::new(&[
        ("error of", Align::Left),
        ("common rms", Align::Right),
        ("split rms", Align::Right),
        ("ratio", Align::Right),
        ("common peak", Align::Right),
        ("split peak", Align::Right),
        ("ratio", Align::Right),
    ]);
    let (common, split) = (&found[0].2, &found[1].2);
    for (c, name) in coordinates(moved).into_iter().enumerate() {
        table.row(&[
            name,
            number(common.rms[c]),
            number(split.rms[c]),
            number(common.rms[c] / split.rms[c]),
            number(common.peak[c]),
            number(split.peak[c]),
            number(common.peak[c] / split.peak[c]),
        ]);
    }
    text.push_str(&table.finish());
    let mut rates = TextTable::new(&[
        ("error of the velocity of", Align::Left),
        ("common rms", Align::Right),
        ("split rms", Align::Right),
        ("ratio", Align::Right),
        ("common peak", Align::Right),
        ("split peak", Align::Right),
        ("ratio", Align::Right),
    ]);
    let names: Vec<String> =
        (0..common.rms.len()).map(|c| moved.machine.model().coordinate(c).name.to_owned()).collect();
    for (c, name) in names.iter().enumerate() {
        rates.row(&[
            name.clone(),
            number(common.rate_rms[c]),
            number(split.rate_rms[c]),
            number(common.rate_rms[c] / split.rate_rms[c]),
            number(common.rate_peak[c]),
            number(split.rate_peak[c]),
            number(common.rate_peak[c] / split.rate_peak[c]),
        ]);
    }
    let _ = write!(text, "\n{}", rates.finish());
    for (what, first, second) in
        [("position", &common.rms, &split.rms), ("velocity", &common.rate_rms, &split.rate_rms)]
    {
        for ((name, first), second) in names.iter().zip(first).zip(second).filter(|((_, first), second)| second > first)
        {
            let _ = writeln!(
                text,
                "\nthe split feed-forward makes the error of the {what} of {name} larger, {} times as large (rms); Feng, section 6.3, expects that it makes errors of position and velocity smaller",
                number(second / first)
            );
        }
    }
    if motors.iter().any(Option::is_some) {
        text.push_str("\nlimits active, % of the time\n\n");
        let mut table = TextTable::new(&[
            ("motor of", Align::Left),
            ("limit", Align::Left),
            ("common", Align::Right),
            ("split", Align::Right),
        ]);
        for (i, _) in motors.iter().enumerate().filter(|(_, motor)| motor.is_some()) {
            for (k, limit) in [Limit::Current, Limit::Voltage, Limit::Power].into_iter().enumerate() {
                table.row(&[
                    moved.input(i).to_owned(),
                    limit.name_and_unit().0.to_owned(),
                    number(100.0 * common.limited[i][k]),
                    number(100.0 * split.limited[i][k]),
                ]);
            }
        }
        text.push_str(&table.finish());
    }
    for (name, poles, _) in found {
        if let Some(pole) = poles.poles.first() {
            let _ = writeln!(
                text,
                "{}slowest pole of the {name} loop along the reference {} rad/s",
                if *name == found[0].0 { "\n" } else { "" },
                if pole.im == 0.0 {
                    number(pole.re)
                } else {
                    format!("{} +- {}j", number(pole.re), number(pole.im.abs()))
                }
            );
        }
    }
    text
}

fn as_json(moved: &Moved, found: &[(&str, LoopPoles, Tracking)], motors: &[Option<Motor>]) -> Value {
    let model = moved.machine.model();
    let schemes: serde_json::Map<String, Value> = found
        .iter()
        .map(|(name, poles, tracking)| {
            let errors: serde_json::Map<String, Value> = (0..model.dims().coordinates)
                .map(|c| {
                    let value = json!({
                        "rms": tracking.rms[c], "peak": tracking.peak[c],
                        "rate_rms": tracking.rate_rms[c], "rate_peak": tracking.rate_peak[c],
                    });
                    (model.coordinate(c).name.to_owned(), value)
                })
                .collect();
            let limited: serde_json::Map<String, Value> = motors
                .iter()
                .enumerate()
                .filter(|(_, motor)| motor.is_some())
                .map(|(i, _)| {
                    let [current, voltage, power] = tracking.limited[i];
                    let value = json!({"current": current, "voltage": voltage, "power": power});
                    (moved.input(i).to_owned(), value)
                })
                .collect();
            let poles: Vec<Value> = poles.poles.iter().map(|pole| json!([pole.re, pole.im])).collect();
            ((*name).to_owned(), json!({"errors": errors, "limited": limited, "poles": poles}))
        })
        .collect();
    json!({"schema": "tpm.feedforward/1", "model": moved.model.name, "schemes": schemes})
}
