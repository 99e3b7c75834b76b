//! The parameters of a model as an identification knows them, read from its result.
//!
//! Data need not determine every parameter. They then leave directions n in parameter space undetermined, and determine
//! only the combinations w' theta with w' n = 0. A result states both. A quantity that does not change along the
//! undetermined directions can be computed from any parameters that satisfy the combinations; every other quantity
//! needs more than the data.
//!
//! Invariant of [`Settled`]: the parameters satisfy every combination of the result and keep stated priors, and
//! whatever is still undetermined is listed among the open directions. No value comes from another source.

use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{ExprId, Node};
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::regressor::form::{RegressorForm, Row, Term};

/// Smallest share of its terms at which a sum counts as nonzero. Below it the sum is the rounding of the nine digits in
/// a result.
const NOTHING: f64 = 1e-6;

/// Number of random motions at which a row is tested for changes along a direction.
const MOTIONS: usize = 32;

/// The schema of identification results.
pub const SCHEMA: &str = "tpm.identification/2";

/// The schema of parameters that were projected from those of another model.
pub const PROJECTION_SCHEMA: &str = "tpm.projection/1";

/// The schemas that can be read. Every field of the first one is in the second, and a projection has all fields that
/// are read.
pub const READABLE_SCHEMAS: [&str; 3] = ["tpm.identification/1", SCHEMA, PROJECTION_SCHEMA];

/// Weights by the name of a parameter.
pub type Weights = BTreeMap<String, f64>;

/// One parameter of a result.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IdentifiedParameter {
    /// Its name, as the columns of the model are named.
    pub name: String,
    /// The identified or held value; nothing where the data do not show the parameter.
    pub value: Option<f64>,
    /// Its standard deviation, where the data determine it.
    pub std: Option<f64>,
    /// The value that was stated before the identification.
    pub prior: Option<f64>,
    /// The value that follows from the combinations and the stated priors, for a parameter that the data do not
    /// determine.
    pub with_prior: Option<f64>,
    /// The status that the identification reports.
    pub status: String,
}

impl IdentifiedParameter {
    /// The stated prior of a parameter that the data do not determine. Results that do not tell stated priors from
    /// missing ones contain zero for a missing one, so that their zeros are ignored.
    #[must_use]
    pub fn stated(&self) -> Option<f64> {
        self.with_prior.or(self.prior.filter(|prior| *prior != 0.0))
    }
}

/// A combination of parameters that the data determine.
#[derive(Clone, Debug, PartialEq)]
pub struct IdentifiedCombination {
    /// The weight of every parameter in the combination.
    pub terms: Weights,
    /// Value of the weighted sum.
    pub value: f64,
    /// Standard deviation of the value.
    pub std: f64,
}

/// The result of an identification, as other programs read it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identified {
    /// Name of the model.
    pub model: String,
    /// The parameters in which the model is linear.
    pub parameters: Vec<IdentifiedParameter>,
    /// The physical parameters behind lumped ones; none where nothing was lumped.
    pub physical: Vec<IdentifiedParameter>,
    /// Directions that the data do not determine.
    pub directions: Vec<Weights>,
    /// Combinations of parameters that the data determine although they do not determine each parameter alone.
    pub combinations: Vec<IdentifiedCombination>,
    /// Covariance of the parameters, nothing for those that the data do not show; empty where it is not known.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// Covariance of every combination with all parameters, and then with all combinations; empty where it is not known.
    pub combination_covariance: Vec<Vec<Option<f64>>>,
    /// Of a model that lacks something, the values of the parameters with which it is nearest to the forces of its log; empty where it lacks
    /// nothing.
    pub nearest: Vec<f64>,
    /// By how much later than it is recorded an input acts beside these values, s, by the name of the input.
    pub delays: BTreeMap<String, f64>,
}

