//! A regulator about a machine's point of rest, with its poles and margins.

use crate::linear::words::{root_text, roots, roots_text};
use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt;
use tpm_frequency::Complex;
use tpm_plant::regulator::{Design, Mode, RegulatorWeights};
use tpm_report::{Align, TextTable, number};

/// Smallest share of a combination of coordinates that is shown.
const SMALLEST_SHARE: f64 = 1e-6;

/// Magnitude of a pole in sampled time below which it is memory of the last sample, and no motion.
const MEMORY: f64 = 1e-6;

/// A regulator `u = u0 - K (x - x0)`. It is displayed as a text, and serialised as `tpm.regulator/1`.
#[derive(Debug, Serialize)]
pub struct Regulated {
    schema: &'static str,
    model: String,
    coordinates: Vec<AtRest>,
    inputs: Vec<AtRest>,
    /// Names of the states: coordinates, then their rates.
    states: Vec<String>,
    /// Time between the controller's samples, s.
    sample_time: f64,
    /// Time constant of the filter of differences, s; none where rates are measured.
    derivative_filter: Option<f64>,
    state_weights: Vec<f64>,
    input_weights: Vec<f64>,
    gain: Vec<Vec<f64>>,
    /// Poles of the loop in sampled time.
    #[serde(serialize_with = "roots")]
    poles: Vec<Complex>,
    continuous: Continuous,
    #[serde(serialize_with = "roots")]
    open_poles: Vec<Complex>,
    margins: Vec<InputMargins>,
    residual: f64,
    continuous_residual: f64,
    unreached: Vec<Unreached>,
}

/// A coordinate or an input with its value at the point.
#[derive(Clone, Debug, Serialize)]
pub struct AtRest {
    /// Its name in the model.
    pub name: String,
    /// Its unit, where it has one.
    pub unit: Option<String>,
    /// Its value at the point, in this unit.
    pub at: f64,
}

#[derive(Debug, Serialize)]
struct Continuous {
    gain: Vec<Vec<f64>>,
    #[serde(serialize_with = "roots")]
    poles: Vec<Complex>,
}

/// Margins of the loop at one input; an end that is infinite is null in JSON.
#[derive(Debug, Serialize)]
struct InputMargins {
    input: String,
    gain: (f64, f64),
    /// rad
    phase: f64,
    /// s
    delay: f64,
}

/// A mode that no input reaches.
#[derive(Debug, Serialize)]
struct Unreached {
    re: f64,
    im: f64,
    combination: Vec<f64>,
}

/// A mode in words, for a machine with these coordinates.
#[must_use]
pub fn mode_in_words(mode: &Mode, coordinates: &[AtRest]) -> String {
    words(mode.pole, &mode.combination, coordinates.iter().map(|signal| signal.name.as_str()))
}

fn words<'n>(pole: Complex, combination: &[f64], names: impl Iterator<Item = &'n str>) -> String {
    let shown = names.zip(combination).filter(|(_, share)| share.abs() > SMALLEST_SHARE);
    let terms: Vec<String> = shown.map(|(name, share)| format!("{share:+.3} {name}")).collect();
    format!("the mode at {} rad/s, the motion of {}", root_text(pole), terms.join(" "))
}

impl Regulated {
    /// The answer for a design of a machine with these coordinates and inputs; `derivative_filter` is none where rates are measured.
    #[must_use]
    pub fn new(
        model: &str,
        (coordinates, inputs): (&[AtRest], &[AtRest]),
        (sample_time, derivative_filter): (f64, Option<f64>),
        weights: &RegulatorWeights,
        found: &Design,
    ) -> Self {
        let names = coordinates.iter().map(|signal| signal.name.clone());
        let rates = coordinates.iter().map(|signal| format!("dot({})", signal.name));
        Self {
            schema: "tpm.regulator/1",
            model: model.to_owned(),
            coordinates: coordinates.to_vec(),
            inputs: inputs.to_vec(),
            states: names.chain(rates).collect(),
            sample_time,
            derivative_filter,
            state_weights: weights.state.clone(),
            input_weights: weights.input.clone(),
            gain: found.sampled.gain().to_rows(),
            poles: found.poles.clone(),
            continuous: Continuous { gain: found.continuous.gain.to_rows(), poles: found.continuous.poles.clone() },
            open_poles: found.open_poles.clone(),
            margins: inputs
                .iter()
                .zip(&found.margins)
                .map(|(signal, own)| InputMargins {
                    input: signal.name.clone(),
                    gain: own.gain,
                    phase: own.phase,
                    delay: own.delay,
                })
                .collect(),
            residual: found.sampled.residual(),
            continuous_residual: found.continuous.residual,
            unreached: found
                .unreached
                .iter()
                .map(|mode| Unreached { re: mode.pole.re, im: mode.pole.im, combination: mode.combination.clone() })
                .collect(),
        }
    }
}

