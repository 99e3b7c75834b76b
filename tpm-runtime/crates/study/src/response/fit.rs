//! A transfer function, or the parameters of a model linearised at rest, fitted to the frequency response of a log.

use crate::response::fitted_model::{FittedModel, ModelResponse};
use crate::response::fitted_rational::{FittedRational, spoils};
use crate::response::measured::MeasuredResponse;
use serde::Serialize;
use std::fmt;
use thiserror::Error;
use tpm_frequency::{
    Complex, Delay, FitError, OrderComparison, OrderError, OrderTrial, RationalFit, RationalSettings, RecordFitError,
    ResponseEstimator, StructuredSettings, compare_orders, fit_rational, fit_record, fit_structured,
};
use tpm_physical::{LinearizedError, LinearizedResponse};
use tpm_plot::Figure;
use tpm_report::{Align, TextTable, or_dash};

/// What is fitted to a response.
#[derive(Debug)]
pub struct FitRequest<'a> {
    /// Degrees of numerator and denominator; several are compared by predicting the other half of the log.
    pub orders: &'a [(usize, usize)],
    /// Dead time of the transfer function.
    pub delay: Delay,
    /// Whether the transfer function is fitted to the transform of the whole record.
    pub whole: bool,
    /// A model whose parameters are fitted.
    pub model: Option<&'a ModelResponse>,
    /// A model with its start values, to be put beside what is fitted.
    pub beside: Option<&'a ModelResponse>,
    /// Which estimate of the response.
    pub estimator: ResponseEstimator,
}

