//! Frequency response of the simulated pendulum hanging down, and the fits to it (Fong, section 3.2 and Figure 6).

use super::failure::Failure;

use super::Chapter;
use super::linear::eqn_29;
use super::machine::Machine;
use super::markdown::{percent, polynomial, roots, table};
use std::f64::consts::TAU;
use tpm_runtime::frequency::{
    BodeSettings, Complex, Excitation, FrequencyResponse, OrderComparison, RationalFit, RationalSettings,
    StructuredFit, StructuredSettings, TransferFunction, Welch, bode, compare_orders, fit_rational, fit_record,
    fit_structured,
};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::physical::LinearizedResponse;
use tpm_runtime::plant::simulated::{Sensor, drive};
use tpm_runtime::plot::Figure;
use tpm_runtime::report::number;
use tpm_symbolic::expr::graph::{Coordinate, Symbol};

/// Sample time, s.
const SAMPLE_TIME: f64 = 1e-3;
/// Standard deviation of the noise that excites the machine, V.
const VOLTAGE: f64 = 0.3;
/// Time for which a value of the noise is held, s.
const HELD: f64 = 0.01;
/// Samples of a segment of Welch's average.
const SEGMENT: usize = 32_768;
/// Band of the fits, Hz; the paper fits up to 23 Hz.
const BAND: (f64, f64) = (0.2, 23.0);
const SEED: u64 = 1;
/// Orders of numerator and denominator that are compared.
const ORDERS: [(usize, usize); 5] = [(0, 2), (1, 2), (1, 3), (2, 4), (3, 4)];
/// Parameters that a response over one coordinate determines when masses and lengths are known.
const FITTED: [&str; 4] = ["J1", "J2", "C1", "C2"];
/// Ratio of the start values of the fitted parameters to the true ones.
const OFF: f64 = 1.5;

/// The motion as one encoder measures it, and the fits to it. Errors are the median and the largest of |G/H - 1| over the band.
struct Measured {
    counts: f64,
    response: FrequencyResponse,
    /// Fit to the averaged response, and its errors.
    averaged: (RationalFit, (f64, f64)),
    /// Fit to the transform of the whole record.
    fit: RationalFit,
    /// Errors of the fit to the whole record.
    error: (f64, f64),
    /// Errors of a fit to the averaged response without the correction for the hold.
    uncorrected: (f64, f64),
    orders: OrderComparison,
    physical: StructuredFit,
}

pub(super) fn chapter(down: &Machine, duration: f64) -> Result<Chapter, Failure> {
    let (derived, _) = down.transfer_function()?;
    let runs = [2000.0, 500.0].map(|counts| Measured::new(down, &derived, counts, duration));
    let [fine, coarse] = runs;
    let (fine, coarse) = (fine?, coarse?);
    let mut text = format!(
        "## 2. Frequency response\n\n{duration} s at 1 kHz; white noise of {VOLTAGE} V held for {} ms; H1 from {} segments of {SEGMENT} samples, \
         Hann window, half overlapping; the lag of half a sample by which a held voltage comes late is corrected.\n\n",
        1e3 * HELD,
        fine.response.segments
    );
    let rows: Vec<Vec<String>> = [&fine, &coarse].into_iter().flat_map(Measured::rows).collect();
    text.push_str(
        "Errors of the fit of order 1/3 against the derived model (Eqn 28), |G/H - 1| from 0.2 to 23 Hz:\n\n",
    );
    let head = ["counts", "fitted to", "lines", "median", "largest", "parametric model"];
    text.push_str(&table(&head, &rows));
    text.push_str(
        "\nThe fit to the whole record takes every line of its transform, the transient between the states at start and end as an unknown \
         beside the model, and the power of the noise from many lines; averages of a few segments know less of all three.\n",
    );
    let effect = fine.response.hold_effect(BAND.0, BAND.1);
    text.push_str(&format!(
        "\nThe correction changes the response by {} (median) and {} at the end of the band.\n",
        percent(effect.median),
        percent(effect.largest)
    ));
    let gaps = coarse.response.gaps(BAND.0, BAND.1);
    if let Some(first) = gaps.first() {
        text.push_str(&format!(
            "At 500 counts {} of {} averaged lines have no usable response, the first at {:.1} Hz: the steps of the encoder drown them, and \
             they are not fitted.\n",
            gaps.iter().map(|gap| gap.lines).sum::<usize>(),
            coarse.response.band(BAND.0, BAND.1).count(),
            first.low
        ));
    }
    text.push_str("\nOrders, judged by predicting the other half of the record (2000 counts):\n\n");
    text.push_str(&orders(&fine.orders));
    text.push_str(&format!(
        "\nParameters of the model straight from the response (masses, lengths and the motor known; started {} % off):\n\n",
        number(100.0 * (OFF - 1.0))
    ));
    text.push_str(&physical(down, &fine, &coarse));
    text.push_str("\n![Bode plot, 2000 counts](bode.svg)\n\n![Bode plot, 500 counts](bode500.svg)\n\n![Eqn 29 beside Eqn 28](eqn29.svg)\n");
    let printed = eqn_29()?;
    let parametric = &fine.fit.function;
    let figures = vec![
        (
            "bode",
            fine.figure(
                "Pendulum over voltage, 2000 counts",
                &[("derived (Eqn 28)", &derived), ("parametric (order 1/3)", parametric)],
            ),
        ),
        (
            "bode500",
            coarse.figure(
                "Pendulum over voltage, 500 counts",
                &[("derived (Eqn 28)", &derived), ("parametric (order 1/3)", &coarse.fit.function)],
            ),
        ),
        (
            "eqn29",
            fine.figure("Eqn 29 beside Eqn 28", &[("derived (Eqn 28)", &derived), ("Eqn 29, printed", &printed)]),
        ),
    ];
    let recommended = fine.orders.recommended.map(|at| &fine.orders.trials[at]);
    let findings = vec![
        format!(
            "Figure 6 is reproduced up to 23 Hz: the parametric model of the simulated machine lies within {} (median) and {} (largest) of the \
             derived one, at 500 counts, the paper's encoder, within {} and {}.",
            percent(fine.error.0),
            percent(fine.error.1),
            percent(coarse.error.0),
            percent(coarse.error.1)
        ),
        format!(
            "The data support order {}, not the fourth order denominator of Eqn 29: of the orders that predict as well it is the smallest, \
             and those above it add a pole that a zero cancels or that the data do not determine.",
            recommended
                .map_or_else(|| "none of those tried".to_owned(), |t| format!("{}/{}", t.numerator, t.denominator))
        ),
        format!(
            "The paper does not say that a held voltage comes half a sample late; without the correction the fit is off by {} (median) instead \
             of {}.",
            percent(fine.uncorrected.0),
            percent(fine.averaged.1.0)
        ),
    ];
    Ok(Chapter { text, figures, findings })
}