/// Why the result of an identification cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum IdentifiedError {
    /// The file does not have the schema of an identification result.
    #[error("the identified values are of none of the schemas that can be read, {known}: {0}", known = READABLE_SCHEMAS.join(", "))]
    Schema(String),
    /// The result belongs to another model.
    #[error("the identified values are of the model `{found}`, not of `{expected}`")]
    Model {
        /// The model in the file.
        found: String,
        /// The model that is emitted.
        expected: String,
    },
    /// A parameter has no value, and the result contains no combination that determines it.
    #[error("the parameter `{0}` has no identified value and no prior one; identify it, or give it a prior")]
    Missing(String),
    /// The equations change along a direction that the data do not show.
    #[error("the data do not show the direction {direction}, and {row} needs it (in {terms}); {}", remedy(.parameters))]
    NotShown {
        /// The direction.
        direction: String,
        /// The parameters with a component along the direction.
        parameters: Vec<String>,
        /// Name of the row that changes along it.
        row: String,
        /// The functions of the motion by which the direction is multiplied in this row.
        terms: String,
    },
}

/// The outputs of a plan; nothing for those that depend on a leaf without a value.
pub(crate) fn evaluated(plan: &Plan, leaf: impl Fn(&Leaf) -> Option<f64>) -> Vec<Option<f64>> {
    let mut values: Vec<Option<f64>> = Vec::with_capacity(plan.ops.len());
    for op in &plan.ops {
        let at = |slot: &Slot| values[slot.index()];
        let both = |a: &Slot, b: &Slot, of: fn(f64, f64) -> f64| Some(of(at(a)?, at(b)?));
        let value = match op {
            Op::Constant(value) => Some(rational::to_f64(value)),
            Op::Pi => Some(std::f64::consts::PI),
            Op::Load(index) => leaf(&plan.inputs[*index as usize]),
            Op::Add(a, b) => both(a, b, |a, b| a + b),
            Op::Sub(a, b) => both(a, b, |a, b| a - b),
            Op::Mul(a, b) => both(a, b, |a, b| a * b),
            Op::Div(a, b) => both(a, b, |a, b| a / b),
            Op::Atan2(a, b) => both(a, b, f64::atan2),
            Op::Neg(a) => at(a).map(|a| -a),
            Op::Function(function, a) => at(a).map(|a| function.apply(a)),
        };
        values.push(value);
    }
    plan.outputs.iter().map(|slot| values[slot.index()]).collect()
}

/// The remedy where a direction is needed that the data do not determine.
#[must_use]
pub fn remedy(parameters: &[String]) -> String {
    format!("identify from data that show it, or state a prior of {} there, or hold one of them", parameters.join(", "))
}

/// Source of the value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// The data determine it, or it was held constant.
    Shown,
    /// It follows from stated priors and from the combinations that the data determine.
    Prior,
    /// It is undetermined: the combinations hold with this value, and also with others.
    Open,
}

/// A parameter with a value to compute with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettledParameter<'a> {
    /// The parameter.
    pub parameter: &'a IdentifiedParameter,
    /// A value with which all combinations hold.
    pub value: f64,
    /// Source of the value.
    pub standing: Standing,
}

/// Values for the parameters of a result.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled<'a> {
    /// The parameters in which the model is linear, in the order of the result.
    pub parameters: Vec<SettledParameter<'a>>,
    /// The directions that neither data nor stated priors determine, each scaled so that its largest component is one.
    pub open: Vec<Weights>,
}

impl Settled<'_> {
    /// The value of a parameter.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<f64> {
        self.parameters.iter().find(|settled| settled.parameter.name == name).map(|settled| settled.value)
    }
}

impl Identified {
    /// An identification result that consists of given values of parameters, by name.
    #[must_use]
    pub fn of_values(model: &str, values: &BTreeMap<String, f64>) -> Self {
        let parameter = |(name, value): (&String, &f64)| IdentifiedParameter {
            name: name.clone(),
            value: Some(*value),
            ..IdentifiedParameter::default()
        };
        Self { model: model.to_owned(), parameters: values.iter().map(parameter).collect(), ..Self::default() }
    }

    /// The same result with values of the columns that are sums and products of given parameters, where it does not name them itself.
    #[must_use]
    pub fn with_sums(&self, model: &ExactModel, form: &RegressorForm, lumping: Option<&Plan>) -> Self {
        let mut whole = self.clone();
        let given = |name: &str| {
            let lists = self.parameters.iter().chain(&self.physical);
            lists.filter(|parameter| parameter.name == name).find_map(|parameter| parameter.value)
        };
        let values = lumping.map(|plan| {
            evaluated(plan, |leaf| match leaf {
                Leaf::Symbol(symbol) => given(&model.quantity(*symbol).name),
                _ => None,
            })
        });
        for (column, value) in form.columns.iter().zip(values.into_iter().flatten()) {
            if let Some(value) = value
                && self.parameters.iter().all(|parameter| parameter.name != column.name)
            {
                let parameter =
                    IdentifiedParameter { name: column.name.to_string(), value: Some(value), ..Default::default() };
                whole.parameters.push(parameter);
            }
        }
        whole
    }

