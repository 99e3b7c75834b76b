//! The page of a prediction of a log, and those of its parts that pages of identifications contain.

use crate::block::{Block, Cell, Notice, SHARE_DIGITS};
use crate::forces::{self, AROUND, PANEL};
use crate::page::{Caution, Document};
use crate::residuals;
use tpm_plot::Figure;
use tpm_report::{digits, number, probability};
use tpm_session::{BetweenStamps, CorrelationTest, LAGS, SensorFollowed, Validation};

impl From<&Validation> for Document {
    /// The page of the comparison between a log and its prediction with given parameters.
    fn from(found: &Validation) -> Self {
        let mut document = Document {
            title: found.model.clone(),
            subtitle: format!("predicted on {}; nothing is fitted", found.log),
            issue: None,
            conclusion: conclusion(found),
            short: "The prediction fails",
            shortfall: found.shortfall(),
            success: "Every row of the model is predicted.".to_owned(),
            caution: failed(found).then_some(Caution {
                section: "residual",
                text: "One sample ahead it misses more than noise: tests of these errors failed.",
            }),
            facts: facts(found),
            sections: Vec::new(),
            figures: Vec::new(),
        };
        let mut notices: Vec<Notice> = found.reading.remarks().into_iter().map(remark).collect();
        notices.extend(found.not_simulated.iter().map(|why| remark(format!("the motion is not simulated: {why}"))));
        if !notices.is_empty() {
            document.section("notices", "What to know", vec![Block::Notices { list: notices }]);
        }
        document.evidence(std::slice::from_ref(found), &[]);
        document
    }
}

/// Whether a test of the errors one step ahead failed.
pub(super) fn failed(found: &Validation) -> bool {
    found.simulation.iter().flat_map(|simulation| &simulation.channels).any(|channel| {
        let tests = channel.whiteness.iter().chain(channel.independence.iter().map(|input| &input.test));
        tests.into_iter().any(|test| !test.passed)
    })
}

/// How well the parameters predict, in words.
fn conclusion(found: &Validation) -> Vec<String> {
    let mut said = vec!["The parameters are those of another identification; nothing is fitted here.".to_owned()];
    said.extend(found.prediction_error.map(|share| {
        format!("Of the force that acts on a row, at most {} % is missed.", digits(100.0 * share, SHARE_DIGITS))
    }));
    let channels = || found.simulation.iter().flat_map(|simulation| &simulation.channels);
    let worst = |fits: &mut dyn Iterator<Item = (String, f64)>| fits.min_by(|a, b| a.1.total_cmp(&b.1));
    let one_step = worst(&mut channels().filter_map(|channel| Some((channel.name.clone(), channel.one_step.fit?))));
    let free_run =
        worst(&mut channels().filter_map(|channel| Some((channel.name.clone(), channel.free_run.as_ref()?.fit?))));
    said.extend(
        one_step.map(|(name, fit)| format!("One sample ahead, {name} is predicted worst, with a fit of {fit:.2} %.")),
    );
    // A sample ahead nearly everything is predicted well: how far the model itself goes is told by what only the inputs drive.
    said.extend(
        free_run.map(|(name, fit)| {
            format!("Driven by the inputs alone, {name} is followed worst, with a fit of {fit:.2} %.")
        }),
    );
    said
}

/// A notice that is no warning.
pub(super) fn remark(text: String) -> Notice {
    Notice { text, remedy: None, grave: false }
}

/// The largest prediction error, which is the same in the headline and in the table of rows.
fn facts(found: &Validation) -> Vec<(String, Cell)> {
    let mut facts = Vec::new();
    facts.extend(found.prediction_error.map(|share| {
        let text = format!("{} % of the force", digits(100.0 * share, SHARE_DIGITS));
        ("largest share missed".to_owned(), Cell::shown(text, Some(share)))
    }));
    let used = match (found.period, &found.between_stamps) {
        (_, Some(run)) => {
            format!("{} stretches between their stamps, the longest of {} s", run.stretches, number(run.duration))
        }
        (Some(period), _) => {
            format!("{} periods of {} s, harmonics up to {}", found.periods, number(period), found.harmonics)
        }
        (None, None) => format!("every sample, low pass at {} Hz", number(found.cut_off.unwrap_or(f64::NAN))),
    };
    facts.push(("used".to_owned(), Cell::text(used)));
    facts.push(("hold of the inputs".to_owned(), Cell::text(found.hold.clone())));
    if let Some(simulation) = &found.simulation {
        let plural = if simulation.stretches == 1 { "" } else { "es" };
        let text =
            format!("{} of {} samples in {} stretch{plural}", simulation.samples, simulation.of, simulation.stretches);
        facts.push(("simulated".to_owned(), Cell::text(text)));
    }
    facts
}

