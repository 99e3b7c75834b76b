//! Exported files, evaluated by a twin that knows nothing of plans: it reads the text of Python and of structured text, line by line.

use crate::c::{compiler, runs, say};
use crate::random::Random;
use crate::support::{estimator, models_in, outputs, parse, root, text_of};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;
use tpm_codegen::emit::estimator::{EmitError, EstimatorSource, Identified};
use tpm_codegen::export::{Exported, Format, Request, Told, export};
use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::number::rational::to_f64;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::straight_line::Plan;

/// Values by name; a scalar is a vector of length one.
type Known = BTreeMap<String, Vec<f64>>;

/// Reads an expression from left to right.
struct Twin<'a> {
    rest: &'a str,
    known: &'a Known,
}

impl Twin<'_> {
    fn of(text: &str, known: &Known) -> Vec<f64> {
        let mut twin = Twin { rest: text.trim(), known };
        let value = twin.sum();
        assert_eq!(twin.rest, "", "`{text}` is read to its end");
        value
    }

    fn take(&mut self, words: &[char]) -> Option<char> {
        self.rest = self.rest.trim_start();
        let first = self.rest.chars().next().filter(|first| words.contains(first))?;
        self.rest = &self.rest[1..];
        Some(first)
    }

    fn sum(&mut self) -> Vec<f64> {
        let mut value = self.product();
        while let Some(sign) = self.take(&['+', '-']) {
            let other = self.product()[0];
            value = vec![if sign == '+' { value[0] + other } else { value[0] - other }];
        }
        value
    }

    fn product(&mut self) -> Vec<f64> {
        let mut value = self.factor();
        while let Some(sign) = self.take(&['*', '/']) {
            let other = self.factor()[0];
            value = vec![if sign == '*' { value[0] * other } else { value[0] / other }];
        }
        value
    }

    fn factor(&mut self) -> Vec<f64> {
        if self.take(&['-']).is_some() {
            return vec![-self.factor()[0]];
        }
        if self.take(&['(']).is_some() {
            let value = self.sum();
            self.take(&[')']).expect("a closing parenthesis");
            return value;
        }
        let digit = self.rest.starts_with(|first: char| first.is_ascii_digit());
        let mut before = ' ';
        let end = self.rest.find(|letter: char| {
            let exponent = digit && "+-".contains(letter) && "eE".contains(before);
            before = letter;
            !(letter.is_ascii_alphanumeric() || "._".contains(letter) || exponent)
        });
        let (word, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        self.rest = rest;
        if digit {
            assert!(word.contains('.') || word.contains('e'), "{word} is no literal of a float");
            return vec![word.parse().expect("a number")];
        }
        if self.take(&['(']).is_some() {
            let mut arguments = vec![self.sum()];
            while self.take(&[',']).is_some() {
                arguments.push(self.sum());
            }
            self.take(&[')']).expect("a closing parenthesis");
            return called(word, &arguments);
        }
        let value = self.known.get(word).unwrap_or_else(|| panic!("`{word}` is not known")).clone();
        if self.take(&['[']).is_none() {
            return value;
        }
        let (index, rest) = self.rest.split_once(']').expect("an index");
        self.rest = rest;
        vec![value[index.parse::<usize>().expect("an index")]]
    }
}

fn called(word: &str, arguments: &[Vec<f64>]) -> Vec<f64> {
    let x = arguments[0][0];
    let name = word.rsplit(['.', '_']).next().expect("a name").to_lowercase();
    match name.as_str() {
        "vertcat" | "horzcat" => arguments.concat(),
        "solve" => solved(arguments[0].clone(), arguments[1].clone()),
        "atan2" => vec![x.atan2(arguments[1][0])],
        "fabs" => vec![x.abs()],
        "ln" => vec![x.ln()],
        other => {
            let all = [
                (Function::Sin, "sin"),
                (Function::Cos, "cos"),
                (Function::Tan, "tan"),
                (Function::Asin, "asin"),
                (Function::Acos, "acos"),
                (Function::Sqrt, "sqrt"),
                (Function::Tanh, "tanh"),
                (Function::Exp, "exp"),
                (Function::Log, "log"),
                (Function::Abs, "abs"),
                (Function::Sign, "sign"),
            ];
            let found = all.iter().find(|(_, name)| *name == other).unwrap_or_else(|| panic!("{word} is no function"));
            vec![found.0.apply(x)]
        }
    }
}

