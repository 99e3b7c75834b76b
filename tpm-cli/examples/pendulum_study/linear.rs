//! Equations of motion linearised, beside what the paper prints.

use super::failure::Failure;

use super::Chapter;
use super::machine::Machine;
use super::markdown::{percent, polynomial, roots, table};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use tpm_runtime::frequency::TransferFunction;
use tpm_runtime::report::number;

/// Fong, Eqn 24, as printed: the accelerations of arm and pendulum per th2, th1', th2' and e.
const EQN_24: [[f64; 4]; 2] = [[5.9796, -8.1419, -0.1098, 28.8442], [57.6254, -6.9788, -1.0584, 24.7236]];
/// Fong, Eqn 29, as printed: numerator and denominator, s^0 first.
const EQN_29: ([f64; 4], [f64; 5]) = ([164.6, -323.4, -24.92, 0.0277], [6548.0, 1589.0, 200.6, 15.28, 1.0]);
/// Number of frequencies at which two responses are compared.
const COMPARED: usize = 400;

/// The parametric model of Fong, Eqn 29.
pub(super) fn eqn_29() -> Result<TransferFunction, Failure> {
    TransferFunction::new(&EQN_29.0, &EQN_29.1).map_err(|error| Failure::Input(error.to_string()))
}

/// Median and largest |other/own - 1| over a band in Hz, evenly on a logarithmic axis.
fn difference(own: &TransferFunction, other: &TransferFunction, low: f64, high: f64) -> (f64, f64) {
    let mut differences: Vec<f64> = (0..COMPARED)
        .map(|i| TAU * low * (high / low).powf(i as f64 / (COMPARED - 1) as f64))
        .map(|w| (other.response(w) / own.response(w) - 1.0).norm())
        .collect();
    differences.sort_by(f64::total_cmp);
    (differences[COMPARED / 2], differences[COMPARED - 1])
}

pub(super) fn chapter(upright: &Machine, down: &Machine) -> Result<Chapter, Failure> {
    let mut findings = Vec::new();
    let standing = upright.state_space(&BTreeMap::new());
    let mut rows = Vec::new();
    let mut largest = 0.0_f64;
    for (at, (row, name)) in EQN_24.iter().zip(["th1''", "th2''"]).enumerate() {
        let found = [standing.a[2 + at][1], standing.a[2 + at][2], standing.a[2 + at][3], standing.b[2 + at][0]];
        for ((found, printed), of) in found.iter().zip(row).zip(["th2", "th1'", "th2'", "e"]) {
            // Half a unit of the last printed digit is rounding, not a difference.
            let beyond = ((found - printed).abs() - 0.5e-4).max(0.0) / printed.abs();
            largest = largest.max(beyond);
            rows.push(vec![name.into(), of.into(), number(*found), number(*printed), percent(found / printed - 1.0)]);
        }
    }
    let mut text = String::from(
        "## 1. Linear models\n\nUpright, about th2 = 0 (Eqns 15 to 24). Table 1 prints C2 = 390; with 3.168e-4 the equations give \
         Eqn 24:\n\n",
    );
    text.push_str(&table(&["row", "column", "derived", "Eqn 24", "difference"], &rows));
    let agree = largest <= 1e-4;
    findings.push(format!(
        "Eqn 24 {} reproduced from Eqn 3 and Table 1 with C2 = 3.168e-4: its entries differ by {} at most beyond their printed digits. \
         With C2 = 390, as printed in Table 1, they do not agree.",
        if agree { "is" } else { "is not" },
        percent(largest)
    ));
    findings.push(
        "J2 of Table 1 is m2 l2^2/3 with l2 = 0.16 m, about the pivot already; Eqn 3 adds m2 c2^2 to it once more. The equations are \
         kept as printed."
            .to_owned(),
    );
    let hanging = down.state_space(&BTreeMap::new());
    text.push_str("\nHanging down (Eqn 28; its numbers follow from Eqn 27):\n\n");
    let names = ["th1", "alpha2", "th1'", "alpha2'"];
    let mut rows = Vec::new();
    for (name, (a, b)) in ["th1''", "alpha2''"].iter().zip(hanging.a[2..].iter().zip(&hanging.b[2..])) {
        let mut row = vec![(*name).to_owned()];
        row.extend(a.iter().chain(b).map(|value| number(*value)));
        rows.push(row);
    }
    text.push_str(&table(&[&[""], &names[..], &["e"]].concat(), &rows));
    let (own, cancelled) = down.transfer_function()?;
    let printed = eqn_29()?;
    let formula = |g: &TransferFunction| format!("({}) / ({})", polynomial(g.numerator()), polynomial(g.denominator()));
    let row = |what: &str, of: &dyn Fn(&TransferFunction) -> String| vec![what.to_owned(), of(&own), of(&printed)];
    text.push_str("\nThe pendulum's angle over the voltage, beside the parametric model of the paper:\n\n");
    text.push_str(&table(
        &["", "Eqn 28", "Eqn 29"],
        &[
            row("transfer function", &formula),
            row("poles [rad/s]", &|g| roots(&g.poles())),
            row("zeros [rad/s]", &|g| roots(&g.zeros())),
            row("static gain [rad/V]", &|g| number(g.static_gain())),
        ],
    ));
    let (median, most) = difference(&own, &printed, 0.2, 23.0);
    text.push_str(&format!(
        "\nA pole at {} has cancelled exactly: the pendulum does not show where the arm stands. **Eqns 28 and 29 are not consistent**: \
         from 0.2 to 23 Hz their responses differ by {} of Eqn 28's (median), {} at most. A pendulum that hangs comes to rest in the \
         vertical wherever the arm rests, so its static gain is 0; that of Eqn 29 is not.\n",
        roots(&cancelled),
        percent(median),
        percent(most)
    ));
    findings.push(format!(
        "Eqn 28 follows from Eqn 27 and has order 1/3 after an exact cancellation. Eqn 29 is not consistent with it: other poles ({}), a \
         static gain of {:.4} rad/V where it must be 0, and a median difference of {}. The text calls its numerator second order; it \
         is printed with a term in s^3.",
        roots(&printed.poles()),
        printed.static_gain(),
        percent(median)
    ));
    Ok(Chapter { text, figures: Vec::new(), findings })
}

#[cfg(test)]
mod tests {
    use super::{difference, eqn_29};

    #[test]
    fn eqn_29_has_the_poles_of_its_printed_coefficients() {
        let g = eqn_29().expect("finite");
        let poles = g.poles();
        for (pole, (re, im)) in poles.iter().zip([(-6.48_f64, 4.05_f64), (-6.48, 4.05), (-1.16, 10.53), (-1.16, 10.53)])
        {
            assert!((pole.re - re).abs() < 6e-3 && (pole.im.abs() - im).abs() < 6e-3, "{poles:?}");
        }
        assert!((g.static_gain() - 0.0251).abs() < 1e-4);
        assert_eq!(difference(&g, &g, 0.2, 23.0), (0.0, 0.0));
    }
}
