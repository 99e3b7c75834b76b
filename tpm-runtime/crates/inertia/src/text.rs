//! Possible inertias and loads as text.

use crate::inertias::{Inertias, Origin};
use crate::load::Load;
use std::collections::BTreeMap;
use std::fmt;
use tpm_report::{Align, TextTable, beside, cells, combination, number, or_dash};

impl fmt::Display for Inertias {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "possible inertias of {}, every body proven with rationals on the decimals that are written\n",
            self.model
        )?;
        let head = [
            ("parameter", Align::Left),
            ("value", Align::Decimal),
            ("std. dev.", Align::Decimal),
            ("description", Align::Right),
            ("decided by", Align::Left),
        ];
        let mut table = TextTable::new(&head);
        for own in &self.parameters {
            let [value, std] = match own.std {
                Some(std) => cells(Some(own.value), Some(std)),
                None => [number(own.value), "-".to_owned()],
            };
            table.row(&[own.name.clone(), value, std, or_dash(own.description, number), own.origin.name().to_owned()]);
        }
        writeln!(f, "{}", table.finish())?;
        let mut moved = TextTable::new(&[
            ("what the data show", Align::Left),
            ("estimate", Align::Decimal),
            ("std. dev.", Align::Decimal),
            ("possible", Align::Decimal),
            ("moved", Align::Right),
        ]);
        for own in &self.combinations {
            let [value, std] = cells(Some(own.estimate), Some(own.std));
            let possible = beside(own.possible, Some(own.estimate), Some(own.std));
            let deviations = (own.possible - own.estimate) / own.std;
            moved.row(&[terms(&own.terms), value, std, possible, format!("{deviations:.2}")]);
        }
        writeln!(f, "{}", moved.finish())?;
        let decided = |origin: Origin| self.parameters.iter().filter(|own| own.origin == origin).count();
        writeln!(
            f,
            "decided by the data {}, by data and description {}, by the description {}; distance from the estimate {} deviations for {} \
             combinations",
            decided(Origin::Data),
            decided(Origin::Both),
            decided(Origin::Description),
            number(self.distance),
            self.combinations.len()
        )?;
        remarks(f, &self.remarks)
    }
}

impl fmt::Display for Load {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "load on {} of {}: centre of mass and moments about it along the axes of the body\n",
            self.body, self.model
        )?;
        let head = [
            ("parameter", Align::Left),
            ("unit", Align::Left),
            ("value", Align::Decimal),
            ("std. dev.", Align::Decimal),
            ("nearest possible", Align::Decimal),
        ];
        let mut table = TextTable::new(&head);
        for own in &self.parameters {
            let [value, std] = cells(own.value, own.std);
            table.row(&[own.name.to_owned(), own.unit.to_owned(), value, std, number(own.possible)]);
        }
        writeln!(f, "{}", table.finish())?;
        for direction in &self.unobservable {
            let terms = direction.terms.iter().map(|(name, weight)| ((*name).to_owned(), *weight)).collect();
            writeln!(f, "the results do not show the direction {}", self::terms(&terms))?;
        }
        remarks(f, &self.remarks)
    }
}

fn terms(weights: &BTreeMap<String, f64>) -> String {
    combination(&weights.iter().map(|(name, weight)| (name.clone(), weight.to_string())).collect())
}

fn remarks(f: &mut fmt::Formatter<'_>, remarks: &[String]) -> fmt::Result {
    remarks.iter().try_for_each(|remark| writeln!(f, "remark: {remark}"))
}