/// The pole in continuous time that decays and turns as a pole in sampled time does.
fn equivalent(pole: Complex, sample_time: f64) -> Complex {
    Complex::new(pole.norm().ln() / sample_time, pole.arg() / sample_time)
}

impl fmt::Display for Regulated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let signals = self.coordinates.iter().chain(&self.inputs);
        let at: Vec<String> = signals.map(|signal| format!("{} = {}", signal.name, number(signal.at))).collect();
        writeln!(
            f,
            "{}: regulator about rest in {}; u = u0 - K (x - x0)\nsample time {} s; {}\n",
            self.model,
            at.join(", "),
            number(self.sample_time),
            match self.derivative_filter {
                None => "rates are measured".to_owned(),
                Some(time) => format!("rates are differences of the coordinates, filtered with {} s", number(time)),
            }
        )?;
        let mut table = TextTable::new(&[
            ("state", Align::Left),
            ("weight", Align::Right),
            ("input", Align::Left),
            ("gain, continuous", Align::Decimal),
            ("gain, sampled", Align::Decimal),
        ]);
        for (i, input) in self.inputs.iter().enumerate() {
            for (s, state) in self.states.iter().enumerate() {
                table.row(&[
                    state.clone(),
                    number(self.state_weights[s]),
                    input.name.clone(),
                    number(self.continuous.gain[i][s]),
                    number(self.gain[i][s]),
                ]);
            }
        }
        let costs = self.inputs.iter().zip(&self.input_weights);
        let costs: Vec<String> = costs.map(|(input, weight)| format!("{} {}", input.name, number(*weight))).collect();
        writeln!(f, "{}weight of the inputs: {}\n", table.finish(), costs.join(", "))?;
        let moving = self.poles.iter().filter(|z| z.norm() > MEMORY);
        let played: Vec<Complex> = moving.map(|z| equivalent(*z, self.sample_time)).collect();
        writeln!(
            f,
            "poles [rad/s] without feedback: {}\npoles [rad/s] in continuous time: {}\npoles [rad/s] as played, ln(z)/T: {}\n",
            roots_text(&self.open_poles),
            roots_text(&self.continuous.poles),
            roots_text(&played)
        )?;
        let mut table = TextTable::new(&[
            ("margins at", Align::Left),
            ("gain from", Align::Right),
            ("to", Align::Right),
            ("phase [deg]", Align::Right),
            ("delay [s]", Align::Right),
        ]);
        let or_any = |value: f64| if value.is_finite() { number(value) } else { "any".to_owned() };
        for own in &self.margins {
            table.row(&[
                own.input.clone(),
                number(own.gain.0),
                or_any(own.gain.1),
                number(360.0 / TAU * own.phase),
                or_any(own.delay),
            ]);
        }
        writeln!(
            f,
            "{}\nresidual of the Riccati equations: {:.1e} in continuous, {:.1e} in sampled time, of their largest term",
            table.finish(),
            self.continuous_residual,
            self.residual
        )?;
        for mode in &self.unreached {
            let names = self.coordinates.iter().map(|signal| signal.name.as_str());
            let mode = words(Complex::new(mode.re, mode.im), &mode.combination, names);
            writeln!(f, "remark: no input reaches {mode}; it dies down by itself")?;
        }
        Ok(())
    }
}
