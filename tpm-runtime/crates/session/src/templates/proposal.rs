//! Which templates fit the columns of a log.

use crate::inspect::Inspection;
use crate::templates::catalogue::{TEMPLATES, Template};
use crate::templates::quantity::Quantity;
use serde::Serialize;

/// A signal of a model and the column that it is taken from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Placed {
    /// The model's name of the signal; `dot(x)` for the rate of a coordinate.
    pub signal: String,
    /// The log's column.
    pub column: String,
    /// The unit that the model has the coordinate or the input in.
    pub unit: &'static str,
}

/// A template with the columns of a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Proposal {
    /// The template.
    pub template: &'static Template,
    /// Its coordinates, or their rates, then its input.
    pub signals: Vec<Placed>,
    /// Whether the log has the rates of the coordinates, and no position.
    pub by_rates: bool,
}

/// A column that changes.
struct Column<'a> {
    name: &'a str,
    quantity: Quantity,
    /// Of which quantity it is the rate, where its unit says so.
    rate_of: Option<Quantity>,
}

/// The templates that fit a log, with the columns that they would take: first those that leave fewest positions of the log unused, and
/// among these the ones that were made for its quantities. A log without positions may have rates in their place. Nothing where no column
/// may be a coordinate, or none an input.
#[must_use]
pub fn proposals(log: &Inspection) -> Vec<Proposal> {
    let columns: Vec<Column<'_>> = log
        .channels
        .iter()
        .filter(|channel| !channel.constant)
        .map(|channel| Column {
            name: channel.name.as_str(),
            quantity: Quantity::of(&channel.name, channel.unit.as_deref()),
            rate_of: channel.unit.as_deref().and_then(Quantity::of_rate),
        })
        .collect();
    let count = |fits: &dyn Fn(Quantity) -> bool| columns.iter().filter(|column| fits(column.quantity)).count();
    let (positions, rates) = (count(&Quantity::is_position), count(&|quantity| quantity == Quantity::Rate));
    let mut fitting: Vec<(usize, bool, Proposal)> = TEMPLATES
        .iter()
        .filter_map(|template| {
            let (angles, proposal) = fitted(template, &columns, positions == 0)?;
            let there = if proposal.by_rates { rates } else { positions };
            Some((there.saturating_sub(template.coordinates.len()), angles, proposal))
        })
        .collect();
    fitting.sort_by_key(|(unused, angles, _)| (*unused, *angles));
    fitting.into_iter().map(|(_, _, proposal)| proposal).collect()
}

/// A template with the columns that fit it best, and whether its coordinates had to be angles instead.
fn fitted(template: &'static Template, columns: &[Column<'_>], may_be_rates: bool) -> Option<(bool, Proposal)> {
    let made_for: Vec<Quantity> = template.coordinates.iter().map(|(_, quantity)| *quantity).collect();
    let angles = vec![Quantity::Angle; made_for.len()];
    let angles = template.also_angles.then_some((true, angles));
    let all: Vec<(bool, Vec<Quantity>)> = [Some((false, made_for)), angles].into_iter().flatten().collect();
    let by_rates = may_be_rates && template.text_by_rates.is_some();
    // Columns that say what they are count before those that may be anything.
    [Some(true).filter(|_| by_rates), Some(false)].into_iter().flatten().find_map(|by_rates| {
        let placed =
            |(angles, wanted): &(bool, Vec<Quantity>)| Some((*angles, placed(template, columns, wanted, by_rates)?));
        all.iter().find_map(placed)
    })
}

/// A template whose coordinates are of these quantities.
fn placed(
    template: &'static Template,
    columns: &[Column<'_>],
    wanted: &[Quantity],
    by_rates: bool,
) -> Option<Proposal> {
    let input = input(columns, *wanted.first()?)?;
    let mut taken: Vec<usize> = Vec::new();
    for quantity in wanted {
        // Coordinates of one quantity are subtracted from each other, and have one unit.
        let unit = |at: usize| columns[at].quantity.unit(*quantity);
        let alike =
            |at: usize| wanted.iter().zip(&taken).all(|(own, other)| own != quantity || unit(at) == unit(*other));
        let free = |at: &usize| *at != input && !taken.contains(at) && alike(*at);
        let first = |fits: &dyn Fn(&Column<'_>) -> bool| (0..columns.len()).filter(free).find(|at| fits(&columns[*at]));
        let at = if by_rates {
            let is_rate = |of: &Column<'_>| of.quantity == Quantity::Rate;
            first(&|of| is_rate(of) && of.rate_of == Some(*quantity))
                .or_else(|| first(&|of| is_rate(of) && of.rate_of.is_none()))?
        } else {
            first(&|of| of.quantity == *quantity).or_else(|| first(&|of| of.quantity.may_be(*quantity)))?
        };
        taken.push(at);
    }
    let signal = |name: String, at: usize, otherwise: Quantity| Placed {
        signal: name,
        column: columns[at].name.to_owned(),
        unit: columns[at].quantity.unit(otherwise),
    };
    let coordinate = |name: &str| if by_rates { format!("dot({name})") } else { name.to_owned() };
    let named = template.coordinates.iter().zip(wanted).zip(&taken);
    let mut signals: Vec<Placed> =
        named.map(|(((name, _), quantity), at)| signal(coordinate(name), *at, *quantity)).collect();
    let natural = if wanted.first() == Some(&Quantity::Angle) { Quantity::Torque } else { Quantity::Force };
    signals.push(signal("u".to_owned(), input, natural));
    Some(Proposal { template, signals, by_rates })
}

/// The column that is most likely the input of a coordinate: what moves such a coordinate by its unit, then what a motor is fed with, then
/// what is called an input, and at last a column of which nothing is known, the last of them.
fn input(columns: &[Column<'_>], of: Quantity) -> Option<usize> {
    let order: &[Quantity] = if of == Quantity::Angle {
        &[Quantity::Torque, Quantity::Current, Quantity::Voltage, Quantity::Drive, Quantity::Force]
    } else {
        &[Quantity::Force, Quantity::Current, Quantity::Voltage, Quantity::Drive, Quantity::Torque]
    };
    let known = order.iter().find_map(|wanted| columns.iter().position(|column| column.quantity == *wanted));
    known.or_else(|| columns.iter().rposition(|column| column.quantity == Quantity::Unknown))
}

impl Proposal {
    /// The text of the model, which is called `name`.
    #[must_use]
    pub fn model(&self, name: &str) -> String {
        let units: Vec<&str> = self.signals.iter().map(|signal| signal.unit).collect();
        let (input, coordinates) = units.split_last().expect("invariant: a proposal has an input");
        self.template.filled(name, coordinates, input, self.by_rates)
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
