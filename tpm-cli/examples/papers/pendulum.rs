//! Values and input of the rotary pendulum (Fong, Table 1 and Figure 5).

use super::Chapter;
use super::failure::Failure;
use super::input::Input;
use super::markdown::table;
use tpm_runtime::frequency::Excitation;
use tpm_runtime::plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_symbolic::number::rational;

/// Fong, Table 1: symbol, value and unit as printed; what the models call it, and why a value or a name differs.
const TABLE_1: &[(&str, &str, &str, &str)] = &[
    ("m1", "0.056 kg", "", "in J1"),
    ("m2", "0.022 kg", "m2", ""),
    ("l1", "0.16 m", "l1", ""),
    ("l2", "0.16 m", "", "in J2 and c2"),
    ("c1", "0.08 m", "", "in J1"),
    ("c2", "0.08 m", "c2", ""),
    ("J1", "0.00215058 kg m^2", "J1", ""),
    (
        "J2",
        "0.00018773 kg m^2",
        "J2",
        "m2 l2^2/3, about the pivot already; Eqn 3 adds m2 c2^2 once more, and is kept as printed",
    ),
    ("C1", "0.02 kg m^2/s", "C1", ""),
    ("C2", "390 kg m^2/s", "C2", "no value of this size gives Eqn 24; this one does"),
    ("g", "9.8 m/s^2", "", "fixed in the models"),
    ("Kt", "0.01826 N m/A", "Kt", ""),
    ("Kb", "0.01826 V s/rad", "Kb", ""),
    ("Ku", "10 V/count", "Ku", "volts per volt: the voltage e before the amplifier is counted in V"),
    ("Rm", "2.5604 ohm", "Rm", ""),
];
/// Standard deviation of the input, V, and the time for which a value is held, s; the paper states neither.
const INPUT: (f64, f64) = (0.3, 0.01);
/// Time that is drawn, s.
const DRAWN: f64 = 2.0;
const SAMPLE_TIME: f64 = 1e-3;

pub(super) fn chapter(values: &Input) -> Result<Chapter, Failure> {
    let (_, parsed) = Input::upright().model()?;
    let known = values.values(&parsed.model)?;
    let rows: Vec<Vec<String>> = TABLE_1
        .iter()
        .map(|(symbol, printed, own, why)| {
            let value = parsed.model.find_symbol(own).and_then(|symbol| known.get(&symbol));
            let value = value.map_or_else(|| "-".to_owned(), |value| rational::to_f64(value).to_string());
            vec![(*symbol).to_owned(), (*printed).to_owned(), value, (*why).to_owned()]
        })
        .collect();
    let excitation = Excitation::Noise { std: INPUT.0, hold: INPUT.1, seed: 1 };
    let count = (DRAWN / SAMPLE_TIME).round() as usize;
    let samples = excitation.samples(count, SAMPLE_TIME).map_err(|error| Failure::Input(error.to_string()))?;
    let points = samples.iter().enumerate().map(|(n, value)| (n as f64 * SAMPLE_TIME, *value)).collect();
    let panel = Panel {
        x: Axis::linear("time [s]").from_to(0.0, DRAWN),
        y: Axis::linear("voltage e [V]"),
        traces: vec![Trace::new("", 0, Curve::Line(points))],
    };
    let figure = Figure::new("Input: band-limited white noise (Fong, Figure 5)", vec![panel]);
    let text = format!(
        "## 7. Fong: values and input\n\nTable 1, beside the values of the models:\n\n{}\n\
         ![Figure 5: the first {DRAWN} s of the input; {} V, each value held {} s](input.svg)\n",
        table(&["symbol", "printed", "used", "why they differ"], &rows),
        INPUT.0,
        INPUT.1,
    );
    Ok(Chapter { text, figures: vec![("input", figure)], findings: Vec::new() })
}
