//! The common and the split feed-forward of a machine side by side, on the simulated machine, with filters and motors.

use crate::by_name::by_name;
use crate::motors::moved::MovedMachine;
use serde::{Serialize, Serializer};
use std::fmt;
use thiserror::Error;
use tpm_controller::model::Model as _;
use tpm_frequency::Complex;
use tpm_motion::trajectory::Trajectory;
use tpm_plant::actuator::{Drive, DriveError, Limit, LoopPoles, Motor, Scheme, Tracking, tracking_errors};
use tpm_plot::Figure;
use tpm_report::{Align, TextTable, number};

/// Number of configurations along the reference at which the loop is linearised.
const CONFIGURATIONS: usize = 16;

/// Names of the schemes.
const NAMES: [&str; 2] = ["common", "split"];

/// A coordinate of less than this is what rounding leaves of zero: cosines of quarter turns.
const ROUNDING: f64 = 1e-12;

/// Tracking errors of the common and the split feed-forward. They are displayed as a text, and serialised as `tpm.feedforward/1`.
#[derive(Debug, Serialize)]
pub struct FeedForwards {
    schema: &'static str,
    model: String,
    #[serde(serialize_with = "by_name")]
    schemes: Vec<(&'static str, Followed)>,
    /// The motion in words.
    #[serde(skip)]
    motion: String,
    /// Names of the coordinates with their units.
    #[serde(skip)]
    coordinates: Vec<String>,
    #[serde(skip)]
    figure: Figure,
}

/// How one scheme follows the reference.
#[derive(Debug, Serialize)]
struct Followed {
    #[serde(serialize_with = "by_name")]
    errors: Vec<(String, Errors)>,
    /// Inputs with a motor, and the shares of the time in which a limit of it is active.
    #[serde(serialize_with = "by_name")]
    limited: Vec<(String, Limited)>,
    #[serde(serialize_with = "pairs")]
    poles: Vec<Complex>,
}

fn pairs<S: Serializer>(poles: &[Complex], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(poles.iter().map(|pole| [pole.re, pole.im]))
}

/// Errors of a coordinate and its rate.
#[derive(Debug, Serialize)]
struct Errors {
    rms: f64,
    peak: f64,
    rate_rms: f64,
    rate_peak: f64,
}

#[derive(Debug, Serialize)]
struct Limited {
    current: f64,
    voltage: f64,
    power: f64,
}

/// Why the schemes cannot be compared.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum FeedForwardError {
    /// A loop cannot be run.
    #[error("the {scheme} scheme: {error}")]
    Drive {
        /// `common` or `split`.
        scheme: &'static str,
        /// The reason.
        error: DriveError,
    },
    /// A loop is not stable.
    #[error(
        "the {scheme} scheme is unstable, so nothing was run: linearised at rest in {place} the loop has poles at {poles} rad/s; lower the gains, raise the filter's frequency, or leave the feedback unfiltered"
    )]
    Unstable {
        /// `common` or `split`.
        scheme: &'static str,
        /// The configuration, in words.
        place: String,
        /// Its poles in the right half plane, in words.
        poles: String,
    },
}

impl FeedForwards {
    /// Runs the common scheme and the split one, in this order, on a machine whose true parameters are `plant`, until `settle` periods have
    /// passed and one more; motors by input.
    ///
    /// # Errors
    /// [`FeedForwardError`] when a loop is unstable or cannot be run.
    pub fn new(
        moved: &MovedMachine,
        plant: &[f64],
        motors: &[Option<Motor>],
        schemes: &[Scheme; 2],
        settle: usize,
    ) -> Result<Self, FeedForwardError> {
        let (trajectory, demand) = (moved.trajectory(), moved.machine.demand());
        let model = moved.machine.model();
        let follow = |scheme: &'static str, settings: &Scheme| {
            let drive = Drive::new(&demand, plant, motors, settings);
            let failed = |error: DriveError| FeedForwardError::Drive { scheme, error };
            let poles = drive.stability(&trajectory, CONFIGURATIONS).map_err(failed)?;
            if poles.unstable() {
                return Err(unstable(moved, &trajectory, scheme, &poles));
            }
            let tracking = drive.track(&trajectory, settle, &poles).map_err(failed)?;
            Ok((poles, tracking))
        };
        let (common, split) = (follow(NAMES[0], &schemes[0])?, follow(NAMES[1], &schemes[1])?);
        let count = model.dims().coordinates;
        let coordinates: Vec<String> = (0..count).map(|c| model.coordinate(c).to_string()).collect();
        let figure = tracking_errors(&moved.title(), &common.1, &split.1, &coordinates);
        let followed = |(poles, tracking): (LoopPoles, Tracking)| Followed {
            errors: (0..count)
                .map(|c| {
                    let errors = Errors {
                        rms: tracking.rms[c],
                        peak: tracking.peak[c],
                        rate_rms: tracking.rate_rms[c],
                        rate_peak: tracking.rate_peak[c],
                    };
                    (model.coordinate(c).name.to_owned(), errors)
                })
                .collect(),
            limited: motors
                .iter()
                .enumerate()
                .filter(|(_, motor)| motor.is_some())
                .map(|(i, _)| {
                    let [current, voltage, power] = tracking.limited[i];
                    (model.input(i).name.to_owned(), Limited { current, voltage, power })
                })
                .collect(),
            poles: poles.poles,
        };
        Ok(Self {
            schema: "tpm.feedforward/1",
            model: moved.model.clone(),
            schemes: vec![(NAMES[0], followed(common)), (NAMES[1], followed(split))],
            motion: moved.to_string(),
            coordinates,
            figure,
        })
    }

    /// Tracking errors of both schemes over the period.
    #[must_use]
    pub fn figure(&self) -> &Figure {
        &self.figure
    }
}