    /// A value for every parameter: the identified one, or one with which all combinations hold and stated priors are
    /// kept.
    ///
    /// # Errors
    /// [`IdentifiedError::Missing`] where the result states neither a value of a parameter nor enough combinations.
    pub fn settled(&self) -> Result<Settled<'_>, IdentifiedError> {
        let hidden: Vec<&IdentifiedParameter> =
            self.parameters.iter().filter(|parameter| parameter.value.is_none()).collect();
        let open = open(&self.directions, |name| hidden.iter().any(|p| p.name == name && p.stated().is_some()));
        let named = |parameter: &IdentifiedParameter| self.directions.iter().any(|d| d.contains_key(&parameter.name));
        if let Some(missing) = hidden.iter().find(|parameter| parameter.stated().is_none() && !named(parameter)) {
            return Err(IdentifiedError::Missing(missing.name.clone()));
        }
        // A complete result has as many combinations of hidden parameters as the undetermined directions leave.
        let told = self.combinations.len() + self.directions.len();
        if let Some(name) = open.first().and_then(|direction| direction.keys().next())
            && told < hidden.iter().filter(|parameter| named(parameter)).count()
        {
            return Err(IdentifiedError::Missing(name.clone()));
        }
        let values = self.completed(&hidden);
        let settled = self.parameters.iter().map(|parameter| match parameter.value {
            Some(value) => SettledParameter { parameter, value, standing: Standing::Shown },
            None => {
                let is_open = open.iter().any(|direction| direction.contains_key(&parameter.name));
                let standing = if is_open { Standing::Open } else { Standing::Prior };
                SettledParameter { parameter, value: values[parameter.name.as_str()], standing }
            }
        });
        let parameters = settled.collect();
        Ok(Settled { parameters, open })
    }

    /// Values of hidden parameters: their stated priors with the smallest change that satisfies the combinations.
    fn completed<'a>(&self, hidden: &[&'a IdentifiedParameter]) -> BTreeMap<&'a str, f64> {
        let mut values: BTreeMap<&str, f64> =
            hidden.iter().map(|parameter| (parameter.name.as_str(), parameter.stated().unwrap_or(0.0))).collect();
        let known = |name: &str| self.parameters.iter().find(|p| p.name == name).and_then(|p| p.value).unwrap_or(0.0);
        // Values that the result has already combined with the priors are kept.
        let free: Vec<&str> =
            hidden.iter().filter(|p| p.with_prior.is_none()).map(|parameter| parameter.name.as_str()).collect();
        let scale: Vec<f64> =
            free.iter().map(|name| values[name].abs()).map(|s| if s > 0.0 { s } else { 1.0 }).collect();
        let weight = |terms: &Weights, name: &str| terms.get(name).copied().unwrap_or(0.0);
        let rows: Vec<Vec<f64>> = (self.combinations.iter())
            .map(|shown| free.iter().zip(&scale).map(|(name, scale)| weight(&shown.terms, name) * scale).collect())
            .collect();
        let short = |shown: &IdentifiedCombination| {
            let now = |(name, weight): (&String, &f64)| {
                weight * values.get(name.as_str()).copied().unwrap_or_else(|| known(name))
            };
            shown.value - shown.terms.iter().map(now).sum::<f64>()
        };
        let right: Vec<f64> = self.combinations.iter().map(short).collect();
        // The smallest scaled change: rows' y, where (rows rows') y = right.
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut square: Vec<Vec<f64>> = rows.iter().map(|a| rows.iter().map(|b| dot(a, b)).collect()).collect();
        let y = solve(&mut square, right);
        for (j, (name, scale)) in free.iter().zip(&scale).enumerate() {
            let change: f64 = rows.iter().zip(&y).map(|(row, y)| row[j] * y).sum();
            *values.entry(name).or_default() += scale * change;
        }
        values
    }

    /// One value per column of a regressor form, in its order, where the rows of the form do not depend on undetermined
    /// directions.
    ///
    /// # Errors
    /// [`IdentifiedError::Model`], [`IdentifiedError::Missing`]; [`IdentifiedError::NotShown`] where a row changes along a
    /// direction that neither data nor stated priors determine.
    pub fn in_order(
        &self,
        model: &ExactModel,
        form: &RegressorForm,
    ) -> Result<Vec<SettledParameter<'_>>, IdentifiedError> {
        if self.model != model.name {
            return Err(IdentifiedError::Model { found: self.model.clone(), expected: model.name.clone() });
        }
        let Settled { parameters, open } = self.settled()?;
        let find = |name: &str| {
            let found = parameters.iter().find(|settled| settled.parameter.name == *name);
            found.copied().ok_or_else(|| IdentifiedError::Missing(name.to_owned()))
        };
        let ordered = form.columns.iter().map(|column| find(&column.name)).collect::<Result<_, _>>()?;
        for direction in &open {
            let weights: Vec<f64> =
                form.columns.iter().map(|column| direction.get(column.name.as_str()).copied().unwrap_or(0.0)).collect();
            if let Some((row, terms)) = form.rows.iter().find_map(|row| Some((row, moved(model, row, &weights)?))) {
                return Err(IdentifiedError::NotShown {
                    direction: display(direction),
                    parameters: direction.keys().cloned().collect(),
                    row: row.name.to_string(),
                    terms,
                });
            }
        }
        Ok(ordered)
    }

    /// The documentation of the emitted values, as Markdown.
    pub(crate) fn about(&self, values: &[SettledParameter<'_>]) -> String {
        let mut about = String::from(
            "The identified parameters.\n\n| parameter | value | standard deviation | |\n|---|---|---|---|\n",
        );
        for SettledParameter { parameter, value, .. } in values {
            let std = parameter.std.map_or_else(|| "unknown".to_owned(), |std| format!("{std:.3e}"));
            about.push_str(&format!("| `{}` | {value} | {std} | {} |\n", parameter.name, parameter.status));
        }
        let of = |standing: Standing| {
            let names = values.iter().filter(move |settled| settled.standing == standing);
            names.map(|settled| format!("`{}`", settled.parameter.name)).collect::<Vec<_>>().join(", ")
        };
        let (prior, open) = (of(Standing::Prior), of(Standing::Open));
        if !prior.is_empty() {
            about.push_str(&format!(
                "\nPrior, not identified: {prior}. The data do not show these parameters; their values follow from priors that \
                 were stated and from the combinations that the data show.\n"
            ));
        }
        if !open.is_empty() {
            about.push_str(&format!(
                "\nOpen, not identified: {open}. The data do not show these parameters, and no equation needs more of them than \
                 the combinations that the data show. The values are one choice of many with which the combinations hold.\n"
            ));
        }
        if !self.combinations.is_empty() && values.iter().any(|settled| settled.standing != Standing::Shown) {
            about.push_str("\n| what the data show of them | value | standard deviation |\n|---|---|---|\n");
            for shown in &self.combinations {
                about.push_str(&format!("| `{}` | {} | {:.3e} |\n", display(&shown.terms), shown.value, shown.std));
            }
        }
        about
    }

    /// Reads the JSON that `tpm identify --json` prints.
    ///
    /// # Errors
    /// When the text is not of a readable schema.
    #[cfg(feature = "generate")]
    pub fn from_json(text: &str) -> Result<Self, IdentifiedError> {
        #[derive(serde::Deserialize)]
        struct File {
            schema: String,
            model: String,
            parameters: Vec<Parameter>,
            #[serde(default)]
            physical: Vec<Parameter>,
            #[serde(default)]
            unobservable: Vec<BTreeMap<String, String>>,
            #[serde(default)]
            combinations: Vec<Combination>,
            #[serde(default)]
            covariance: Vec<Vec<Option<f64>>>,
            #[serde(default)]
            combination_covariance: Vec<Vec<Option<f64>>>,
            log: Option<Log>,
        }
        #[derive(serde::Deserialize)]
        struct Log {
            prediction: Option<Prediction>,
        }
        #[derive(serde::Deserialize)]
        struct Prediction {
            stated: Stated,
            #[serde(default)]
            delays: BTreeMap<String, f64>,
        }
        #[derive(serde::Deserialize)]
        struct Stated {
            values: Vec<f64>,
        }
        #[derive(serde::Deserialize)]
        struct Parameter {
            name: String,
            #[serde(default)]
            prior: Option<f64>,
            #[serde(default)]
            with_prior: Option<f64>,
            value: Option<f64>,
            #[serde(default)]
            std: Option<f64>,
            #[serde(default)]
            status: String,
        }
        #[derive(serde::Deserialize)]
        struct Combination {
            terms: BTreeMap<String, String>,
            value: f64,
            std: f64,
        }
        let fault = |error: serde_json::Error| IdentifiedError::Schema(error.to_string());
        let file: File = serde_json::from_str(text).map_err(fault)?;
        if !READABLE_SCHEMAS.contains(&file.schema.as_str()) {
            return Err(IdentifiedError::Schema(format!("it says `{}`", file.schema)));
        }
        let parameters = |list: Vec<Parameter>| -> Vec<IdentifiedParameter> {
            let read = list.into_iter().map(|Parameter { name, prior, with_prior, value, std, status }| {
                IdentifiedParameter { name, value, std, prior, with_prior, status }
            });
            read.collect()
        };
        let weights = |terms: BTreeMap<String, String>| -> Result<Weights, IdentifiedError> {
            let weight = |(name, text): (String, String)| match text.parse::<f64>() {
                Ok(weight) if weight.is_finite() => Ok((name, weight)),
                _ => Err(IdentifiedError::Schema(format!("the weight `{text}` of `{name}` is not a number"))),
            };
            terms.into_iter().map(weight).collect()
        };
        let combination = |shown: Combination| {
            Ok(IdentifiedCombination { terms: weights(shown.terms)?, value: shown.value, std: shown.std })
        };
        let prediction = file.log.and_then(|log| log.prediction);
        let (nearest, delays) = prediction.map(|found| (found.stated.values, found.delays)).unwrap_or_default();
        Ok(Self {
            model: file.model,
            parameters: parameters(file.parameters),
            physical: parameters(file.physical),
            directions: file.unobservable.into_iter().map(weights).collect::<Result<_, _>>()?,
            combinations: file.combinations.into_iter().map(combination).collect::<Result<_, _>>()?,
            covariance: file.covariance,
            combination_covariance: file.combination_covariance,
            nearest,
            delays,
        })
    }

    /// The same result with the values with which a model that lacks something predicts its log best, in place of those that hold beside what
    /// it lacks; nothing where it lacks nothing. They are one set of values with which the rows come out so, and leave nothing open.
    #[must_use]
    pub fn nearest_to_forces(&self) -> Option<Self> {
        if self.nearest.is_empty() || self.nearest.len() != self.parameters.len() {
            return None;
        }
        let own = self.parameters.iter().zip(&self.nearest);
        let parameters = own.map(|(own, value)| IdentifiedParameter { value: Some(*value), ..own.clone() }).collect();
        Some(Self { model: self.model.clone(), parameters, covariance: self.covariance.clone(), ..Self::default() })
    }
}