impl Document {
    /// Measured motion compared with the model's, and residuals with their tests, for every given log or run. `first` are the numbers of
    /// the headline that stand above them once more, with what they are.
    pub(super) fn evidence(&mut self, all: &[Validation], first: &[(String, Cell)]) {
        let (mut against, mut tests) = (Vec::new(), Vec::new());
        if !first.is_empty() && !all.is_empty() {
            let rows = first.iter().map(|(name, number)| vec![Cell::text(name.clone()), number.clone()]).collect();
            against.push(Block::table(
                &["of all data together", "#share"],
                rows,
                "the result's own number, as in the headline",
            ));
        }
        for found in all {
            let named = |what: &str| if all.len() > 1 { format!("{}: {what}", found.log) } else { what.to_owned() };
            if let Some(run) = &found.between_stamps {
                against.push(followed(run, &named("free run from the recorded inputs, between the stamps of the log")));
                let figure = run.figure(&format!("{} on {}", found.model, found.log));
                let low = Figure { height: AROUND + PANEL * figure.panels.len() as u32, ..figure };
                against.push(self.figure("motion", low, &named("Readings, the free run, and the difference")));
                continue;
            }
            // Predicted forces.
            against.push(row_table(
                found,
                &named("forces that the measured motion asks for, at the used harmonics or behind the low pass"),
            ));
            // A share of the force stands beside shares of the motion: what sensors add to the one is nothing of the other.
            against.extend((!found.rows.is_empty()).then(|| {
                Block::text(
                    "The share missed is one of the force along the motion as it was measured, whose noise is differentiated with it. It may be \
                     larger by far than what a simulation leaves of the motion itself.",
                )
            }));
            for row in &found.unpredicted {
                let text = format!(
                    "{} is not predicted: it changes with {}, which the result leaves open",
                    row.name, row.direction
                );
                against.push(Block::text(text));
            }
            if let Some(figure) = forces::in_time(found) {
                against.push(self.figure("force", figure, &named("Applied force, the force that the model asks for along the measured motion, and the difference")));
            }
            if let Some(figure) = forces::by_harmonic(found) {
                against.push(self.figure(
                    "harmonics",
                    figure,
                    &named("Amplitude of every harmonic of the force that is used, and what the model misses of it"),
                ));
            }
            // Simulated motion.
            let Some(simulation) = &found.simulation else {
                against.extend(
                    found.not_simulated.iter().map(|why| Block::text(format!("The motion is not simulated: {why}."))),
                );
                continue;
            };
            against.push(fits(
                found,
                &named("motion simulated from the recorded inputs, each stretch from its smoothed state"),
            ));
            let figure = simulation.figure(&format!("{} on {}", found.model, found.log));
            let low = Figure { height: AROUND + PANEL * figure.panels.len() as u32, ..figure };
            against.push(self.figure(
                "motion",
                low,
                &named("Measured motion, the motion simulated from the recorded inputs, and what each misses"),
            ));
            if let Some(leaving) = &simulation.diverges {
                let why = if leaving.unstable {
                    "the motion is unstable without its loop, and the smallest error of the starting state grows to the size of the motion"
                } else {
                    "the simulated motion leaves the measured one"
                };
                against.push(Block::text(format!(
                    "The free run diverges at t = {} s of stretch {}: {why}.",
                    number(leaving.time),
                    leaving.stretch + 1
                )));
            }
            // Tests of the one-step errors.
            let table = tested(found, &named("tests of the one-step errors"));
            let any = table.is_some();
            tests.extend(table);
            if let Some(figure) = forces::correlations(found) {
                tests.push(self.figure(
                    "correlations",
                    figure,
                    &named("Correlations of the one-step errors with themselves and with earlier inputs"),
                ));
            }
            if let Some(figure) = residuals::against_motion(found) {
                tests.push(self.figure("residuals", figure, &named(residuals::CAPTION)));
            }
            if any {
                tests.push(Block::text(format!(
                    "{} samples were tested, none around stops with dry friction. A right model fails each test with a chance of {} %, and a long record \
                     shows the smallest misfit: how large it is, the fits above tell.",
                    simulation.tested,
                    100.0 * simulation.false_alarm
                )));
            }
        }
        self.section("against", "Measured against model", against);
        self.section("residual", "Residual and its tests", tests);
    }
}

