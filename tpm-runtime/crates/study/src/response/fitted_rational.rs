//! A fitted transfer function.

use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt;
use tpm_frequency::{FitWarning, FittedValue, RationalFit, Root};
use tpm_report::{Align, TextTable, beside, cells, number, plus_minus};

/// Whether a warning says that a fit of this order cannot be relied on.
pub(super) fn spoils(warning: &FitWarning) -> bool {
    warning.order_too_high() || matches!(warning, FitWarning::Unstable { .. })
}

/// A fitted transfer function with its poles and zeros; deviations that are infinite are null in JSON.
#[derive(Debug, Serialize)]
pub(super) struct FittedRational {
    numerator: Vec<f64>,
    numerator_std: Vec<f64>,
    denominator: Vec<f64>,
    denominator_std: Vec<f64>,
    delay: f64,
    delay_std: f64,
    poles: Vec<Located>,
    zeros: Vec<Located>,
    static_gain: Value,
    misfit: f64,
    median_error: f64,
    largest_error: f64,
    lines: usize,
    condition: f64,
    warnings: Vec<String>,
    #[serde(skip)]
    fit: RationalFit,
}

#[derive(Debug, Serialize)]
struct Located {
    re: f64,
    im: f64,
    std_re: f64,
    std_im: f64,
}

#[derive(Debug, Serialize)]
struct Value {
    value: f64,
    std: f64,
}

impl FittedRational {
    pub(super) fn new(fit: RationalFit) -> Self {
        let roots = |roots: &[Root]| -> Vec<Located> {
            let located = |root: &Root| Located {
                re: root.value.re,
                im: root.value.im,
                std_re: root.std.re,
                std_im: root.std.im,
            };
            roots.iter().map(located).collect()
        };
        let FittedValue { value, std, .. } = fit.static_gain;
        Self {
            numerator: fit.function.numerator().to_vec(),
            numerator_std: fit.numerator_std.clone(),
            denominator: fit.function.denominator().to_vec(),
            denominator_std: fit.denominator_std.clone(),
            delay: fit.function.delay(),
            delay_std: fit.delay_std,
            poles: roots(&fit.poles),
            zeros: roots(&fit.zeros),
            static_gain: Value { value, std },
            misfit: fit.misfit,
            median_error: fit.median_error,
            largest_error: fit.largest_error,
            lines: fit.lines,
            condition: fit.condition,
            warnings: fit.warnings.iter().map(ToString::to_string).collect(),
            fit,
        }
    }

    /// Why the function cannot be relied on.
    pub(super) fn doubts(&self) -> Vec<String> {
        self.fit.warnings.iter().filter(|warning| spoils(warning)).map(ToString::to_string).collect()
    }
}

impl fmt::Display for FittedRational {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table =
            TextTable::new(&[("coefficient", Align::Left), ("value", Align::Decimal), ("std", Align::Decimal)]);
        for (name, values, stds) in
            [("b", &self.numerator, &self.numerator_std), ("a", &self.denominator, &self.denominator_std)]
        {
            for (power, (value, std)) in values.iter().zip(stds).enumerate().rev() {
                let [value, std] = cells(Some(*value), Some(*std));
                table.row(&[format!("{name}{power} s^{power}"), value, std]);
            }
        }
        if self.delay != 0.0 {
            let [delay, std] = cells(Some(self.delay), Some(self.delay_std));
            table.row(&["delay [s]".to_owned(), delay, std]);
        }
        writeln!(
            f,
            "\ntransfer function of order {}/{}, b(s)/a(s)\n{}",
            self.numerator.len() - 1,
            self.denominator.len() - 1,
            table.finish()
        )?;
        let mut roots = TextTable::new(&[
            ("", Align::Left),
            ("real [rad/s]", Align::Decimal),
            ("imaginary", Align::Decimal),
            ("std", Align::Decimal),
            ("frequency [Hz]", Align::Right),
            ("damping", Align::Right),
        ]);
        for (name, list) in [("pole", &self.fit.poles), ("zero", &self.fit.zeros)] {
            for root in list.iter().filter(|root| root.value.im >= 0.0) {
                let sign = if root.value.im > 0.0 { "+-" } else { "" };
                let [re, std] = cells(Some(root.value.re), Some(root.radius()));
                roots.row(&[
                    name.to_owned(),
                    re,
                    format!("{sign}{}", beside(root.value.im, Some(root.value.re), Some(root.radius()))),
                    std,
                    number(root.natural_frequency() / TAU),
                    number(root.damping()),
                ]);
            }
        }
        writeln!(
            f,
            "{}\nstatic gain {}; misfit {:.2} (1 is noise alone); |G/H - 1| {} median, {} at most; {} lines, condition number {}",
            roots.finish(),
            plus_minus(self.static_gain.value, self.static_gain.std),
            self.misfit,
            number(self.median_error),
            number(self.largest_error),
            self.lines,
            number(self.condition)
        )?;
        self.warnings.iter().try_for_each(|warning| writeln!(f, "warning: {warning}"))
    }
}
