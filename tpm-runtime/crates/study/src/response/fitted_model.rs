//! Parameters of a model, linearised at rest, fitted to a response.

use crate::by_name::by_name;
use serde::Serialize;
use std::fmt;
use tpm_frequency::StructuredFit;
use tpm_physical::{LinearizedError, LinearizedResponse};
use tpm_report::{Align, TextTable, cells, number};
use tpm_symbolic::expr::graph::{Coordinate, Symbol};
use tpm_symbolic::linear::linearize::Linearization;
use tpm_symbolic::mechanics::model::ExactModel;

/// Shares of a direction below this share of the largest one are not told.
const SMALLEST_SHARE: f64 = 1e-4;

/// A linearised model from one input to one coordinate, with values of its parameters and constants.
#[derive(Debug)]
pub struct ModelResponse {
    /// The model.
    pub model: ExactModel,
    /// Its linearisation.
    pub linear: Linearization,
    /// The input.
    pub input: Symbol,
    /// The measured coordinate.
    pub coordinate: Coordinate,
    /// All parameters of the model, in its order.
    pub parameters: Vec<StartedParameter>,
    /// Values of the constants that are known at run time.
    pub constants: Vec<(Symbol, f64)>,
}

/// A parameter to be fitted.
#[derive(Clone, Debug)]
pub struct StartedParameter {
    /// Its symbol in the model.
    pub symbol: Symbol,
    /// Its name.
    pub name: String,
    /// Where the fit starts.
    pub start: f64,
    /// Whether the parameter is held at this value.
    pub frozen: bool,
}

impl ModelResponse {
    /// Start values of all parameters.
    pub(super) fn start(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.start).collect()
    }

    pub(super) fn response(&self) -> Result<LinearizedResponse<'_>, LinearizedError> {
        let symbols: Vec<Symbol> = self.parameters.iter().map(|parameter| parameter.symbol).collect();
        let Self { model, linear, coordinate, input, constants, .. } = self;
        LinearizedResponse::new(model, linear, *coordinate, *input, &symbols, constants)
    }

    /// Unit of the measured output over that of the input, where both have one.
    pub(super) fn unit(&self) -> Option<String> {
        let output = self.model.coordinates[self.coordinate.0 as usize].unit.as_ref()?;
        let input = self.model.quantity(self.input).unit.as_ref()?;
        // A unit of several factors stands in brackets.
        let whole = |unit: String| if unit.contains(['*', '/']) { format!("({unit})") } else { unit };
        Some(format!("{}/{}", whole(output.to_string()), whole(input.to_string())))
    }
}

/// A fitted model.
#[derive(Debug, Serialize)]
pub(super) struct FittedModel {
    name: String,
    parameters: Vec<FittedParameter>,
    unobservable: Vec<Direction>,
    rank: usize,
    condition: f64,
    misfit: f64,
    median_error: f64,
    largest_error: f64,
    lines: usize,
    converged: bool,
    /// Number of parameters that are not held.
    #[serde(skip)]
    free: usize,
    #[serde(skip)]
    gaps: Vec<String>,
}

#[derive(Debug, Serialize)]
struct FittedParameter {
    name: String,
    unit: Option<String>,
    prior: f64,
    value: Option<f64>,
    std: Option<f64>,
    status: &'static str,
}

/// A direction in the space of relative changes of the parameters, by their names.
#[derive(Debug, Serialize)]
struct Direction(#[serde(serialize_with = "by_name")] Vec<(String, f64)>);

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let largest = self.0.iter().fold(0.0_f64, |m, (_, share)| m.max(share.abs()));
        let told = self.0.iter().filter(|(_, share)| share.abs() > SMALLEST_SHARE * largest);
        let terms: Vec<String> = told.map(|(name, share)| format!("{:+.3} {name}", share / largest)).collect();
        write!(f, "{} (in multiples of the start values)", terms.join(" "))
    }
}

impl FittedModel {
    pub(super) fn new(physical: &ModelResponse, fit: &StructuredFit) -> Self {
        let parameters = physical.parameters.iter().zip(&fit.parameters).map(|(own, found)| {
            let is_shown = found.std.is_finite();
            FittedParameter {
                name: own.name.clone(),
                unit: physical.model.quantity(own.symbol).unit.as_ref().map(ToString::to_string),
                prior: own.start,
                value: is_shown.then_some(found.value),
                std: is_shown.then_some(found.std),
                status: match (own.frozen, is_shown) {
                    (true, _) => "frozen",
                    (false, true) => "identified",
                    (false, false) => "unobservable",
                },
            }
        });
        let named = |direction: &Vec<f64>| {
            let names = physical.parameters.iter().map(|parameter| parameter.name.clone());
            Direction(names.zip(direction.iter().copied()).collect())
        };
        Self {
            name: physical.model.name.to_string(),
            parameters: parameters.collect(),
            unobservable: fit.unobservable.iter().map(named).collect(),
            rank: fit.rank,
            condition: fit.condition,
            misfit: fit.misfit,
            median_error: fit.median_error,
            largest_error: fit.largest_error,
            lines: fit.lines,
            converged: fit.converged,
            free: physical.parameters.iter().filter(|parameter| !parameter.frozen).count(),
            gaps: fit.gaps.iter().map(ToString::to_string).collect(),
        }
    }

    /// Why the values cannot be relied on.
    pub(super) fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        if !self.converged {
            doubts.push("the minimisation ended before it converged; start nearer to the machine".to_owned());
        }
        if self.rank < self.free {
            doubts.push(format!(
                "the response determines {} independent combinations of {} free parameters; freeze some",
                self.rank, self.free
            ));
        }
        doubts
    }
}

impl fmt::Display for FittedModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = TextTable::new(&[
            ("parameter", Align::Left),
            ("unit", Align::Left),
            ("start", Align::Right),
            ("fitted", Align::Decimal),
            ("std", Align::Decimal),
            ("", Align::Left),
        ]);
        for own in &self.parameters {
            let (value, std) = if own.status == "frozen" { (Some(own.prior), Some(0.0)) } else { (own.value, own.std) };
            let [value, std] = cells(value, std);
            let remark = if own.status == "identified" { "" } else { own.status };
            let unit = own.unit.clone().unwrap_or_default();
            table.row(&[own.name.clone(), unit, number(own.prior), value, std, remark.to_owned()]);
        }
        writeln!(
            f,
            "\nparameters of {}, linearised at rest\n{}\nrank {} of {}, condition number {}; misfit {:.2} (1 is noise alone); |G/H - 1| {} median, {} at most; {} lines",
            self.name,
            table.finish(),
            self.rank,
            self.free,
            number(self.condition),
            self.misfit,
            number(self.median_error),
            number(self.largest_error),
            self.lines
        )?;
        for direction in &self.unobservable {
            writeln!(f, "the response does not change along {direction}")?;
        }
        if !self.converged {
            f.write_str("warning: the minimisation ended before it converged\n")?;
        }
        self.gaps.iter().try_for_each(|gap| writeln!(f, "warning: {gap}"))
    }
}