fn row_table(found: &Validation, caption: &str) -> Block {
    let row = |row: &tpm_session::RowPrediction| {
        vec![
            Cell::text(row.name.clone()),
            Cell::text(row.unit.clone().unwrap_or_else(|| "-".to_owned())),
            Cell::size(Some(row.force)),
            Cell::size(Some(row.missed)),
            Cell::percent(Some(row.share)),
        ]
    };
    let rows = found.rows.iter().map(row).collect();
    Block::table(&["row", "unit", "#applied, rms", "#missed, rms", "#share missed"], rows, caption)
}

/// Fits of the free run between stamps.
fn followed(run: &BetweenStamps, caption: &str) -> Block {
    let row = |own: &SensorFollowed| {
        let fit = own.free_run.fit;
        vec![
            Cell::text(own.signal.clone()),
            Cell::text(own.unit.clone().unwrap_or_else(|| "-".to_owned())),
            Cell::text(own.readings.to_string()),
            Cell::size(Some(own.free_run.rms)),
            Cell::shown(fit.map_or_else(|| "-".to_owned(), |fit| format!("{fit:.2} %")), fit),
        ]
    };
    let rows = run.sensors.iter().map(row).collect();
    Block::table(&["sensor", "unit", "#readings", "#free run, rms", "#fit"], rows, caption)
}

fn fits(found: &Validation, caption: &str) -> Block {
    let channels = found.simulation.iter().flat_map(|simulation| &simulation.channels);
    let percent = |fit: Option<f64>| Cell::shown(fit.map_or_else(|| "-".to_owned(), |fit| format!("{fit:.2} %")), fit);
    let rows = channels.map(|channel| {
        let free = channel.free_run.as_ref();
        vec![
            Cell::text(channel.name.clone()),
            Cell::text(channel.unit.clone().unwrap_or_else(|| "-".to_owned())),
            Cell::size(Some(channel.one_step.rms)),
            percent(channel.one_step.fit),
            free.map_or_else(|| Cell::text("diverges"), |free| Cell::size(Some(free.rms))),
            percent(free.and_then(|free| free.fit)),
            Cell::size(Some(channel.noise)),
        ]
    });
    let columns =
        ["coordinate", "unit", "#one step, rms", "#its fit", "#free run, rms", "#its fit", "#sensor noise found"];
    Block::table(&columns, rows.collect(), caption)
}

fn tested(found: &Validation, caption: &str) -> Option<Block> {
    let mut rows = Vec::new();
    let mut row = |what: String, test: &CorrelationTest| {
        let (largest, lag) = test.largest();
        rows.push(vec![
            Cell::text(what),
            Cell::shown(format!("{largest:.4}"), Some(largest)),
            Cell::text(lag.to_string()),
            Cell::shown(format!("{:.4}", test.band), Some(test.band)),
            Cell::text(format!("{} of {LAGS}", test.outside())),
            Cell::shown(probability(test.chance, |p| digits(p, 2)), Some(test.chance)),
            Cell::text(if test.passed { "passed" } else { "failed" }),
        ]);
    };
    for channel in found.simulation.iter().flat_map(|simulation| &simulation.channels) {
        if let Some(white) = &channel.whiteness {
            row(format!("{}: white", channel.name), white);
        }
        for own in &channel.independence {
            row(format!("{}: independent of {}", channel.name, own.input), &own.test);
        }
    }
    let columns = ["errors", "#largest correlation", "#at lag", "#band", "#beyond", "#chance", ""];
    (!rows.is_empty()).then(|| Block::table(&columns, rows, caption))
}
