//! The inertias of bodies, rounded to decimals and split among their links.
//!
//! A body of the model may be several links of the description. Links that are fixed to the moving one keep their inertias, and the
//! moving one gets the difference. Where no body has this difference, the moving link gets everything and the others nothing.
//!
//! Invariant of [`Parted`]: every link that is written is possible, and so is every body, proven with rationals on the decimals that
//! are written.

use crate::import::described::Described;
use crate::import::reading::NO_LENGTH;
use std::collections::BTreeMap;
use thiserror::Error;
use tpm_symbolic::mechanics::tree::AboutCentre;
use tpm_symbolic::number::rational::{self, Rational, integer, to_f64};

/// Digits of the written numbers. A double has two more, so that writing and reading one gives the same decimal.
const DIGITS: usize = 13;

/// Inertias of links as they are written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parted {
    /// The links with new inertias, by their names in the description.
    pub links: BTreeMap<String, AboutCentre>,
    /// Links whose inertia went over to the link that carries them, since no body has the difference.
    pub emptied: Vec<String>,
    /// The ten parameters of every body, by its name in the model, that follow from the written decimals.
    pub bodies: BTreeMap<String, [Rational; 10]>,
}

/// Why inertias cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SplitError {
    /// A parameter is not finite.
    #[error("a parameter of the body `{0}` is no finite number")]
    NotFinite(String),
    /// The inertia is not one that a body can have with the written number of digits.
    #[error("no body has the inertia of `{0}`, rounded to {DIGITS} digits")]
    Impossible(String),
}

impl Described {
    /// Rounds the inertias of bodies, by their names in the model, and splits them among links. Bodies without new values, and names of
    /// other bodies, are left out.
    ///
    /// # Errors
    /// [`SplitError`] where a body is not possible.
    pub fn split(&self, values: &BTreeMap<String, [f64; 10]>) -> Result<Parted, SplitError> {
        let mut parted = Parted::default();
        for (name, moving) in self.moving() {
            let Some(values) = values.get(name) else { continue };
            let mut exact: Vec<Rational> = Vec::with_capacity(10);
            for value in values {
                exact.push(rational::from_f64(*value).ok_or_else(|| SplitError::NotFinite(name.to_owned()))?);
            }
            let total: [Rational; 10] = std::array::from_fn(|k| exact[k].clone());
            let sum = |own: &[Rational; 10]| -> [Rational; 10] {
                std::array::from_fn(|k| {
                    &own[k] + moving.attached.iter().map(|(_, inertia)| inertia[k].clone()).sum::<Rational>()
                })
            };
            let fixed = sum(&std::array::from_fn(|_| integer(0)));
            let difference: [Rational; 10] = std::array::from_fn(|k| &total[k] - &fixed[k]);
            let body = |of: &[Rational; 10]| AboutCentre::of_parameters(of).is_some_and(|body| body.is_possible());
            let (own, all) = match written(&difference).filter(|own| body(&sum(&own.parameters()))) {
                Some(own) => {
                    let all = sum(&own.parameters());
                    (own, all)
                }
                None => {
                    let own = written(&total).ok_or_else(|| SplitError::Impossible(name.to_owned()))?;
                    for (link, _) in &moving.attached {
                        parted.links.insert(link.clone(), AboutCentre::nothing());
                        parted.emptied.push(link.clone());
                    }
                    let all = own.parameters();
                    (own, all)
                }
            };
            parted.links.insert(moving.link.clone(), own);
            parted.bodies.insert(name.to_owned(), all);
        }
        Ok(parted)
    }
}

/// Mass, centre and moments in decimals, as a description writes them, of the ten parameters of a body in the order of
/// [`NAMES`](tpm_symbolic::mechanics::tree::NAMES); `None` where no body has them.
#[must_use]
pub fn decimal(parameters: &[f64; 10]) -> Option<AboutCentre> {
    let exact: Option<Vec<Rational>> = parameters.iter().map(|value| rational::from_f64(*value)).collect();
    written(&exact?.try_into().ok()?)
}

/// The body in decimals; `None` where no body has them.
pub(super) fn written(parameters: &[Rational; 10]) -> Option<AboutCentre> {
    let AboutCentre { mass, centre, moments } = AboutCentre::of_parameters(parameters)?;
    let centre = centre.map(|place| if to_f64(&place).abs() < NO_LENGTH { integer(0) } else { place });
    let body = AboutCentre { mass: rounded(&mass)?, centre: all(&centre)?, moments: all(&moments)? };
    body.is_possible().then_some(body)
}

fn all<const N: usize>(values: &[Rational; N]) -> Option<[Rational; N]> {
    let found: Option<Vec<Rational>> = values.iter().map(rounded).collect();
    found?.try_into().ok()
}

/// The nearest decimal of [`DIGITS`] digits; `None` where the number is not in the range of doubles.
fn rounded(value: &Rational) -> Option<Rational> {
    rational::parse(&format!("{:.*e}", DIGITS - 1, to_f64(value)))
}

/// A decimal of [`DIGITS`] digits as text.
pub(super) fn text(value: &Rational) -> String {
    format!("{:?}", to_f64(value))
}