impl From<&Identified> for Identified {
    fn from(identified: &Identified) -> Self {
        identified.clone()
    }
}

/// A basis of those directions in the given span in which no settled parameter has a component.
#[must_use]
pub fn open(directions: &[Weights], settled: impl Fn(&str) -> bool) -> Vec<Weights> {
    let mut left: Vec<Weights> = directions.to_vec();
    let names: BTreeSet<String> = directions.iter().flat_map(BTreeMap::keys).cloned().collect();
    for name in names.iter().filter(|name| settled(name)) {
        let share = |direction: &Weights| direction.get(name).copied().unwrap_or(0.0);
        let largest = (0..left.len()).max_by(|&a, &b| share(&left[a]).abs().total_cmp(&share(&left[b]).abs()));
        let Some(pivot) = largest.filter(|&index| share(&left[index]) != 0.0) else { continue };
        let pivot = left.swap_remove(pivot);
        for direction in &mut left {
            let factor = share(direction) / share(&pivot);
            for (other, weight) in &pivot {
                let (before, less) = (direction.get(other).copied().unwrap_or(0.0), factor * weight);
                let left = before - less;
                let nothing = other == name || left.abs() <= NOTHING * before.abs().max(less.abs());
                if nothing {
                    direction.remove(other)
                } else {
                    direction.insert(other.clone(), left)
                };
            }
        }
    }
    left.into_iter().map(largest_one).collect()
}