/// The solution of a square system, row by row.
fn solved(matrix: Vec<f64>, right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    let mut rows: Vec<Vec<f64>> =
        matrix.chunks(n).zip(&right).map(|(row, right)| row.iter().chain([right]).copied().collect()).collect();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs())).expect("a row");
        rows.swap(k, pivot);
        for i in (0..n).filter(|i| *i != k) {
            let share = rows[i][k] / rows[k][k];
            let pivot = rows[k].clone();
            rows[i].iter_mut().zip(&pivot).for_each(|(own, pivot)| *own -= share * pivot);
        }
    }
    (0..n).map(|k| rows[k][n] / rows[k][k]).collect()
}

/// What a function of the file in Python returns.
fn python(text: &str, name: &str, known: &Known) -> Option<Vec<f64>> {
    let (_, body) = text.split_once(&format!("\ndef _{name}():\n"))?;
    let mut known = known.clone();
    for line in body.lines() {
        if let Some(value) = line.strip_prefix(&format!("    return ca.Function(\"{name}\", [")) {
            let (_, value) = value.split_once("], [").expect("results");
            return Some(Twin::of(value.split_once("], [").expect("names").0, &known));
        }
        let (left, right) = line.trim().split_once(" = ").expect("an assignment");
        match right.strip_prefix("ca.SX.sym(\"") {
            // Symbols are arguments, whose lengths are those of the values.
            Some(size) => {
                let size = size.split_once(", ").expect("a size").1.trim_end_matches(')');
                assert_eq!(known[left].len().to_string(), size, "{left} in {name}");
            }
            None => drop(known.insert(left.to_owned(), Twin::of(right, &known))),
        }
    }
    panic!("{name} returns something")
}

/// What a block of the file in structured text gives, by name; inputs that are not known have the values that stand beside them.
fn block(text: &str, name: &str, known: &Known) -> Option<Known> {
    let (_, body) = text.split_once(&format!("\nFUNCTION_BLOCK {name}\n"))?;
    let body = body.split_once("END_FUNCTION_BLOCK").expect("an end").0;
    let mut known = known.clone();
    let (mut section, mut results) = ("", Vec::new());
    for line in body.lines().map(str::trim).filter(|line| !line.is_empty()) {
        match line {
            "VAR_INPUT" | "VAR_OUTPUT" | "VAR_TEMP" => section = line,
            "END_VAR" => section = "",
            _ if section.is_empty() => {
                let (left, right) =
                    line.strip_suffix(';').expect("a statement").split_once(" := ").expect("an assignment");
                let value = Twin::of(right, &known);
                known.insert(left.to_owned(), value);
            }
            _ => {
                let (declared, _) = line.split_once(';').expect("a declaration");
                let (name, kind) = declared.split_once(" : ").expect("a type");
                assert!(kind.starts_with("LREAL"), "{line}");
                if section == "VAR_OUTPUT" {
                    results.push(name.to_owned());
                }
                if let Some((_, value)) = kind.split_once(" := ") {
                    known.entry(name.to_owned()).or_insert_with(|| Twin::of(value, &Known::new()));
                }
            }
        }
    }
    Some(results.into_iter().map(|name| (name.clone(), known[&name].clone())).collect())
}

/// A model with values of its parameters.
struct Case {
    estimator: EstimatorSource,
    identified: Identified,
    theta: Vec<f64>,
    constants: Vec<f64>,
    random: Random,
}

impl Case {
    fn new(estimator: EstimatorSource, seed: u64) -> Self {
        let mut random = Random(seed);
        let theta: Vec<f64> = random.list(estimator.form.columns.len()).iter().map(|value| value.abs() + 0.5).collect();
        let symbols = &estimator.plan.evaluation.constants;
        let constants: Vec<f64> = random.list(symbols.len()).iter().map(|value| value.abs() + 0.25).collect();
        let columns = estimator.form.columns.iter().map(|own| own.name.to_string()).zip(theta.iter().copied());
        let known =
            symbols.iter().map(|own| estimator.model.quantity(*own).name.to_string()).zip(constants.iter().copied());
        let identified = Identified::of_values(&estimator.model.name, &columns.chain(known).collect());
        Self { estimator, identified, theta, constants, random }
    }

    fn export(&self, format: Format, told: &Told) -> Result<Exported, EmitError> {
        export(&self.estimator, format, &Request { identified: &self.identified, told, command: "tpm export" })
    }

    fn text(&self, format: Format) -> String {
        let exported = self.export(format, &Told::default()).unwrap_or_else(|error| panic!("{error}"));
        exported.files.into_iter().next().expect("a file").text
    }