impl Measured {
    fn new(down: &Machine, derived: &TransferFunction, counts: f64, duration: f64) -> Result<Self, Failure> {
        let fault =
            |error: &dyn std::fmt::Display| Failure::Input(format!("frequency response at {counts} counts: {error}"));
        let samples = (duration / SAMPLE_TIME).round() as usize;
        let excitation = Excitation::Noise { std: VOLTAGE, hold: HELD, seed: SEED };
        let input = excitation.samples(samples, SAMPLE_TIME).map_err(|error| fault(&error))?;
        let sensors = vec![Sensor { step: TAU / counts, ..Sensor::default() }; 2];
        let bench = down.bench(sensors, f64::INFINITY, SEED);
        let record = drive(&down.interpreted, &bench, SAMPLE_TIME, &[input]).map_err(|error| fault(&error))?;
        let (input, output) = (&record.inputs[0], &record.coordinates[1]);
        let measure = |hold| {
            FrequencyResponse::estimate(input, output, SAMPLE_TIME, &Welch::new(SEGMENT, hold))
                .map_err(|error| fault(&error))
        };
        let settings = RationalSettings::new(1, 3, BAND.0, BAND.1);
        let (response, recorded) = (measure(Hold::Zoh)?, measure(Hold::None)?);
        let averaged = fit_rational(&response, &settings).map_err(|error| fault(&error))?;
        let fit = fit_record(input, output, SAMPLE_TIME, &Welch::new(SEGMENT, Hold::Zoh), &settings);
        let fit = fit.map_err(|error| fault(&error))?;
        let uncorrected = fit_rational(&recorded, &settings).map_err(|error| fault(&error))?;
        let error = |function: &TransferFunction| {
            let lines = response.band(BAND.0, BAND.1).map(|line| line.frequency);
            let mut errors: Vec<f64> =
                lines.map(|w| (function.response(w) / derived.response(w) - 1.0).norm()).collect();
            errors.sort_by(f64::total_cmp);
            (errors[errors.len() / 2], errors[errors.len() - 1])
        };
        let orders = compare_orders(input, output, SAMPLE_TIME, &Welch::new(SEGMENT, Hold::Zoh), &settings, &ORDERS);
        Ok(Measured {
            counts,
            error: error(&fit.function),
            uncorrected: error(&uncorrected.function),
            averaged: {
                let errors = error(&averaged.function);
                (averaged, errors)
            },
            fit,
            orders: orders.map_err(|error| fault(&error))?,
            physical: structured(down, &response)?,
            response,
        })
    }

