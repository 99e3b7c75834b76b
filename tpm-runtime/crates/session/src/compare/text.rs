//! A comparison as people read it.

use crate::compare::comparison::{Comparison, Difference, Family, Verdict};
use std::fmt::{self, Write as _};
use tpm_report::{Align, TextTable, cells, digits, or_dash, plus_minus};

/// Significant digits of a joint test's statistic.
const CHI_SQUARED_DIGITS: usize = 4;

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "A: model {}; B: model {}\n", self.model_a, self.model_b)?;
        f.write_str(&table("parameter", &self.linear))?;
        if let Some(physical) = &self.physical {
            write!(f, "\nphysical parameters\n{}", table("parameter", physical))?;
        }
        writeln!(
            f,
            "\nB - A of independent results; z: difference in its deviations; p: how often chance alone makes one as large;\n\
             Holm: p corrected for all {} {} made here; below {} it counts as a change",
            self.tests,
            if self.tests == 1 { "test" } else { "tests" },
            self.level
        )?;
        for (which, family) in ["parameters", "physical parameters"].iter().zip(self.families()) {
            f.write_str(&notes(which, family))?;
        }
        writeln!(f, "\n{}", self.in_words())?;
        for warning in &self.warnings {
            writeln!(f, "warning: {warning}")?;
        }
        Ok(())
    }
}

impl Comparison {
    /// The verdict in words.
    #[must_use]
    pub fn in_words(&self) -> String {
        match self.verdict {
            Verdict::NoDifference => "no difference that the data show".to_owned(),
            Verdict::ChangedTogether => {
                let mut text = "the results differ, but no parameter alone does".to_owned();
                for direction in self.families().filter_map(|family| family.direction.as_ref()) {
                    text.push_str(&format!("; what changed is {}", direction.combination));
                }
                text
            }
            Verdict::Changed => {
                let entries = self.families().flat_map(|family| &family.differences);
                let mut said: Vec<&str> = Vec::new();
                let mut text = String::new();
                for entry in entries.filter(|entry| entry.changed) {
                    // A parameter that is not lumped stands in both families.
                    if !said.contains(&entry.name.as_str()) {
                        said.push(&entry.name);
                        text.push_str(&format!(
                            "{}{}",
                            if text.is_empty() { "changed: " } else { "; " },
                            change(entry)
                        ));
                    }
                }
                text
            }
        }
    }
}

impl Difference {
    /// How it changed, such as `m by 0.50012 +- 0.00016 kg (+25.0 %)`.
    pub(crate) fn in_words(&self) -> String {
        change(self)
    }
}

fn change(entry: &Difference) -> String {
    let by = match (entry.difference, entry.std) {
        (Some(difference), Some(std)) => plus_minus(difference, std),
        _ => "-".to_owned(),
    };
    let mut text = format!("{} by {by}", entry.name);
    if let Some(unit) = entry.unit.as_deref().filter(|unit| *unit != "1") {
        text.push_str(&format!(" {unit}"));
    }
    if let (Some(from), Some(difference)) = (entry.a.value.filter(|value| *value != 0.0), entry.difference) {
        text.push_str(&format!(" ({:+.3} %)", 100.0 * difference / from.abs()));
    }
    text
}

fn table(of: &str, family: &Family) -> String {
    let mut table = TextTable::new(&[
        (of, Align::Left),
        ("unit", Align::Left),
        ("A", Align::Decimal),
        ("std. dev.", Align::Decimal),
        ("B", Align::Decimal),
        ("std. dev.", Align::Decimal),
        ("B - A", Align::Decimal),
        ("std. dev.", Align::Decimal),
        ("z", Align::Right),
        ("p", Align::Right),
        ("Holm", Align::Right),
        ("", Align::Left),
    ]);
    for entry in &family.differences {
        let [a, of_a] = cells(entry.a.value, entry.a.std);
        let [b, of_b] = cells(entry.b.value, entry.b.std);
        let [difference, std] = cells(entry.difference, entry.std);
        let remark = match &entry.untested {
            Some(why) => why.clone(),
            None if entry.changed => "changed".to_owned(),
            None => String::new(),
        };
        table.row(&[
            entry.name.clone(),
            entry.unit.as_deref().unwrap_or("-").to_owned(),
            a,
            of_a,
            b,
            of_b,
            difference,
            std,
            or_dash(entry.z, |z| format!("{z:+.2}")),
            or_dash(entry.p, probability),
            or_dash(entry.p_adjusted, probability),
            remark,
        ]);
    }
    table.finish()
}

/// The joint test of a family, the direction of its change, and what is in one result only.
fn notes(which: &str, family: &Family) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    if let Some((joint, adjusted)) = family.joint.as_ref().and_then(|joint| Some((joint, joint.p_adjusted?))) {
        let _ = writeln!(
            text,
            "all {which} together: chi-squared {} with {} degrees of freedom, p {}, Holm {}",
            digits(joint.chi_squared, CHI_SQUARED_DIGITS),
            joint.degrees_of_freedom,
            probability(joint.p),
            probability(adjusted)
        );
    }
    if let Some(direction) = &family.direction {
        let unit =
            direction.unit.as_deref().filter(|unit| *unit != "1").map_or_else(String::new, |unit| format!(" {unit}"));
        let _ = writeln!(
            text,
            "{which} are correlated, up to {:.3}; {} changed by the most deviations: by {}{unit}, z {:+.2}",
            direction.correlation,
            direction.combination,
            plus_minus(direction.difference, direction.std),
            direction.z
        );
    }
    for (only, result) in [(&family.only_in_a, "A"), (&family.only_in_b, "B")] {
        if !only.is_empty() {
            let _ = writeln!(text, "{which} of {result} alone, not compared: {}", only.join(", "));
        }
    }
    text
}

fn probability(p: f64) -> String {
    tpm_report::probability(p, |p| digits(p, 2))
}