    /// A motion by order, and the values of a plan there.
    fn motion(&mut self) -> Vec<Vec<f64>> {
        let coordinates = &self.estimator.plan.evaluation.coordinates;
        let highest = coordinates.iter().map(|(_, order)| *order).max().expect("a coordinate");
        let count = coordinates.len();
        (0..=highest).map(|_| self.random.list(count)).collect()
    }

    fn plan(&self, plan: &Plan, motion: &[Vec<f64>]) -> Vec<f64> {
        let evaluation = &self.estimator.plan.evaluation;
        outputs(plan, to_f64, Function::apply, |leaf| match *leaf {
            Leaf::Motion(coordinate, order) => {
                let place = evaluation.coordinates.iter().position(|(own, _)| *own == coordinate).expect("listed");
                motion[order as usize][place]
            }
            Leaf::Column(column) => self.theta[column],
            Leaf::Symbol(symbol) => {
                self.constants[evaluation.constants.iter().position(|own| *own == symbol).expect("a constant")]
            }
            _ => panic!("the dynamics do not read {leaf:?}"),
        })
    }

    fn python(&self, motion: &[Vec<f64>]) -> Known {
        let name = |order: usize| if order < 3 { format!("{}q", "d".repeat(order)) } else { format!("d{order}q") };
        let mut known: Known = motion.iter().enumerate().map(|(order, values)| (name(order), values.clone())).collect();
        known.insert("theta".to_owned(), self.theta.clone());
        known.insert("constants".to_owned(), self.constants.clone());
        known
    }
}

fn models() -> Vec<PathBuf> {
    ["models", "models/robots", "tests/fixtures/emit", "tests/fixtures/arms"].into_iter().flat_map(models_in).collect()
}

/// The same bits, or both no number.
fn same(found: &[f64], expected: &[f64], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (found, expected) in found.iter().zip(expected) {
        assert!(found == expected || found.is_nan() && expected.is_nan(), "{what}: {found} is not {expected}");
    }
}

#[test]
fn python_and_structured_text_of_every_model_give_what_its_plan_gives() {
    let (mut seen, mut accelerations) = (0, 0);
    for (seed, path) in (1..).zip(models()) {
        let mut case = Case::new(estimator(&path), seed);
        let (casadi, st) = (case.text(Format::Casadi), case.text(Format::StructuredText));
        let name = path.display().to_string();
        let own = case.estimator.plan.clone();
        let list = casadi.split_once("\nIDENTIFIED = [").expect("values").1.split_once(']').expect("an end").0;
        let values: Vec<f64> = list.split(", ").map(|value| value.parse().expect("a number")).collect();
        same(&values, &case.theta, &name);
        for _ in 0..3 {
            let motion = case.motion();
            let known = case.python(&motion);
            let forces = case.plan(&own.inverse_dynamics, &motion);
            same(&python(&casadi, "inverse_dynamics", &known).expect("a function"), &forces, &name);
            let found = python(&casadi, "feed_forward", &known);
            assert_eq!(found.is_some(), own.feed_forward.is_some(), "{name}");
            // Names of inputs of the blocks are checked where they are declared: their values stand in the order of the model.
            let blocks = st.split("\nFUNCTION_BLOCK ").nth(1).expect("a block");
            let block_name = blocks.lines().next().expect("a name");
            let mut inputs = Known::new();
            for line in blocks.split_once("END_VAR").expect("inputs").0.lines().skip(2) {
                let (name, rest) = line.trim().split_once(" : ").expect("a type");
                let told = rest.split_once("(* `").expect("a comment").1.split_once('`').expect("a name").0;
                let at = case.estimator.plan.evaluation.coordinates.iter().enumerate().find_map(|(place, (own, _))| {
                    let own = &case.estimator.model.coordinates[own.0 as usize].name;
                    let order = if told == own {
                        Some(0)
                    } else if told == format!("dot({own})") {
                        Some(1)
                    } else if told == format!("ddot({own})") {
                        Some(2)
                    } else {
                        told.strip_prefix(&format!("der({own}, "))
                            .map(|order| order.trim_end_matches(')').parse::<usize>().expect("an order"))
                    };
                    Some((place, order?))
                });
                if let Some((place, order)) = at.filter(|_| !rest.contains(" := ")) {
                    inputs.insert(name.to_owned(), vec![motion[order][place]]);
                }
            }
            let expected = own.feed_forward.as_ref().map_or(forces.clone(), |plan| case.plan(plan, &motion));
            if let Some(found) = found {
                same(&found, &expected, &name);
            }
            let results = block(&st, block_name, &inputs).expect("a block");
            let mut found: Vec<f64> = results.into_values().map(|value| value[0]).collect();
            let mut expected = expected;
            // Results are by name here.
            found.sort_by(f64::total_cmp);
            expected.sort_by(f64::total_cmp);
            same(&found, &expected, &name);
            seen += 1;
            // M a + h = B u: the accelerations of the inputs of a motion are those of the motion.
            let Some(inputs) = python(&casadi, "feed_forward", &known) else { continue };
            let known = known.into_iter().chain([("u".to_owned(), inputs)]).collect();
            let Some(found) = python(&casadi, "forward_dynamics", &known) else { continue };
            let highest = case.estimator.plan.evaluation.coordinates.iter().map(|(_, order)| *order as usize);
            let expected: Vec<f64> = highest.enumerate().map(|(place, order)| motion[order][place]).collect();
            if own.feed_forward.is_some() && case.estimator.form.rows.iter().all(|row| !row.inputs.is_empty()) {
                for (found, expected) in found.iter().zip(&expected) {
                    assert!(
                        (found - expected).abs() <= 1e-6 * (1.0 + expected.abs()),
                        "{name}: {found} is not {expected}"
                    );
                }
                accelerations += 1;
            }
        }
    }
    assert!(seen > 40 && accelerations > 20, "{seen} {accelerations}");
}