    /// One row per fit.
    fn rows(&self) -> [Vec<String>; 3] {
        let row = |what: &str, (median, largest): (f64, f64), fit: Option<&RationalFit>| {
            let formula =
                |g: &TransferFunction| format!("({}) / ({})", polynomial(g.numerator()), polynomial(g.denominator()));
            let lines = fit.map_or_else(|| "-".to_owned(), |fit| fit.lines.to_string());
            let formula = fit.map_or_else(|| "-".to_owned(), |fit| formula(&fit.function));
            vec![number(self.counts), what.to_owned(), lines, percent(median), percent(largest), formula]
        };
        [
            row("averaged response, hold not corrected", self.uncorrected, None),
            row("averaged response (H1)", self.averaged.1, Some(&self.averaged.0)),
            row("whole record", self.error, Some(&self.fit)),
        ]
    }

    fn figure(&self, title: &str, models: &[(&str, &TransferFunction)]) -> Figure {
        let responses: Vec<Box<dyn Fn(f64) -> Complex + '_>> = models
            .iter()
            .map(|(_, function)| Box::new(|w| function.response(w)) as Box<dyn Fn(f64) -> Complex + '_>)
            .collect();
        let named: Vec<_> = models.iter().zip(&responses).map(|((name, _), response)| (*name, &**response)).collect();
        let settings = BodeSettings { title: title.into(), unit: "rad/V".into(), low: BAND.0, high: BAND.1 };
        bode(&self.response, &named, &settings)
    }
}

/// The fit of the model's own parameters.
fn structured(down: &Machine, response: &FrequencyResponse) -> Result<StructuredFit, Failure> {
    let (model, linear) = down.linearized();
    let parameters: Vec<Symbol> = model.parameters().collect();
    let inputs: Vec<Symbol> = model.inputs().collect();
    let constants: Vec<(Symbol, f64)> =
        model.run_time_constants().map(|symbol| (symbol, down.named(&model.quantity(symbol).name))).collect();
    let names: Vec<&str> = parameters.iter().map(|&symbol| model.quantity(symbol).name.as_str()).collect();
    let fault = |error: &dyn std::fmt::Display| Failure::Input(format!("fit of the model to the response: {error}"));
    let of = LinearizedResponse::new(model, linear, Coordinate(1), inputs[0], &parameters, &constants)
        .map_err(|error| fault(&error))?;
    let start: Vec<f64> =
        names.iter().map(|name| down.named(name) * if FITTED.contains(name) { OFF } else { 1.0 }).collect();
    let settings = StructuredSettings {
        frozen: names.iter().map(|name| !FITTED.contains(name)).collect(),
        ..StructuredSettings::new(&start, BAND.0, BAND.1)
    };
    fit_structured(response, &of, &settings).map_err(|error| fault(&error))
}

fn physical(down: &Machine, fine: &Measured, coarse: &Measured) -> String {
    let (model, _) = down.linearized();
    let mut rows = Vec::new();
    for (at, symbol) in model.parameters().enumerate() {
        let name = model.quantity(symbol).name.as_str();
        if !FITTED.contains(&name) {
            continue;
        }
        let truth = down.named(name);
        let mut row = vec![name.to_owned(), number(truth)];
        for measured in [fine, coarse] {
            let found = measured.physical.parameters[at];
            row.extend([number(found.value), number(found.std), percent(found.value / truth - 1.0)]);
        }
        rows.push(row);
    }
    let head = ["parameter", "true", "2000 counts", "std", "error", "500 counts", "std", "error"];
    table(&head, &rows)
}

fn orders(found: &OrderComparison) -> String {
    let optional = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"));
    let rows: Vec<Vec<String>> = found
        .trials
        .iter()
        .enumerate()
        .map(|(at, trial)| {
            let said = match &trial.fit {
                Err(fault) => fault.to_string(),
                Ok(_) if found.recommended == Some(at) => "recommended".to_owned(),
                Ok(fit) => {
                    let said: Vec<String> =
                        fit.warnings.iter().filter(|w| w.order_too_high()).map(ToString::to_string).collect();
                    said.join("; ")
                }
            };
            let poles = trial.fit.as_ref().map_or_else(
                |_| "-".to_owned(),
                |fit| roots(&fit.poles.iter().map(|pole| pole.value).collect::<Vec<_>>()),
            );
            let order = format!("{}/{}", trial.numerator, trial.denominator);
            vec![order, optional(trial.validation), optional(trial.worse_by), poles, said]
        })
        .collect();
    table(&["order", "prediction", "worse by", "poles [rad/s]", ""], &rows)
}
