//! `tpm fit`: a transfer function, or the physical parameters of a model, from the frequency response of a log.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::{by_name, number_assignment};
use crate::input::linear::tell_friction;
use crate::input::load::Loaded;
use crate::input::measured::{Measured, MeasuredArgs};
use crate::input::values::{ValueArgs, Values};
use crate::output::file;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_runtime::frequency::{
    Complex, Delay, FitWarning, OrderComparison, OrderTrial, RationalFit, RationalSettings, ResponseModel, Root,
    StructuredFit, StructuredSettings, compare_orders, fit_rational, fit_record, fit_structured,
};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::physical::LinearizedResponse;
use tpm_runtime::report::{Align, TextTable, beside, cells, number, or_dash, plus_minus};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::linear::linearize::{OperatingPoint, linearize};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational;

/// Options of `tpm fit`.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("what").required(true).multiple(true).args(["order", "model"])))]
#[command(group(clap::ArgGroup::new("of_model").multiple(true).args(["model", "beside"])))]
pub(crate) struct Args {
    #[command(flatten)]
    measured: MeasuredArgs,
    /// Degrees of numerator and denominator, such as 1/3; several, 1/3,2/4, are compared by predicting the other half of
    /// the log.
    #[arg(long, value_name = "M/N", value_delimiter = ',', value_parser = degrees)]
    order: Vec<(usize, usize)>,
    /// Fit to the transform of the whole record with its transient, instead of the averaged response: smaller errors where
    /// noise on the output is strong.
    #[arg(long, requires = "order", conflicts_with = "model")]
    whole: bool,
    /// A known dead time of the transfer function, s.
    #[arg(long, value_name = "SECONDS", requires = "order")]
    dead_time: Option<f64>,
    /// Fit a dead time as well, starting from --dead-time or 0.
    #[arg(long, requires = "order")]
    fit_dead_time: bool,
    /// Fit the parameters of this model, linearised at rest in 0; input and measured output are named as in it.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Put the transfer function of this model, linearised at rest in 0, beside what is fitted, in the plot too; input and
    /// measured output are named as in it, and its values are those of --params, --start and --constant.
    #[arg(long, value_name = "FILE")]
    beside: Option<PathBuf>,
    /// Start values of the parameters, and values of the constants, of the model: NAME = VALUE lines (.toml), or a result of
    /// `tpm identify --json` (.json).
    #[arg(long, value_name = "FILE", requires = "of_model")]
    params: Option<PathBuf>,
    /// Start value of a parameter of the model; goes before that of the file.
    #[arg(long, value_name = "NAME=VALUE", requires = "of_model", value_parser = number_assignment)]
    start: Vec<(String, f64)>,
    /// A parameter of the model that is held at a value.
    #[arg(long, value_name = "NAME=VALUE", requires = "model", value_parser = number_assignment)]
    freeze: Vec<(String, f64)>,
    /// Value of a constant that is known at run time only.
    #[arg(long = "constant", value_name = "NAME=VALUE", requires = "of_model", value_parser = number_assignment)]
    constants: Vec<(String, f64)>,
    /// Print JSON (tpm.fit/1).
    #[arg(long)]
    json: bool,
}

fn degrees(text: &str) -> Result<(usize, usize), String> {
    let parsed = text.split_once('/').and_then(|(m, n)| Some((m.trim().parse().ok()?, n.trim().parse().ok()?)));
    match parsed {
        Some((m, n)) if m <= 30 && n <= 30 => Ok((m, n)),
        Some(_) => Err(format!("`{text}`: degrees above 30 are not fitted")),
        None => Err(format!("`{text}` is not of the form M/N, such as 1/3")),
    }
}