/// The direction, scaled so that its largest component is one.
fn largest_one(mut direction: Weights) -> Weights {
    let largest = direction.values().copied().fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
    direction.retain(|_, weight| *weight != 0.0);
    direction.values_mut().for_each(|weight| *weight /= largest);
    direction
}

/// Solves a symmetric system that may be singular; unknowns that it leaves undetermined are zero.
fn solve(square: &mut [Vec<f64>], mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    let size = (0..n).map(|i| square[i][i]).fold(0.0, f64::max);
    let mut pivots: Vec<usize> = Vec::with_capacity(n);
    for _ in 0..n {
        let rest = (0..n).filter(|i| !pivots.contains(i));
        let Some(pivot) = rest.max_by(|&a, &b| square[a][a].total_cmp(&square[b][b])) else { break };
        if square[pivot][pivot] <= 1e-12 * size {
            break;
        }
        pivots.push(pivot);
        let (by, of_pivot) = (square[pivot].clone(), right[pivot]);
        for (row, (equation, right)) in square.iter_mut().zip(&mut right).enumerate() {
            if row != pivot {
                let factor = equation[pivot] / by[pivot];
                equation.iter_mut().zip(&by).for_each(|(entry, by)| *entry -= factor * by);
                *right -= factor * of_pivot;
            }
        }
    }
    (0..n).map(|i| if pivots.contains(&i) { right[i] / square[i][i] } else { 0.0 }).collect()
}