fn unstable(
    moved: &MovedMachine,
    trajectory: &Trajectory,
    scheme: &'static str,
    found: &LoopPoles,
) -> FeedForwardError {
    let model = moved.machine.model();
    let mut motion = vec![0.0; model.dims().coordinates];
    trajectory.motion(found.phase, &mut motion);
    let place = motion.iter().enumerate().map(|(c, value)| {
        let value = if value.abs() < ROUNDING { 0.0 } else { *value };
        format!("{} = {}", model.coordinate(c).name, number(value))
    });
    let poles = found.poles.iter().take_while(|pole| pole.re > 0.0).filter(|pole| pole.im >= 0.0);
    let poles = poles.map(|pole| pole_text(pole.re, pole.im));
    FeedForwardError::Unstable {
        scheme,
        place: place.collect::<Vec<_>>().join(", "),
        poles: poles.collect::<Vec<_>>().join(", "),
    }
}

/// A pole in words, with its conjugate.
fn pole_text(re: f64, im: f64) -> String {
    if im == 0.0 { number(re) } else { format!("{} +- {}j", number(re), number(im.abs())) }
}

impl fmt::Display for FeedForwards {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [(_, common), (_, split)] = self.schemes.as_slice() else { return Ok(()) };
        writeln!(f, "{}: {}\n", self.model, self.motion)?;
        let compared = |title: &str, rows: &mut dyn Iterator<Item = (&String, [f64; 4])>| {
            let mut table = TextTable::new(&[
                (title, Align::Left),
                ("common rms", Align::Right),
                ("split rms", Align::Right),
                ("ratio", Align::Right),
                ("common peak", Align::Right),
                ("split peak", Align::Right),
                ("ratio", Align::Right),
            ]);
            for (name, [common_rms, split_rms, common_peak, split_peak]) in rows {
                table.row(&[
                    name.clone(),
                    number(common_rms),
                    number(split_rms),
                    number(common_rms / split_rms),
                    number(common_peak),
                    number(split_peak),
                    number(common_peak / split_peak),
                ]);
            }
            table.finish()
        };
        let both = || common.errors.iter().zip(&split.errors);
        let positions = both().map(|((_, a), (_, b))| [a.rms, b.rms, a.peak, b.peak]);
        f.write_str(&compared("error of", &mut self.coordinates.iter().zip(positions)))?;
        let rates = both().map(|((name, a), (_, b))| (name, [a.rate_rms, b.rate_rms, a.rate_peak, b.rate_peak]));
        write!(f, "\n{}", compared("error of the velocity of", &mut { rates }))?;
        let of_position: fn(&Errors) -> f64 = |errors| errors.rms;
        let of_rate: fn(&Errors) -> f64 = |errors| errors.rate_rms;
        for (what, of) in [("position", of_position), ("velocity", of_rate)] {
            for ((name, common), (_, split)) in both().filter(|((_, common), (_, split))| of(split) > of(common)) {
                writeln!(
                    f,
                    "\nthe split feed-forward makes the error of the {what} of {name} larger, {} times as large (rms); Feng, section 6.3, expects that it makes errors of position and velocity smaller",
                    number(of(split) / of(common))
                )?;
            }
        }
        if !common.limited.is_empty() {
            let mut table = TextTable::new(&[
                ("motor of", Align::Left),
                ("limit", Align::Left),
                ("common", Align::Right),
                ("split", Align::Right),
            ]);
            for ((input, common), (_, split)) in common.limited.iter().zip(&split.limited) {
                for (limit, common, split) in [
                    (Limit::Current, common.current, split.current),
                    (Limit::Voltage, common.voltage, split.voltage),
                    (Limit::Power, common.power, split.power),
                ] {
                    let name = limit.name_and_unit().0.to_owned();
                    table.row(&[input.clone(), name, number(100.0 * common), number(100.0 * split)]);
                }
            }
            write!(f, "\nlimits active, % of the time\n\n{}", table.finish())?;
        }
        for (n, (name, followed)) in self.schemes.iter().enumerate() {
            if let Some(pole) = followed.poles.first() {
                let before = if n == 0 { "\n" } else { "" };
                let pole = pole_text(pole.re, pole.im);
                writeln!(f, "{before}slowest pole of the {name} loop along the reference {pole} rad/s")?;
            }
        }
        Ok(())
    }
}