/// A transfer function by angular frequency, rad/s.
type Drawn<'a> = Box<dyn Fn(f64) -> Complex + 'a>;

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let physical = args.model.as_deref().map(|path| Physical::load(args, path)).transpose()?;
    let beside = args.beside.as_deref().map(|path| Physical::load(args, path)).transpose()?;
    let measured = Measured::new(&args.measured)?;
    let mut text = measured.describe(&args.measured);
    let mut whole = json!({
        "schema": "tpm.fit/1", "input": args.measured.input, "output": args.measured.measured,
        "low_hz": measured.low, "high_hz": measured.high,
        "orders": [], "recommended": null, "rational": null, "model": null, "beside": null,
    });
    let mut incomplete = Vec::new();
    let rational = if args.order.is_empty() {
        None
    } else {
        Some(rational(args, &measured, &mut text, &mut whole, &mut incomplete)?)
    };
    let mut drawn: Vec<(String, Drawn<'_>)> = Vec::new();
    if let Some(fit) = &rational {
        drawn.push((format!("{}/{}", fit.function.numerator().len() - 1, fit.function.denominator().len() - 1), {
            let function = fit.function.clone();
            Box::new(move |w: f64| function.response(w))
        }));
    }
    if let Some(physical) = &physical {
        let response = physical.response()?;
        let fit = fit_structured(&measured.response, &response, &physical.settings(args, &measured))
            .map_err(|error| Failure::Input(error.to_string()))?;
        physical.describe(&fit, &mut text);
        whole["model"] = physical.json(&fit);
        if !fit.converged {
            incomplete.push("the minimisation ended before it converged; start nearer to the machine".to_owned());
        }
        if fit.rank < physical.free() {
            incomplete.push(format!(
                "the response determines {} independent combinations of {} free parameters; freeze some",
                fit.rank,
                physical.free()
            ));
        }
        let values: Vec<f64> = fit.parameters.iter().map(|parameter| parameter.value).collect();
        drawn.push((physical.model.name.clone(), Box::new(move |w: f64| physical.at(&response, &values, w))));
    }
    if let Some(beside) = &beside {
        let response = beside.response()?;
        let own = move |w: f64| beside.at(&response, &beside.start, w);
        let compared: &dyn Fn(f64) -> Complex = &*drawn.first().expect("invariant: something is fitted").1;
        let difference = Difference::new(&measured, compared, &own);
        text.push_str(&difference.text(&drawn[0].0, &beside.model.name));
        whole["beside"] = difference.json(&beside.model.name);
        drawn.push((format!("{}, given values", beside.model.name), Box::new(own)));
    }
    let unit = physical.as_ref().or(beside.as_ref()).and_then(Physical::unit);
    let named: Vec<_> = drawn.iter().map(|(name, model)| (name.as_str(), &**model as &dyn Fn(f64) -> _)).collect();
    measured.plot(&args.measured, &named, unit)?;
    if args.json {
        text = file::json(&whole)?;
    }
    file::emit(args.measured.output.as_deref(), &text)?;
    if incomplete.is_empty() { Ok(()) } else { Err(Failure::Incomplete(incomplete.join("\n"))) }
}

/// How far the transfer function of a model with given values lies from what was fitted, over the usable lines of the band.
struct Difference {
    median: f64,
    largest: f64,
}

impl Difference {
    fn new(measured: &Measured, fitted: &dyn Fn(f64) -> Complex, model: &dyn Fn(f64) -> Complex) -> Self {
        let lines = measured.response.band(measured.low, measured.high).filter(|line| line.usable);
        let mut all: Vec<f64> =
            lines.map(|line| (fitted(line.frequency) / model(line.frequency) - 1.0).norm()).collect();
        all.sort_by(f64::total_cmp);
        let of = |at: usize| all.get(at).copied().unwrap_or(f64::NAN);
        Self { median: of(all.len() / 2), largest: of(all.len().saturating_sub(1)) }
    }

    fn text(&self, fitted: &str, model: &str) -> String {
        format!(
            "\n{fitted} lies within {:.2} % (median) and {:.2} % (largest) of {model} with the given values\n",
            100.0 * self.median,
            100.0 * self.largest
        )
    }

    fn json(&self, model: &str) -> Value {
        json!({"name": model, "median_difference": finite(self.median), "largest_difference": finite(self.largest)})
    }
}