/// The functions of the motion by which a row changes along a direction, as text; nothing for a row that does not
/// change.
///
/// The row is evaluated at pseudo-random motions, at which identities between functions of the motion hold as
/// everywhere.
fn moved(model: &ExactModel, row: &Row, weights: &[f64]) -> Option<String> {
    let along = |term: &Term| term.column.map(|column| weights[column]).filter(|weight| *weight != 0.0);
    let terms: Vec<(&Monomial<ExprId>, f64)> = (row.terms.iter())
        .filter_map(|term| Some((&term.atoms, along(term)? * rational::to_f64(&term.coefficient))))
        .collect();
    let share = |motion: usize| -> Option<f64> {
        let leaf = |node: &Node| match node {
            Node::Symbol(symbol) => match &model.quantity(*symbol).kind {
                Kind::Constant { value: Some(value) } => rational::to_f64(value),
                _ => drawn(motion, symbol.0 as usize),
            },
            Node::Derivative(coordinate, order) => {
                drawn(motion, model.symbols.len() + 16 * coordinate.0 as usize + *order as usize)
            }
            _ => f64::NAN,
        };
        let parts: Vec<f64> = (terms.iter())
            .map(|(atoms, factor)| {
                atoms.factors().fold(*factor, |product, (&atom, e)| product * model.graph.evaluate(atom, leaf).powi(e))
            })
            .collect();
        let (sum, size) =
            parts.iter().fold((0.0, 0.0), |(sum, size): (f64, f64), part| (sum + part, size + part.abs()));
        // A motion at which the row has no finite value is ignored.
        (size.is_finite() && size > 0.0).then(|| sum.abs() / size)
    };
    let shares: Vec<f64> = (0..MOTIONS).filter_map(share).collect();
    let changes = !terms.is_empty() && (shares.is_empty() || shares.iter().any(|share| *share > NOTHING));
    let text = |atoms: &&Monomial<ExprId>| {
        let factor = |(atom, exponent): (&ExprId, i32)| {
            let text = model.display(*atom);
            if exponent == 1 { text } else { format!("{text}^{exponent}") }
        };
        let factors: Vec<String> = atoms.factors().map(factor).collect();
        if factors.is_empty() { "a constant term".to_owned() } else { factors.join("*") }
    };
    changes.then(|| {
        let functions: BTreeSet<&Monomial<ExprId>> = terms.iter().map(|(atoms, _)| *atoms).collect();
        functions.iter().map(text).collect::<Vec<_>>().join(", ")
    })
}

