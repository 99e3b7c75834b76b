//! Which templates fit the columns of a log.

use crate::inspect::Inspection;
use crate::templates::catalogue::{TEMPLATES, Template};
use crate::templates::quantity::Quantity;
use serde::Serialize;

/// A signal of a model and the column that it is taken from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Placed {
    /// The model's name of the signal.
    pub signal: String,
    /// The log's column.
    pub column: String,
    /// The unit that the model has it in.
    pub unit: &'static str,
}

/// A template with the columns of a log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Proposal {
    /// The template.
    pub template: &'static Template,
    /// Its coordinates, then its input.
    pub signals: Vec<Placed>,
}

/// The templates that fit a log, with the columns that they would take: first those that leave fewest positions of the log unused, and
/// among these the ones that were made for its quantities. Nothing where no column may be a coordinate, or none an input.
#[must_use]
pub fn proposals(log: &Inspection) -> Vec<Proposal> {
    let columns: Vec<(&str, Quantity)> = log
        .channels
        .iter()
        .filter(|channel| !channel.constant)
        .map(|channel| (channel.name.as_str(), Quantity::of(&channel.name, channel.unit.as_deref())))
        .collect();
    let positions = columns.iter().filter(|(_, quantity)| quantity.is_position()).count();
    let mut fitting: Vec<(usize, bool, Proposal)> = TEMPLATES
        .iter()
        .filter_map(|template| {
            let unused = positions.saturating_sub(template.coordinates.len());
            let (angles, proposal) = fitted(template, &columns)?;
            Some((unused, angles, proposal))
        })
        .collect();
    fitting.sort_by_key(|(unused, angles, _)| (*unused, *angles));
    fitting.into_iter().map(|(_, _, proposal)| proposal).collect()
}

/// A template with the columns that fit it best, and whether its coordinates had to be angles instead.
fn fitted(template: &'static Template, columns: &[(&str, Quantity)]) -> Option<(bool, Proposal)> {
    let made_for: Vec<Quantity> = template.coordinates.iter().map(|(_, quantity)| *quantity).collect();
    let angles = vec![Quantity::Angle; made_for.len()];
    let angles = template.also_angles.then_some((true, angles));
    // Columns that say what they are count before those that may be anything.
    [Some((false, made_for)), angles]
        .into_iter()
        .flatten()
        .find_map(|(angles, wanted)| Some((angles, placed(template, columns, &wanted)?)))
}

/// A template whose coordinates are of these quantities.
fn placed(template: &'static Template, columns: &[(&str, Quantity)], wanted: &[Quantity]) -> Option<Proposal> {
    let input = input(columns, *wanted.first()?)?;
    let mut taken: Vec<usize> = Vec::new();
    for quantity in wanted {
        let free = |at: &usize| *at != input && !taken.contains(at);
        let first = |fits: &dyn Fn(Quantity) -> bool| (0..columns.len()).filter(free).find(|at| fits(columns[*at].1));
        let at = first(&|of| of == *quantity).or_else(|| first(&|of| of.may_be(*quantity)))?;
        taken.push(at);
    }
    let signal = |name: &str, at: usize, otherwise: Quantity| Placed {
        signal: name.to_owned(),
        column: columns[at].0.to_owned(),
        unit: columns[at].1.unit(otherwise),
    };
    let named = template.coordinates.iter().zip(wanted).zip(&taken);
    let mut signals: Vec<Placed> = named.map(|(((name, _), quantity), at)| signal(name, *at, *quantity)).collect();
    let natural = if wanted.first() == Some(&Quantity::Angle) { Quantity::Torque } else { Quantity::Force };
    signals.push(signal("u", input, natural));
    Some(Proposal { template, signals })
}

/// The column that is most likely the input of a coordinate: what moves such a coordinate by its unit, then what a motor is fed with, then
/// what is called an input, and at last a column of which nothing is known, the last of them.
fn input(columns: &[(&str, Quantity)], of: Quantity) -> Option<usize> {
    let order: &[Quantity] = if of == Quantity::Angle {
        &[Quantity::Torque, Quantity::Current, Quantity::Voltage, Quantity::Drive, Quantity::Force]
    } else {
        &[Quantity::Force, Quantity::Current, Quantity::Voltage, Quantity::Drive, Quantity::Torque]
    };
    let known = order.iter().find_map(|wanted| columns.iter().position(|(_, quantity)| quantity == wanted));
    known.or_else(|| columns.iter().rposition(|(_, quantity)| *quantity == Quantity::Unknown))
}

impl Proposal {
    /// The text of the model, which is called `name`.
    #[must_use]
    pub fn model(&self, name: &str) -> String {
        let units: Vec<&str> = self.signals.iter().map(|signal| signal.unit).collect();
        let (input, coordinates) = units.split_last().expect("invariant: a proposal has an input");
        self.template.filled(name, coordinates, input)
    }
}

impl Inspection {
    /// Whether the log may be one of an arm of joints: several angles, with an input for each.
    #[must_use]
    pub fn may_be_of_an_arm(&self) -> bool {
        let quantities = self.channels.iter().map(|channel| Quantity::of(&channel.name, channel.unit.as_deref()));
        let (mut angles, mut inputs) = (0, 0);
        for quantity in quantities {
            angles += usize::from(quantity.may_be(Quantity::Angle) && quantity != Quantity::Unknown);
            inputs += usize::from(quantity.drives());
        }
        angles > 1 && inputs > 1
    }
}