fn rational(
    args: &Args,
    measured: &Measured,
    text: &mut String,
    whole: &mut Value,
    incomplete: &mut Vec<String>,
) -> Result<RationalFit, Failure> {
    let delay = match (args.fit_dead_time, args.dead_time) {
        (true, start) => Delay::Free(start.unwrap_or(0.0)),
        (false, Some(delay)) => Delay::Fixed(delay),
        (false, None) => Delay::None,
    };
    let (m, n) = args.order[0];
    let settings = RationalSettings {
        delay,
        estimator: args.measured.estimator.into(),
        ..RationalSettings::new(m, n, measured.low, measured.high)
    };
    let fit = if args.order.len() == 1 {
        fit_rational(&measured.response, &settings).map_err(|error| Failure::Input(error.to_string()))?
    } else {
        let (input, output) = measured.signals();
        let welch = &measured.response.welch;
        let found = compare_orders(input, output, measured.log.sample_time, welch, &settings, &args.order)
            .map_err(|error| Failure::Input(error.to_string()))?;
        text.push_str(&compared(&found));
        whole["orders"] = found
            .trials
            .iter()
            .map(|trial| {
                json!({
                    "numerator": trial.numerator, "denominator": trial.denominator,
                    "validation": trial.validation, "worse_by": trial.worse_by, "doubtful": trial.doubtful(),
                    "fault": trial.fit.as_ref().err().map(ToString::to_string),
                })
            })
            .collect();
        let Some(best) = found.recommended.map(|at| found.trials[at].clone()) else {
            let mut faults: Vec<String> = found
                .trials
                .iter()
                .map(|trial| format!("{}/{}: {}", trial.numerator, trial.denominator, fault_of(trial, &found)))
                .collect();
            if welch.hold == Hold::None {
                faults.push(
                    "an input that was held from sample to sample bends the response: say so with --hold zoh"
                        .to_owned(),
                );
            }
            let said = if args.json { file::json(&*whole)? } else { text.clone() };
            file::emit(args.measured.output.as_deref(), &said)?;
            return Err(Failure::Incomplete(format!("none of the orders can be recommended\n{}", faults.join("\n"))));
        };
        whole["recommended"] = json!({"numerator": best.numerator, "denominator": best.denominator});
        best.fit.map_err(|error| Failure::Input(error.to_string()))?
    };
    let fit = if args.whole {
        let chosen = RationalSettings {
            numerator: fit.function.numerator().len() - 1,
            denominator: fit.function.denominator().len() - 1,
            ..settings
        };
        let (input, output) = measured.signals();
        fit_record(input, output, measured.log.sample_time, &measured.response.welch, &chosen)
            .map_err(|error| Failure::Input(error.to_string()))?
    } else {
        fit
    };
    text.push_str(&described(&fit));
    whole["rational"] = fit_json(&fit);
    let spoilt = |warning: &&FitWarning| warning.order_too_high() || matches!(warning, FitWarning::Unstable { .. });
    for warning in fit.warnings.iter().filter(spoilt) {
        incomplete.push(warning.to_string());
    }
    Ok(fit)
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
            Ok(fit) if trial.doubtful() => fit
                .warnings
                .iter()
                .find(|w| w.order_too_high() || matches!(w, FitWarning::Unstable { .. }))
                .map(ToString::to_string)
                .unwrap_or_default(),
            Ok(_) => String::new(),
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

fn described(fit: &RationalFit) -> String {
    let function = &fit.function;
    let mut table = TextTable::new(&[("coefficient", Align::Left), ("value", Align::Decimal), ("std", Align::Decimal)]);
    for (name, values, stds) in
        [("b", function.numerator(), &fit.numerator_std), ("a", function.denominator(), &fit.denominator_std)]
    {
        for (power, (value, std)) in values.iter().zip(stds).enumerate().rev() {
            let [value, std] = cells(Some(*value), Some(*std));
            table.row(&[format!("{name}{power} s^{power}"), value, std]);
        }
    }
    if function.delay() != 0.0 {
        let [delay, std] = cells(Some(function.delay()), Some(fit.delay_std));
        table.row(&["delay [s]".to_owned(), delay, std]);
    }
    let mut text = format!(
        "\ntransfer function of order {}/{}, b(s)/a(s)\n{}\n",
        function.numerator().len() - 1,
        function.denominator().len() - 1,
        table.finish()
    );
    let mut roots = TextTable::new(&[
        ("", Align::Left),
        ("real [rad/s]", Align::Decimal),
        ("imaginary", Align::Decimal),
        ("std", Align::Decimal),
        ("frequency [Hz]", Align::Right),
        ("damping", Align::Right),
    ]);
    for (name, list) in [("pole", &fit.poles), ("zero", &fit.zeros)] {
        for root in list.iter().filter(|root| root.value.im >= 0.0) {
            let sign = if root.value.im > 0.0 { "+-" } else { "" };
            let [re, std] = cells(Some(root.value.re), Some(root.radius()));
            roots.row(&[
                name.to_owned(),
                re,
                format!("{sign}{}", beside(root.value.im, Some(root.value.re), Some(root.radius()))),
                std,
                number(root.natural_frequency() / std::f64::consts::TAU),
                number(root.damping()),
            ]);
        }
    }
    text.push_str(&roots.finish());
    text.push_str(&format!(
        "\nstatic gain {}; misfit {:.2} (1 is noise alone); |G/H - 1| {} median, {} at most; {} lines, condition number {}\n",
        plus_minus(fit.static_gain.value, fit.static_gain.std),
        fit.misfit,
        number(fit.median_error),
        number(fit.largest_error),
        fit.lines,
        number(fit.condition)
    ));
    for warning in &fit.warnings {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}

/// A number for JSON, which has no infinity: a value that is not finite becomes null.
fn finite(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { Value::Null }
}

fn fit_json(fit: &RationalFit) -> Value {
    let list = |values: &[f64]| values.iter().map(|v| finite(*v)).collect::<Vec<_>>();
    let roots = |roots: &[Root]| -> Vec<Value> {
        roots
            .iter()
            .map(|root| {
                json!({"re": root.value.re, "im": root.value.im, "std_re": finite(root.std.re), "std_im": finite(root.std.im)})
            })
            .collect()
    };
    json!({
        "numerator": fit.function.numerator(), "numerator_std": list(&fit.numerator_std),
        "denominator": fit.function.denominator(), "denominator_std": list(&fit.denominator_std),
        "delay": fit.function.delay(), "delay_std": finite(fit.delay_std),
        "poles": roots(&fit.poles), "zeros": roots(&fit.zeros),
        "static_gain": {"value": finite(fit.static_gain.value), "std": finite(fit.static_gain.std)},
        "misfit": fit.misfit, "median_error": fit.median_error, "largest_error": fit.largest_error,
        "lines": fit.lines, "condition": finite(fit.condition),
        "warnings": fit.warnings.iter().map(ToString::to_string).collect::<Vec<_>>(),
    })
}

/// A model with the start values, fixed values and constants of its parameters.
struct Physical {
    model: ExactModel,
    linear: tpm_symbolic::linear::linearize::Linearization,
    input: Symbol,
    coordinate: tpm_symbolic::expr::graph::Coordinate,
    parameters: Vec<Symbol>,
    names: Vec<String>,
    start: Vec<f64>,
    frozen: Vec<bool>,
    constants: Vec<(Symbol, f64)>,
}

impl Physical {
    fn load(args: &Args, path: &Path) -> Result<Self, Failure> {
        let loaded = Loaded::from_file(path)?;
        let mut model = loaded.model().clone();
        let named = |symbols: Vec<Symbol>| -> Vec<String> {
            symbols.iter().map(|symbol| loaded.model().quantity(*symbol).name.to_string()).collect()
        };
        let parameters: Vec<Symbol> = model.parameters().collect();
        let run_time: Vec<Symbol> = model.run_time_constants().collect();
        let inputs: Vec<Symbol> = model.inputs().collect();
        let (names, constant_names, input_names) =
            (named(parameters.clone()), named(run_time.clone()), named(inputs.clone()));
        let starts = by_name("--start", &args.start, &names)?;
        let held = by_name("--freeze", &args.freeze, &names)?;
        let constants = by_name("--constant", &args.constants, &constant_names)?;
        let (mut from_file, mut known) = (BTreeMap::new(), BTreeMap::new());
        if let Some(file) = &args.params {
            let values = Values::load(&ValueArgs::file(file), &model)?;
            let of = |symbols: &[Symbol], names: &[String]| -> BTreeMap<String, f64> {
                let given = symbols.iter().zip(names).filter_map(|(symbol, name)| Some((name, values.get(*symbol)?)));
                given.map(|(name, value)| (name.clone(), rational::to_f64(value))).collect()
            };
            (from_file, known) = (of(&parameters, &names), of(&run_time, &constant_names));
        }
        from_file.extend(starts);
        known.extend(constants);
        let (starts, constants) = (from_file, known);
        let missing: Vec<String> = names
            .iter()
            .filter(|name| !starts.contains_key(*name) && !held.contains_key(*name))
            .map(|name| format!("--start {name}=VALUE"))
            .chain(
                constant_names.iter().filter(|n| !constants.contains_key(*n)).map(|n| format!("--constant {n}=VALUE")),
            )
            .collect();
        if !missing.is_empty() {
            return Err(Failure::Input(format!(
                "a fit of {} needs values to start from; give --params FILE, or {} (or --freeze for what is known)",
                model.name,
                missing.join(" ")
            )));
        }
        let input = input_names.iter().position(|name| *name == args.measured.input).ok_or_else(|| {
            Failure::Input(format!(
                "--input {}: the model has no such input; it has {}",
                args.measured.input,
                input_names.join(", ")
            ))
        })?;
        let coordinates: Vec<&str> = model.coordinates.iter().map(|c| c.name.as_str()).collect();
        let coordinate = coordinates.iter().position(|name| *name == args.measured.measured).ok_or_else(|| {
            Failure::Input(format!(
                "--measured {}: the model has no such coordinate; it has {}",
                args.measured.measured,
                coordinates.join(", ")
            ))
        })?;
        let linear = linearize(&mut model, &OperatingPoint::default())
            .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))?;
        tell_friction(&model, &linear);
        Ok(Physical {
            linear,
            input: inputs[input],
            coordinate: tpm_symbolic::expr::graph::Coordinate(coordinate as u32),
            start: names
                .iter()
                .map(|name| held.get(name).or_else(|| starts.get(name)).copied().unwrap_or(0.0))
                .collect(),
            frozen: names.iter().map(|name| held.contains_key(name)).collect(),
            constants: run_time.iter().zip(&constant_names).map(|(symbol, name)| (*symbol, constants[name])).collect(),
            parameters,
            names,
            model,
        })
    }

    fn free(&self) -> usize {
        self.frozen.iter().filter(|frozen| !**frozen).count()
    }

    fn response(&self) -> Result<LinearizedResponse<'_>, Failure> {
        let Physical { model, linear, coordinate, input, parameters, constants, .. } = self;
        LinearizedResponse::new(model, linear, *coordinate, *input, parameters, constants)
            .map_err(|error| Failure::Input(error.to_string()))
    }

    /// The response at an angular frequency in rad/s.
    fn at(&self, response: &LinearizedResponse<'_>, values: &[f64], frequency: f64) -> Complex {
        let mut out = [Complex::default()];
        response.responses(values, &[frequency], &mut out);
        out[0]
    }

    /// Unit of the measured output over that of the input, where both have one.
    fn unit(&self) -> Option<String> {
        let output = self.model.coordinates[self.coordinate.0 as usize].unit.as_ref()?;
        let input = self.model.quantity(self.input).unit.as_ref()?;
        // A unit of several factors stands in brackets.
        let whole = |unit: String| if unit.contains(['*', '/']) { format!("({unit})") } else { unit };
        Some(format!("{}/{}", whole(output.to_string()), whole(input.to_string())))
    }

    fn settings(&self, args: &Args, measured: &Measured) -> StructuredSettings {
        StructuredSettings {
            frozen: self.frozen.clone(),
            estimator: args.measured.estimator.into(),
            ..StructuredSettings::new(&self.start, measured.low, measured.high)
        }
    }

    fn describe(&self, fit: &StructuredFit, text: &mut String) {
        let mut table = TextTable::new(&[
            ("parameter", Align::Left),
            ("unit", Align::Left),
            ("start", Align::Right),
            ("fitted", Align::Decimal),
            ("std", Align::Decimal),
            ("", Align::Left),
        ]);
        for (i, name) in self.names.iter().enumerate() {
            let unit = self.model.quantity(self.parameters[i]).unit.as_ref().map(ToString::to_string);
            let found = fit.parameters[i];
            let ([value, std], remark) = if self.frozen[i] {
                (cells(Some(found.value), Some(0.0)), "frozen")
            } else if found.std.is_finite() {
                (cells(Some(found.value), Some(found.std)), "")
            } else {
                (cells(None, None), "unobservable")
            };
            table.row(&[name.clone(), unit.unwrap_or_default(), number(self.start[i]), value, std, remark.to_owned()]);
        }
        text.push_str(&format!("\nparameters of {}, linearised at rest\n{}", self.model.name, table.finish()));
        text.push_str(&format!(
            "\nrank {} of {}, condition number {}; misfit {:.2} (1 is noise alone); |G/H - 1| {} median, {} at most; {} lines\n",
            fit.rank,
            self.free(),
            number(fit.condition),
            fit.misfit,
            number(fit.median_error),
            number(fit.largest_error),
            fit.lines
        ));
        for direction in &fit.unobservable {
            text.push_str(&format!("the response does not change along {}\n", self.direction(direction)));
        }
        if !fit.converged {
            text.push_str("warning: the minimisation ended before it converged\n");
        }
        for gap in &fit.gaps {
            text.push_str(&format!("warning: {gap}\n"));
        }
    }

    /// A direction in the space of relative parameter changes, in words.
    fn direction(&self, direction: &[f64]) -> String {
        let largest = direction.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let terms: Vec<String> = self
            .names
            .iter()
            .zip(direction)
            .filter(|(_, share)| share.abs() > 1e-4 * largest)
            .map(|(name, share)| format!("{:+.3} {name}", share / largest))
            .collect();
        format!("{} (in multiples of the start values)", terms.join(" "))
    }

    fn json(&self, fit: &StructuredFit) -> Value {
        let parameters: Vec<Value> = self
            .names
            .iter()
            .enumerate()
            .map(|(i, name)| {
                let found = fit.parameters[i];
                let lost = !found.std.is_finite();
                json!({
                    "name": name,
                    "unit": self.model.quantity(self.parameters[i]).unit.as_ref().map(ToString::to_string),
                    "prior": self.start[i],
                    "value": if lost { Value::Null } else { json!(found.value) },
                    "std": finite(found.std),
                    "status": if self.frozen[i] { "frozen" } else if lost { "unobservable" } else { "identified" },
                })
            })
            .collect();
        let directions: Vec<Value> = fit
            .unobservable
            .iter()
            .map(|direction| self.names.iter().cloned().zip(direction.iter().map(|v| json!(v))).collect())
            .collect();
        json!({
            "name": self.model.name, "parameters": parameters, "unobservable": directions, "rank": fit.rank,
            "condition": finite(fit.condition), "misfit": fit.misfit, "median_error": fit.median_error,
            "largest_error": fit.largest_error, "lines": fit.lines, "converged": fit.converged,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::degrees;

    #[test]
    fn orders_are_two_degrees() {
        assert_eq!(degrees("1/3"), Ok((1, 3)));
        assert!(degrees("3").is_err() && degrees("a/b").is_err() && degrees("1/99").is_err());
    }
}