/// Component `index` of a pseudo-random motion, between -2 and 2: multiples of irrational numbers modulo one.
fn drawn(motion: usize, index: usize) -> f64 {
    let turns = (motion as f64 + 1.0) * std::f64::consts::SQRT_2 + (index as f64 + 1.0) * std::f64::consts::E;
    let scattered = turns * (1.0 + index as f64 * std::f64::consts::PI);
    4.0 * scattered.fract() - 2.0
}

/// A combination for reading, such as `0.5 m - J`.
#[must_use]
pub fn display(weights: &Weights) -> String {
    let mut text = String::new();
    for (name, weight) in weights {
        text.push_str(match (text.is_empty(), *weight < 0.0) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        });
        // Six digits, as the shortest text of the rounded number.
        let size = format!("{:.5e}", weight.abs()).parse::<f64>().unwrap_or_else(|_| weight.abs());
        text.push_str(&if size == 1.0 { name.clone() } else { format!("{size} {name}") });
    }
    text
}

#[cfg(test)]
mod tests {
    use super::{Identified, IdentifiedCombination, IdentifiedParameter, Standing, Weights, display, open};

    fn weights(terms: &[(&str, f64)]) -> Weights {
        terms.iter().map(|(name, weight)| ((*name).to_owned(), *weight)).collect()
    }

    fn hidden(name: &str, prior: Option<f64>, with_prior: Option<f64>) -> IdentifiedParameter {
        IdentifiedParameter { name: name.to_owned(), prior, with_prior, ..IdentifiedParameter::default() }
    }

    /// Data that determine only a + 2 b = 5.
    fn sum_of(a: IdentifiedParameter, b: IdentifiedParameter) -> Identified {
        Identified {
            model: "M".to_owned(),
            parameters: vec![a, b],
            directions: vec![weights(&[("a", 1.0), ("b", -0.5)])],
            combinations: vec![IdentifiedCombination {
                terms: weights(&[("a", 1.0), ("b", 2.0)]),
                value: 5.0,
                std: 0.1,
            }],
            ..Identified::default()
        }
    }

    #[test]
    fn combinations_hold_whatever_was_stated() {
        let cases = [
            (hidden("a", None, None), hidden("b", None, None), Standing::Open, None),
            // A zero that was not stated is ignored; a zero that was combined with the result counts.
            (hidden("a", Some(0.0), None), hidden("b", Some(0.0), None), Standing::Open, None),
            (hidden("a", Some(0.0), Some(0.0)), hidden("b", None, Some(2.5)), Standing::Prior, Some((0.0, 2.5))),
            (hidden("a", Some(1.0), None), hidden("b", Some(1.0), None), Standing::Prior, None),
        ];
        for (a, b, standing, expected) in cases {
            let result = sum_of(a, b);
            let settled = result.settled().expect("everything is told");
            let [a, b] = [0, 1].map(|i| settled.parameters[i].value);
            assert!((a + 2.0 * b - 5.0).abs() < 1e-12, "{settled:?}");
            assert!(expected.is_none_or(|expected| (a, b) == expected), "{settled:?}");
            assert!(settled.parameters.iter().all(|one| one.standing == standing), "{settled:?}");
            assert_eq!(settled.open.len(), usize::from(standing == Standing::Open));
        }
    }

    #[test]
    fn a_combination_that_is_not_told_is_not_made_up() {
        let mut result = sum_of(hidden("a", None, None), hidden("b", None, None));
        result.combinations.clear();
        assert!(result.settled().is_err());
    }

    #[test]
    fn stated_parameters_close_directions() {
        let directions = [weights(&[("a", 1.0), ("b", 1.0)]), weights(&[("b", 1.0), ("c", -0.5)])];
        assert_eq!(open(&directions, |_| false).len(), 2);
        let left = open(&directions, |name| name == "b");
        assert_eq!(left.iter().map(display).collect::<Vec<_>>(), ["a + 0.5 c"]);
        assert!(open(&directions, |name| name != "a").is_empty());
    }
}