#[test]
fn friction_is_what_depends_on_velocities_alone_and_changes_its_sign_with_them() {
    let own = |text: &str, name: &str, rates: &[(&str, f64)]| {
        let case = Case::new(EstimatorSource::of(&parse(text)).expect("linear"), 3);
        let known = rates.iter().map(|(name, rate)| (format!("{name}_dot"), vec![*rate])).collect();
        let found = block(&case.text(Format::StructuredText), &format!("{name}_Friction"), &known);
        let found = found.map(|found| found.into_values().map(|value| value[0]).collect::<Vec<f64>>());
        let values: BTreeMap<String, f64> =
            case.identified.parameters.into_iter().map(|own| (own.name, own.value.expect("a value"))).collect();
        (found, move |name: &str| values[name])
    };
    let near = |found: Option<Vec<f64>>, expected: &[f64]| {
        let found = found.expect("friction");
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
        }
    };
    let (found, value) = own(&text_of("emps"), "Emps", &[("q", -0.5)]);
    near(found, &[-0.5 * value("Fv") - value("Fc")]);
    let (found, value) = own(&text_of("stribeck_pendulum"), "StribeckPendulum", &[("q", 0.25)]);
    let dry = value("fc") + value("fs") * (-(0.25_f64 / value("vs")).powi(2)).exp();
    // Kt/R = 1/24 N m/V; the known part of the damping is that of the back-EMF.
    near(found, &[24.0 * ((value("d") + 0.05 * 0.05 / 1.2) * 0.25 + dry)]);
    let (found, value) = own(&text_of("robots/planar_arm"), "PlanarArm", &[("q1", 2.0), ("q2", -1.0)]);
    near(found, &[2.0 * value("fv_q1") + value("fc_q1"), -value("fv_q2") - value("fc_q2")]);
    assert!(own(&text_of("mass_spring_drag"), "MassSpringDrag", &[]).0.is_none(), "drag by the square has no sign");
}

#[test]
fn identifiers_of_structured_text_differ_in_more_than_case_and_are_no_words_of_it() {
    let text = "model M { coordinate x; input U; parameter m, M, t_, T0, x_dot, lreal;
        m*ddot(x) + M*x + t_*dot(x) + T0*sin(x) + x_dot*cos(x)*sin(x)^2 + lreal*tanh(dot(x))*sin(x) = U; }";
    let case = Case::new(EstimatorSource::of(&parse(text)).expect("linear"), 1);
    let st = case.text(Format::StructuredText);
    let block = st
        .split_once("FUNCTION_BLOCK M_FeedForward")
        .expect("a block")
        .1
        .split_once("END_FUNCTION_BLOCK")
        .expect("an end")
        .0;
    let mut names: Vec<String> = block
        .lines()
        .filter_map(|line| line.trim().split_once(" : LREAL"))
        .map(|(name, _)| name.to_uppercase())
        .collect();
    let count = names.len();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), count, "{block}");
    assert!(!names.contains(&"T".to_owned()) && !names.contains(&"LREAL".to_owned()), "{names:?}");
    assert!(names.iter().all(|name| !name.ends_with('_') && !name.contains("__")), "{names:?}");
}