/// Why nothing can be fitted.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ResponseFitError {
    /// A fit to the response has no solution.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The orders cannot be compared.
    #[error(transparent)]
    Order(#[from] OrderError),
    /// The whole record cannot be fitted.
    #[error(transparent)]
    Record(#[from] RecordFitError),
    /// A model has no response.
    #[error(transparent)]
    Model(#[from] LinearizedError),
}

/// What was fitted to a response. It is displayed as a text, and serialised as `tpm.fit/1`.
#[derive(Debug, Serialize)]
pub struct ResponseFit<'a> {
    schema: &'static str,
    input: &'a str,
    output: &'a str,
    low_hz: f64,
    high_hz: f64,
    orders: Vec<Trial>,
    recommended: Option<Order>,
    rational: Option<FittedRational>,
    model: Option<FittedModel>,
    beside: Option<Difference>,
    #[serde(skip)]
    measured: &'a MeasuredResponse,
    #[serde(skip)]
    comparison: Option<OrderComparison>,
    #[serde(skip)]
    figure: Option<Figure>,
}

#[derive(Debug, Serialize)]
struct Order {
    numerator: usize,
    denominator: usize,
}

#[derive(Debug, Serialize)]
struct Trial {
    numerator: usize,
    denominator: usize,
    validation: Option<f64>,
    worse_by: Option<f64>,
    doubtful: bool,
    fault: Option<String>,
}

/// How far the transfer function of a model with given values lies from what was fitted, over the usable lines of the band; null in JSON
/// where there is no line.
#[derive(Debug, Serialize)]
struct Difference {
    name: String,
    median_difference: f64,
    largest_difference: f64,
    #[serde(skip)]
    fitted: String,
}

/// A transfer function by angular frequency, rad/s.
type Function<'a> = Box<dyn Fn(f64) -> Complex + 'a>;

impl<'a> ResponseFit<'a> {
    /// Fits what is asked for. Where several orders are compared and none can be recommended, nothing else is fitted.
    ///
    /// # Errors
    /// [`ResponseFitError`] when a fit has no solution or a model has no response.
    pub fn new(measured: &'a MeasuredResponse, request: &FitRequest<'_>) -> Result<Self, ResponseFitError> {
        let mut found = Self {
            schema: "tpm.fit/1",
            input: &measured.input,
            output: &measured.output,
            low_hz: measured.low,
            high_hz: measured.high,
            orders: Vec::new(),
            recommended: None,
            rational: None,
            model: None,
            beside: None,
            measured,
            comparison: None,
            figure: None,
        };
        let mut drawn: Vec<(String, Function<'_>)> = Vec::new();
        if let Some(&first) = request.orders.first() {
            let Some(fit) = found.fit_orders(first, request)? else { return Ok(found) };
            let function = fit.function.clone();
            let name = format!("{}/{}", function.numerator().len() - 1, function.denominator().len() - 1);
            drawn.push((name, Box::new(move |w| function.response(w))));
            found.rational = Some(FittedRational::new(fit));
        }
        if let Some(physical) = request.model {
            let response = physical.response()?;
            let settings = StructuredSettings {
                frozen: physical.parameters.iter().map(|parameter| parameter.frozen).collect(),
                estimator: request.estimator,
                ..StructuredSettings::new(&physical.start(), measured.low, measured.high)
            };
            let fit = fit_structured(&measured.response, &response, &settings)?;
            let values: Vec<f64> = fit.parameters.iter().map(|parameter| parameter.value).collect();
            found.model = Some(FittedModel::new(physical, &fit));
            let name = physical.model.name.to_string();
            drawn.push((name, Box::new(move |w| at(&response, &values, w))));
        }
        if let Some(beside) = request.beside {
            let (response, start) = (beside.response()?, beside.start());
            let own = move |w: f64| at(&response, &start, w);
            let name = beside.model.name.to_string();
            let title = format!("{name}, given values");
            if let Some((fitted, function)) = drawn.first() {
                found.beside = Some(Difference::new(measured, (fitted, &**function), (name, &own)));
            }
            drawn.push((title, Box::new(own)));
        }
        let unit = request.model.or(request.beside).and_then(ModelResponse::unit);
        let named: Vec<_> = drawn.iter().map(|(name, model)| (name.as_str(), &**model as &dyn Fn(f64) -> _)).collect();
        found.figure = Some(measured.bode(&named, unit));
        Ok(found)
    }

    /// The transfer function of the orders; none where several are compared and none can be recommended.
    fn fit_orders(
        &mut self,
        (numerator, denominator): (usize, usize),
        request: &FitRequest<'_>,
    ) -> Result<Option<RationalFit>, ResponseFitError> {
        let measured = self.measured;
        let settings = RationalSettings {
            delay: request.delay,
            estimator: request.estimator,
            ..RationalSettings::new(numerator, denominator, measured.low, measured.high)
        };
        let (input, output) = measured.signals();
        let (sample_time, welch) = (measured.log.sample_time, &measured.response.welch);
        let fit = if request.orders.len() == 1 {
            fit_rational(&measured.response, &settings)?
        } else {
            let found = compare_orders(input, output, sample_time, welch, &settings, request.orders)?;
            self.orders = found.trials.iter().map(Trial::new).collect();
            let best = found.recommended.map(|at| found.trials[at].clone());
            self.comparison = Some(found);
            let Some(best) = best else { return Ok(None) };
            self.recommended = Some(Order { numerator: best.numerator, denominator: best.denominator });
            best.fit?
        };
        if !request.whole {
            return Ok(Some(fit));
        }
        let chosen = RationalSettings {
            numerator: fit.function.numerator().len() - 1,
            denominator: fit.function.denominator().len() - 1,
            ..settings
        };
        Ok(Some(fit_record(input, output, sample_time, welch, &chosen)?))
    }

    /// Why each of the compared orders cannot be recommended; none where one is, or nothing was compared.
    #[must_use]
    pub fn unrecommended(&self) -> Option<Vec<String>> {
        let found = self.comparison.as_ref().filter(|found| found.recommended.is_none())?;
        let fault =
            |trial: &OrderTrial| format!("{}/{}: {}", trial.numerator, trial.denominator, fault_of(trial, found));
        Some(found.trials.iter().map(fault).collect())
    }

    /// What the fits leave open, in sentences.
    #[must_use]
    pub fn incomplete(&self) -> Vec<String> {
        let rational = self.rational.iter().flat_map(FittedRational::doubts);
        rational.chain(self.model.iter().flat_map(FittedModel::doubts)).collect()
    }

    /// The Bode plot with what was fitted; none where no order can be recommended.
    #[must_use]
    pub fn figure(&self) -> Option<&Figure> {
        self.figure.as_ref()
    }
}

/// The response of a linearised model at an angular frequency, rad/s.
fn at(response: &LinearizedResponse<'_>, values: &[f64], frequency: f64) -> Complex {
    use tpm_frequency::ResponseModel as _;
    let mut out = [Complex::default()];
    response.responses(values, &[frequency], &mut out);
    out[0]
}

/// Why an order cannot be recommended.
fn fault_of(trial: &OrderTrial, found: &OrderComparison) -> String {
    let best = found.trials.iter().find(|other| other.worse_by == Some(0.0));
    match (&trial.fit, trial.worse_by.zip(best)) {
        (Err(fault), _) => fault.to_string(),
        (Ok(fit), _) if trial.doubtful() => {
            fit.warnings.iter().map(ToString::to_string).collect::<Vec<String>>().join("; ")
        }
        (Ok(_), Some((by, best))) => format!(
            "it predicts the other half of the log worse than {}/{}, by {by:.1} standard errors",
            best.numerator, best.denominator
        ),
        (Ok(_), None) => "it does not predict the other half of the log".to_owned(),
    }
}

impl Trial {
    fn new(trial: &OrderTrial) -> Self {
        Self {
            numerator: trial.numerator,
            denominator: trial.denominator,
            validation: trial.validation,
            worse_by: trial.worse_by,
            doubtful: trial.doubtful(),
            fault: trial.fit.as_ref().err().map(ToString::to_string),
        }
    }
}

impl Difference {
    fn new(
        measured: &MeasuredResponse,
        (fitted, function): (&str, &dyn Fn(f64) -> Complex),
        (name, model): (String, &dyn Fn(f64) -> Complex),
    ) -> Self {
        let lines = measured.response.band(measured.low, measured.high).filter(|line| line.usable);
        let mut all: Vec<f64> =
            lines.map(|line| (function(line.frequency) / model(line.frequency) - 1.0).norm()).collect();
        all.sort_by(f64::total_cmp);
        let of = |at: usize| all.get(at).copied().unwrap_or(f64::NAN);
        Self {
            name,
            median_difference: of(all.len() / 2),
            largest_difference: of(all.len().saturating_sub(1)),
            fitted: fitted.to_owned(),
        }
    }
}

impl fmt::Display for ResponseFit<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.measured)?;
        if let Some(found) = &self.comparison {
            f.write_str(&compared(found))?;
        }
        if let Some(rational) = &self.rational {
            write!(f, "{rational}")?;
        }
        if let Some(model) = &self.model {
            write!(f, "{model}")?;
        }
        if let Some(Difference { name, median_difference, largest_difference, fitted }) = &self.beside {
            let (median, largest) = (100.0 * median_difference, 100.0 * largest_difference);
            writeln!(
                f,
                "\n{fitted} lies within {median:.2} % (median) and {largest:.2} % (largest) of {name} with the given values"
            )?;
        }
        Ok(())
    }
}

fn compared(found: &OrderComparison) -> String {
    let mut table = TextTable::new(&[
        ("order", Align::Left),
        ("prediction", Align::Right),
        ("worse by", Align::Right),
        ("misfit", Align::Right),
        ("", Align::Left),
    ]);
    for (at, trial) in found.trials.iter().enumerate() {
        let or_none = |value: Option<f64>| or_dash(value, |v| format!("{v:.3}"));
        let remark = match &trial.fit {
            _ if found.recommended == Some(at) => "recommended".to_owned(),
            Err(fault) => fault.to_string(),
            Ok(fit) => fit.warnings.iter().find(|warning| spoils(warning)).map(ToString::to_string).unwrap_or_default(),
        };
        table.row(&[
            format!("{}/{}", trial.numerator, trial.denominator),
            or_none(trial.validation),
            or_none(trial.worse_by),
            or_none(trial.fit.as_ref().ok().map(|fit| fit.misfit)),
            remark,
        ]);
    }
    format!(
        "\n{}prediction: squared error of predicting the other half of the log over that of noise; worse by: standard errors\n",
        table.finish()
    )
}