#[test]
fn what_a_result_says_against_itself_and_what_a_format_lacks_stands_in_the_files() {
    let told = Told::from_json(
        r#"{"shortfall": null, "warnings": ["fine", "far off"], "findings": [{"severity": "remark"}, {"severity": "distrust"}],
            "log": {"actuators": {"u": {"delay": 0.004, "low_pass": [50.0, 0.7], "bandwidth": null}, "v": {"delay": 0.0}}}}"#,
    );
    assert_eq!(told.shortfall.as_deref(), Some("far off"));
    assert_eq!(Told::from_json(r#"{"shortfall": "short"}"#).shortfall.as_deref(), Some("short"));
    assert_eq!(Told::from_json("m = 2"), Told::default());
    assert_eq!(told.actuators.len(), 1);
    let mut case = Case::new(EstimatorSource::of(&parse(&text_of("stribeck_pendulum"))).expect("linear"), 1);
    case.identified.parameters.retain(|own| own.name != "vs");
    for format in [Format::Casadi, Format::StructuredText, Format::Arduino] {
        let exported = case.export(format, &told).expect("a model");
        assert_eq!(exported.lost.len(), 2, "{:?}", exported.lost);
        let text: String =
            exported.files.iter().map(|file| file.text.replace("\n   ", " ").replace('\n', " ")).collect();
        for part in ["not trusted: far off", "a delay of 0.004 s", "a low pass of 50 rad/s", "the constant `vs`"] {
            assert!(text.contains(part), "{format:?}: {part}");
        }
    }
    case.identified.parameters.clear();
    assert!(case.export(Format::Casadi, &told).is_err());
}

/// The library is compiled and its example run, with a port that prints.
#[test]
fn the_library_for_arduino_compiles_and_prints_what_the_plan_gives() {
    let Some(c) = compiler().filter(|_| runs("c++")) else { return };
    let port = "#include <cmath>\n#include <cstdio>\nusing namespace std;\nstruct Port { void begin(long) {} void print(const char *text) { printf(\"%s\", text); }\n\
        void println(double value, int) { printf(\"%.9g\\n\", value); } } Serial;\nstatic unsigned long millis() { return 700; }\nstatic void delay(int) {}\n";
    for name in ["cart_pendulum", "stribeck_pendulum", "brushless_motor", "robots/planar_arm"] {
        let case = Case::new(estimator(&root().join("models").join(name).with_extension("tpm")), 5);
        let exported = case.export(Format::Arduino, &Told::default()).expect("a model");
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        for file in &exported.files {
            std::fs::create_dir_all(at(&file.name).parent().expect("a folder")).expect("writable");
            std::fs::write(at(&file.name), &file.text).expect("writable");
        }
        let properties = std::fs::read_to_string(at("library.properties")).expect("properties");
        for field in [
            "name=",
            "version=",
            "author=",
            "maintainer=",
            "sentence=",
            "paragraph=",
            "category=",
            "url=",
            "architectures=",
        ] {
            assert_eq!(properties.lines().filter(|line| line.starts_with(field)).count(), 1, "{field}");
        }
        let sketch = exported.files.iter().find(|file| file.name.ends_with(".ino")).expect("an example");
        std::fs::write(at("port.h"), port).expect("writable");
        std::fs::write(
            at("main.cpp"),
            format!("#include \"port.h\"\n{}\nint main() {{ setup(); loop(); }}\n", sketch.text),
        )
        .expect("writable");
        let source = exported.files.iter().find(|file| file.name.ends_with(".c")).expect("a source");
        let run = |program: &str, arguments: &[&str]| {
            let output = Command::new(program).current_dir(folder.path()).args(arguments).output().expect("it runs");
            assert!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
            String::from_utf8(output.stdout).expect("text")
        };
        run(c, &["-std=c99", "-Wall", "-Werror", "-c", &source.name, "-o", "own.o"]);
        run("c++", &["-std=c++11", "-Wall", "-Werror", "-Isrc", "main.cpp", "own.o", "-o", "main"]);
        let printed = run(at("main").to_str().expect("a path"), &[]);
        let found: Vec<f64> =
            printed.lines().map(|line| line.split_once(' ').expect("a name").1.parse().expect("a number")).collect();
        let (sine, cosine) = 0.7_f64.sin_cos();
        let count = case.estimator.plan.evaluation.coordinates.len();
        let motion = [sine, cosine, -sine].map(|value| vec![value; count]);
        let plan = case.estimator.plan.feed_forward.as_ref().unwrap_or(&case.estimator.plan.inverse_dynamics);
        let expected = case.plan(plan, &motion);
        assert_eq!(found.len(), expected.len(), "{printed}");
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() <= 1e-4 * (1.0 + expected.abs()), "{name}: {found} is not {expected}");
        }
        say(&format!("{name}: the example for Arduino printed {}", printed.trim().replace('\n', ", ")));
    }
}
