//! Pages of many results, right and wrong: no sentence of a page contradicts another, and all of them say what the result says.
//!
//! The machines are shipped models, simulated, and an arm along tones that do not repeat. What is wrong with a result is made by the question: a parameter held at zero is a term that
//! the model lacks, an input of the other sign a swapped cable, a spring in two parts what no motion can tell apart.

use crate::support::root;
use roxmltree::{Document, Node, ParsingOptions};
use serde_json::Value;
use tpm_runtime::campaign::samples_text;
use tpm_runtime::document::{Document as Page, Issue};
use tpm_runtime::estimate::Refine;
use tpm_runtime::experiment::written_value;
use tpm_runtime::session::{
    DeclaredModel, ExperimentRequest, Identifiable as _, Identification, LogRequest, Session, StoredResult, Validation,
    compare, evidence, from_log, validate,
};

/// What is changed of the experiment of every machine.
const CHANGES: [(&str, &str); 1] = [("schedule.measure_time", "6.0")];
/// Machines that are simulated: the model's name, and the seeds of its logs. The nonlinear parameter of the pendulum is looked for by
/// simulation, which takes seconds a page.
const MACHINES: [(&str, &[&str]); 3] =
    [("mass_spring_drag", &["1", "2", "3"]), ("stribeck_pendulum", &["1"]), ("two_carts", &["1", "2", "3"])];

/// The log of the first run of a machine, its model, and the names of its parameters and its first input.
fn recorded(
    name: &str,
    more: &[(&str, &str)],
    seed: &str,
) -> (tempfile::NamedTempFile, DeclaredModel, Vec<String>, String) {
    let path = root().join(format!("models/{name}.tpm"));
    let open = || DeclaredModel::open(&path).unwrap_or_else(|fault| panic!("{fault}"));
    let mut request = ExperimentRequest::default();
    let all = CHANGES.into_iter().chain(more.iter().copied()).chain([("seed", seed)]);
    request.changes = all.map(|(key, value)| (key.to_owned(), written_value(value))).collect();
    let session = Session::open(open(), &path, &request).unwrap_or_else(|error| panic!("{name}: {error}"));
    let plant = session.machine().plant();
    let (campaign, _) = session.campaign().unwrap_or_else(|error| panic!("{name}: {error}"));
    let record = session.simulate(campaign.next().expect("a run")).expect("plays");
    let file = tempfile::Builder::new().suffix(".csv").tempfile().expect("a file");
    std::fs::write(file.path(), samples_text(plant, &record)).expect("writable");
    let model = open();
    let parameters = (0..model.evaluated().dims().parameters).map(|j| model.evaluated().parameter(j).name.to_owned());
    let (parameters, input) = (parameters.collect(), model.evaluated().input(0).name.to_owned());
    (file, model, parameters, input)
}

/// The text below a node.
fn text(node: Node<'_, '_>) -> String {
    node.descendants().filter(|node| node.is_text()).filter_map(|node| node.text()).collect()
}

/// The number that a cell shows, in full.
fn number(node: Node<'_, '_>) -> Option<f64> {
    let shown = node.descendants().find(|node| node.has_tag_name("data"))?;
    Some(shown.attribute("value").expect("a value").parse().expect("a number"))
}

/// The tables of a section: names of the columns, and the cells of every row.
fn tables<'a>(section: Node<'a, 'a>) -> Vec<(Vec<String>, Vec<Vec<Node<'a, 'a>>>)> {
    let table = |table: Node<'a, 'a>| {
        let rows = table.descendants().filter(|node| node.has_tag_name("tr"));
        let cells = |row: Node<'a, 'a>, tag: &str| -> Vec<Node<'a, 'a>> {
            row.children().filter(|node| node.has_tag_name(tag)).collect()
        };
        let mut head = Vec::new();
        let mut body = Vec::new();
        for row in rows {
            let names = cells(row, "th");
            if names.len() > 1 {
                head = names.into_iter().map(text).collect();
            } else {
                body.push(cells(row, "td"));
            }
        }
        (head, body)
    };
    section.descendants().filter(|node| node.has_tag_name("table")).map(table).collect()
}

/// Holds a page against the JSON of its result.
fn check(case: &str, page: &str, result: &Value, shortfall: Option<&str>) {
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    let document = Document::parse_with_options(page, options).unwrap_or_else(|error| panic!("{case}: {error}"));
    let root = document.root_element();
    let of_class = |name: &str| {
        let has =
            |node: &Node<'_, '_>| node.attribute("class").is_some_and(|own| own.split(' ').any(|own| own == name));
        root.descendants().find(has)
    };
    let section =
        |id: &str| root.descendants().find(|node| node.has_tag_name("section") && node.attribute("id") == Some(id));
    let verdict = of_class("verdict").expect("a verdict");
    let said = text(verdict);
    let warnings = result["warnings"].as_array().expect("a list");
    // The headline, and what it rests on.
    let class = verdict.attribute("class").unwrap_or_default();
    assert_eq!(class.contains("short"), shortfall.is_some(), "{case}: {said}");
    assert!(shortfall.is_none_or(|why| said.contains(why)), "{case}: {said}");
    assert_eq!(class.contains("caution"), shortfall.is_none() && !warnings.is_empty(), "{case}: {said}");
    let residual = result["residual"].as_f64().expect("a number");
    let hides = asked_of(result).iter().any(|entry| entry["status"] == "unobservable");
    assert!(!hides || !said.to_lowercase().contains("everything that was asked for"), "{case}: {said}");
    if shortfall.is_none() {
        assert_eq!(said.contains("only within them"), hides, "{case}: {said}");
        let explains = said.contains("the model explains what was measured");
        assert_ne!(explains, said.contains("unexplained"), "{case}: {said}");
    }
    // One number says how much is unexplained, wherever it stands.
    let key = of_class("key").expect("the most important values");
    let names: Vec<String> = key.descendants().filter(|node| node.has_tag_name("dt")).map(text).collect();
    let values: Vec<Node<'_, '_>> = key.descendants().filter(|node| node.has_tag_name("dd")).collect();
    let at = names.iter().position(|name| name == "unexplained").expect("the residual stands in the headline");
    assert_eq!(number(values[at]), Some(residual), "{case}: {}", text(values[at]));
    let headline = text(values[at]);
    let conclusion = text(of_class("conclusion").expect("a conclusion"));
    assert!(conclusion.contains(&format!("The model leaves {headline} unexplained.")), "{case}: {conclusion}");
    // What it is a share of is said alike, whoever says it.
    let of = if result["residual_of"] == "motion" { "of the motion or input" } else { "of the force" };
    assert!(headline.ends_with(of), "{case}: {headline}");
    assert!(!said.contains("is not explained by the model; what") || said.contains(of), "{case}: {said}");
    if said.contains("unexplained") && shortfall.is_none() {
        assert!(said.contains(&headline), "{case}: {said}, but {headline}");
    }
    if let Some((_, rows)) = section("against").map(tables).and_then(|all| all.into_iter().next()) {
        assert_eq!(rows.first().and_then(|row| number(row[1])), Some(residual), "{case}: the table of the evidence");
        assert_eq!(text(rows[0][1]), headline, "{case}: the table of the evidence");
    }
    // Statuses, values, deviations: every parameter in its row, and counted right above.
    let all = tables(section("parameters").expect("a section"));
    let physical = result["physical"].as_array().is_some_and(|list| !list.is_empty());
    // One that is physical itself stands in the first table alone.
    let in_first = |entry: &&Value| !(physical && asked_of(result).iter().any(|own| own["name"] == entry["name"]));
    let lumped: Vec<&Value> = result["parameters"].as_array().expect("a list").iter().filter(in_first).collect();
    let lists: Vec<Vec<&Value>> = if physical {
        vec![asked_of(result).iter().collect(), lumped]
    } else {
        vec![asked_of(result).iter().collect()]
    };
    let mut poor: Vec<String> = Vec::new();
    let mut hidden: Vec<String> = Vec::new();
    for (entries, (head, rows)) in lists.iter().filter(|list| !list.is_empty()).zip(&all) {
        let place = |name: &str| head.iter().position(|column| column == name);
        assert_eq!(rows.len(), entries.len(), "{case}");
        for (entry, row) in entries.iter().zip(rows) {
            let name = entry["name"].as_str().expect("a name");
            assert_eq!(text(row[0]), name, "{case}");
            let status = entry["status"].as_str().expect("a status");
            let shown = text(row[place("status").expect("a column")]);
            assert!(
                shown.starts_with(&status.replace('_', " ")),
                "{case}: {name} is {status}, and the page says {shown}"
            );
            for (column, field) in [("identified", "value"), ("std. dev.", "std"), ("prior", "prior")] {
                if let Some(column) = place(column) {
                    let stated = entry[field].as_f64().filter(|value| value.is_finite());
                    assert_eq!(number(row[column]), stated, "{case}: {field} of {name}");
                }
            }
            if let Some(column) = place("difference/std") {
                assert_eq!(number(row[column]), from_prior(entry), "{case}: distance of {name} from its prior");
            }
            if status == "poorly_determined" && !poor.contains(&name.to_owned()) {
                poor.push(name.to_owned());
            }
            if status == "unobservable" {
                hidden.push(name.to_owned());
            }
        }
    }
    let asked = asked_of(result);
    for (status, words) in [
        ("identified", "identified"),
        ("poorly_determined", "known poorly"),
        ("unobservable", "not shown alone"),
        ("untrusted", "not to be trusted"),
        ("frozen", "held at a value that was given"),
    ] {
        let count = asked.iter().filter(|entry| entry["status"] == status).count();
        assert_eq!(
            conclusion.contains(&format!("{count} {words}")),
            count > 0,
            "{case}: {count} {status}: {conclusion}"
        );
    }
    if shortfall.is_none() {
        let named: Vec<String> = said
            .split_once("poorly determined: ")
            .map(|(_, names)| names.split_once('.').map_or(names, |(names, _)| names))
            .map(|names| names.split(", ").map(str::to_owned).collect())
            .unwrap_or_default();
        let (mut named, mut poor) = (named, poor);
        named.sort();
        poor.sort();
        assert_eq!(named, poor, "{case}: {said}");
    }
    // What the data do not show.
    let not_shown = text(section("not-shown").expect("a section"));
    let nothing = hidden.is_empty() && result["unobservable"].as_array().is_none_or(Vec::is_empty);
    assert_eq!(not_shown.contains("Nothing: the data show every parameter by itself"), nothing, "{case}: {not_shown}");
    assert!(hidden.iter().all(|name| not_shown.contains(name.as_str())), "{case}: {hidden:?}: {not_shown}");
    let warned = text(section("warnings").expect("a section"));
    assert_eq!(warned.contains("None."), warnings.is_empty(), "{case}: {warned}");
    assert!(warnings.iter().all(|own| warned.contains(own.as_str().expect("a text"))), "{case}: {warned}");
    // What the model lacks has its section exactly where terms were found.
    let missing = result["log"]["refinement"]["missing"].as_array().or(result["log"]["missing"].as_array());
    if let Some(missing) = missing {
        let none = warned.contains("no single term explains");
        assert!(missing.is_empty() || !none, "{case}: {warned}, beside {missing:?}");
        let explains = said.contains("the model explains what was measured");
        assert!(missing.is_empty() || !explains, "{case}: {said}, beside {missing:?}");
        let shares: f64 = missing.iter().map(|term| term["gain"].as_f64().expect("a share")).sum();
        let told = section("missing").is_some_and(|section| text(section).contains("add up to more than all"));
        assert_eq!(told, shares > 1.0, "{case}: shares of {shares} in all");
        assert_eq!(section("missing").is_some(), !missing.is_empty(), "{case}: {missing:?}");
    }
}

/// The parameters that were asked for: the physical ones, where there are any.
fn asked_of(result: &Value) -> &Vec<Value> {
    let list = |name: &str| result[name].as_array();
    list("physical").filter(|list| !list.is_empty()).or_else(|| list("parameters")).expect("a list")
}

/// A log of the arm of three joints along tones that do not repeat: motion with noise of its sensors, and the forces of the true motion
/// with noise of their own.
fn arm(seed: u64) -> (tempfile::NamedTempFile, DeclaredModel) {
    let model = DeclaredModel::open(root().join("tests/fixtures/arms/three_joints.tpm"))
        .unwrap_or_else(|fault| panic!("{fault}"));
    let rows = model.evaluated();
    let dims = rows.dims();
    let value = |j: usize| match rows.parameter(j).name {
        name if name.starts_with("fv") => 1.0,
        name if name.starts_with("fc") => 1.2,
        name if name.starts_with("m_") => 3.0,
        name if name.starts_with("mx") => 0.5,
        "Ixx_upper" | "Ixx_fore" => 0.02,
        name if ["Izz", "Iyy"].iter().any(|kind| name.starts_with(kind)) => 0.2,
        _ => 0.01,
    };
    let parameters: Vec<f64> = (0..dims.parameters).map(value).collect();
    let mut state = seed;
    let mut noise = || {
        let mut sum = -6.0;
        for _ in 0..12 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (state >> 11) as f64 / 2_f64.powi(53);
        }
        sum
    };
    let mut lines = String::from("t,q1,q2,q3,tau1,tau2,tau3\n");
    let (mut phi, mut scratch) = (vec![0.0; dims.regressor_len()], vec![0.0; rows.workspace_len()]);
    for k in 0..4000 {
        let t = 0.005 * f64::from(k);
        let mut motion = vec![0.0; dims.motion_len()];
        for c in 0..3 {
            for (tone, w) in [1.1, 2.7, 4.3].into_iter().enumerate() {
                let w = w + 0.37 * c as f64;
                let angle = w * t + (tone + 2 * c) as f64;
                motion[c] += 0.4 * angle.sin();
                motion[3 + c] += 0.4 * w * angle.cos();
                motion[6 + c] -= 0.4 * w * w * angle.sin();
            }
        }
        rows.regressor(&motion, &[], &mut scratch, &mut phi).expect("regular");
        lines.push_str(&format!("{t}"));
        (0..3).for_each(|c| lines.push_str(&format!(",{:e}", motion[c] + 1e-5 * noise())));
        for row in phi.chunks_exact(dims.parameters) {
            let force: f64 = row.iter().zip(&parameters).map(|(phi, value)| phi * value).sum();
            lines.push_str(&format!(",{:e}", force + 0.02 * noise()));
        }
        lines.push('\n');
    }
    let file = tempfile::Builder::new().suffix(".csv").tempfile().expect("a file");
    std::fs::write(file.path(), lines).expect("writable");
    (file, model)
}

/// The difference of a value from its prior in standard deviations.
fn from_prior(entry: &Value) -> Option<f64> {
    let of = |field: &str| entry[field].as_f64();
    let std = of("std").filter(|std| std.is_finite() && *std > 0.0)?;
    Some((of("value")? - of("prior")?) / std)
}

/// The page of a result, checked.
fn rendered(case: &str, model: &DeclaredModel, result: &Identification, evidence: &[Validation]) -> String {
    let issue =
        Issue { title: Some(case.to_owned()), author: Some("A & <B>".to_owned()), date: Some("2026-03-01".to_owned()) };
    let page = Page::of_identification(result, evidence, &|_| None).of_machine(model, result, &|_| None).issued(issue);
    let page = page.html().expect("a page");
    assert!(page.contains("A &amp; &lt;B&gt;") && page.contains("2026-03-01"), "{case}");
    let json = serde_json::to_value(result).expect("JSON");
    check(case, &page, &json, result.shortfall().as_deref());
    assert_eq!(page.contains("<math "), !model.equations().is_empty(), "{case}: equations");
    page
}

#[test]
fn no_page_contradicts_itself_or_its_result() {
    let (mut pages, mut complete, mut refused) = (0, 0, 0);
    for (name, seeds) in MACHINES {
        for &seed in seeds {
            let (log, model, parameters, input) = recorded(name, &[], seed);
            let request = || {
                let mut request = LogRequest::new(log.path());
                request.estimation.refine = Refine::None;
                request
            };
            let mut cases = vec![("right".to_owned(), request())];
            for parameter in &parameters {
                let mut without = request();
                without.estimation.frozen.insert(parameter.clone(), 0.0);
                cases.push((format!("without {parameter}"), without));
            }
            let mut swapped = request();
            swapped.reading.columns.scale.insert(input.clone(), -1.0);
            cases.push(("swapped cable".to_owned(), swapped));
            if seed == "1" {
                let mut refined = request();
                refined.estimation.refine = Refine::Auto;
                refined.estimation.prior.insert(parameters[0].clone(), 1.0);
                cases.push(("refined, with a prior".to_owned(), refined));
            }
            for (what, request) in cases {
                let case = format!("{name}, seed {seed}, {what}");
                let result = match from_log(&model, request.clone()) {
                    Ok(result) => result,
                    // What is refused has no page.
                    Err(_) => {
                        refused += 1;
                        continue;
                    }
                };
                let evidence: Vec<Validation> = (what == "right" || what.starts_with("refined"))
                    .then(|| {
                        let mut request = request;
                        request.estimation.prior.clear();
                        validate(&model, request, &result).ok()
                    })
                    .flatten()
                    .into_iter()
                    .collect();
                rendered(&case, &model, &result, &evidence);
                pages += 1;
                complete += usize::from(result.is_complete());
            }
        }
    }
    // An arm, whose motion shows many parameters within combinations only, right and with what it lacks.
    for seed in [1, 2] {
        let (log, model) = arm(seed);
        let request = || {
            let mut request = LogRequest::new(log.path());
            request.estimation.refine = Refine::None;
            request
        };
        let mut cases = vec![("right".to_owned(), request())];
        for lacking in ["fc_q1", "fv_q2", "fc_q3", "mx_fore"] {
            let mut without = request();
            without.estimation.frozen.insert(lacking.to_owned(), 0.0);
            cases.push((format!("without {lacking}"), without));
        }
        let mut swapped = request();
        swapped.reading.columns.scale.insert("tau2".to_owned(), -1.0);
        cases.push(("swapped cable".to_owned(), swapped));
        for (what, request) in cases {
            let case = format!("arm, seed {seed}, {what}");
            let result = from_log(&model, request.clone()).unwrap_or_else(|fault| panic!("{case}: {fault}"));
            let evidence: Vec<Validation> = match what == "right" {
                true => evidence(&model, vec![request], &result).unwrap_or_else(|fault| panic!("{case}: {fault}")),
                false => Vec::new(),
            };
            let page = rendered(&case, &model, &result, &evidence);
            if what == "right" {
                assert!(page.contains("only within them"), "{case}: an arm hides parameters");
            }
            pages += 1;
            complete += usize::from(result.is_complete());
        }
    }
    // A spring in two parts.
    let (log, ..) = recorded("mass_spring_drag", &[], "3");
    let text = std::fs::read_to_string(root().join("models/mass_spring_drag.tpm")).expect("a model");
    let twice = text.replace("k1 [N/m]", "k1 [N/m], k3 [N/m]").replace("k1*x", "k1*x + k3*x");
    let model = DeclaredModel::parse("twice.tpm", &twice).unwrap_or_else(|fault| panic!("{fault}"));
    let result = from_log(&model, LogRequest::new(log.path())).expect("identifies");
    assert!(result.physical.iter().any(|own| own.value.is_none()), "a spring in two parts");
    rendered("a spring in two parts", &model, &result, &[]);
    assert!(
        pages + 1 >= 50 && complete >= 8 && pages - complete >= 8,
        "{pages} pages, {complete} complete, {refused} refused"
    );
}

/// The page of an arm has its frames, the friction of its joints and what to do next; its numbers are those of the result.
#[test]
fn a_page_of_an_arm_shows_frames_friction_and_what_to_do_next() {
    let (log, model) = arm(3);
    let request = || {
        let mut request = LogRequest::new(log.path());
        request.estimation.refine = Refine::None;
        request
    };
    let mut stated = request();
    for j in 0..model.evaluated().dims().parameters {
        let name = model.evaluated().parameter(j).name;
        stated.estimation.prior.insert(name.to_owned(), if name.starts_with("m_") { 2.5 } else { 0.3 });
    }
    let result = from_log(&model, stated).expect("identifies");
    let evidence = evidence(&model, vec![request()], &result).expect("is compared");
    let page = rendered("arm beside its description", &model, &result, &evidence);
    let json = serde_json::to_value(&result).expect("JSON");
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    let document = Document::parse_with_options(&page, options).expect("well-formed");
    let section = |id: &str| {
        let has = |node: &Node<'_, '_>| node.has_tag_name("section") && node.attribute("id") == Some(id);
        document.descendants().find(has).unwrap_or_else(|| panic!("no section {id}"))
    };
    // Frames as the model states them, and the drives.
    let frames = tables(section("machine"));
    let cells = |rows: &[Vec<Node<'_, '_>>]| -> Vec<Vec<String>> {
        rows.iter().map(|row| row.iter().map(|cell| text(*cell)).collect()).collect()
    };
    let expected = [
        ["column", "the base", "q1 turns about z", "0, 0, 0.2", "0, 0, 0"],
        ["upper", "column", "q2 turns about y", "0, 0.08, 0.1", "0, 0, 0"],
        ["fore", "upper", "q3 turns about y", "0.35, -0.03, 0", "0, 0, 0"],
    ];
    assert_eq!(cells(&frames[0].1), expected);
    assert_eq!(cells(&frames[1].1)[1], ["tau2", "q2", "fv_q2 v + fc_q2 sign(v)"]);
    // Base parameters beside the description.
    let combinations = json["combinations"].as_array().expect("a list");
    let all = tables(section("parameters"));
    let (head, rows) = all.iter().find(|(head, _)| head[0] == "combination").expect("combinations");
    let place = |name: &str| head.iter().position(|column| column == name).expect("a column");
    assert_eq!(rows.len(), combinations.len());
    for (row, entry) in rows.iter().zip(combinations) {
        assert_eq!(number(row[place("identified")]), entry["value"].as_f64());
        assert_eq!(number(row[place("prior")]), entry["prior"].as_f64());
        assert!(entry["prior"].is_number(), "{entry}");
        assert_eq!(number(row[place("difference/std")]), from_prior(entry));
    }
    // The curve of friction is that of the identified parameters, and what the other terms leave lies about it.
    let value = |name: &str| {
        let own = json["parameters"].as_array().and_then(|list| list.iter().find(|own| own["name"] == name));
        own.and_then(|own| own["value"].as_f64()).unwrap_or_else(|| panic!("no value of {name}"))
    };
    let shown = text(section("friction"));
    for (row, joint) in evidence[0].rows.iter().zip(["q1", "q2", "q3"]) {
        let own = row.friction.as_ref().unwrap_or_else(|| panic!("no friction of {joint}"));
        let (viscous, dry) = (value(&format!("fv_{joint}")), value(&format!("fc_{joint}")));
        let law = |v: f64| viscous * v + dry * v.signum();
        assert!(own.law.iter().filter(|(v, _)| *v != 0.0).all(|(v, force)| (force - law(*v)).abs() < 1e-9), "{joint}");
        // Far from reversals, where the low pass smears the jump.
        let fast: Vec<f64> = (own.points.iter()).filter(|(v, _)| v.abs() > 1.0).map(|(v, f)| f - law(*v)).collect();
        let rms = (fast.iter().map(|left| left * left).sum::<f64>() / fast.len() as f64).sqrt();
        assert!(fast.len() > 50 && rms < 0.1 * dry, "{joint}: {rms} of {dry} at {} points", fast.len());
        for label in [format!("rate of {joint} [rad/s]"), format!("friction of {joint} [N*m]")] {
            assert!(shown.contains(&label), "`{label}` in {shown}");
        }
    }
    // A matrix of correlations that narrow screens have no room for has a list beside it.
    let (head, rows) = tables(section("correlations")).pop().expect("a list");
    assert_eq!(head, ["parameter", "with", "correlation"]);
    let listed: Vec<f64> = rows.iter().filter_map(|row| number(row[2])).collect();
    assert!(listed.len() >= 10 && listed.is_sorted_by(|a, b| a.abs() >= b.abs()), "{listed:?}");
    let next = text(section("next"));
    assert!(next.contains("Predict another log"), "{next}");
    assert_eq!(next.contains("possible inertias"), result.is_complete(), "{next}");
}

#[test]
fn a_page_of_a_comparison_says_what_the_comparison_says() {
    let stored = |seed: &str, mass: &str| {
        let (log, model, ..) = recorded("mass_spring_drag", &[("plant.parameters.m", mass)], seed);
        let result = from_log(&model, LogRequest::new(log.path())).expect("identifies");
        StoredResult::of(&result).expect("a result")
    };
    let (before, same, after) = (stored("1", "2.0"), stored("2", "2.0"), stored("3", "2.2"));
    for (other, changed) in [(&same, false), (&after, true)] {
        let found = compare(&before, other).expect("comparable");
        let page = Page::of_comparison(&found, ["a.json", "b.json"]).html().expect("a page");
        let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
        let document = Document::parse_with_options(&page, options).expect("well-formed");
        let all = text(document.root_element());
        assert!(all.to_lowercase().contains(&found.in_words().to_lowercase()), "{all}");
        assert_eq!(found.changed.contains(&"m".to_owned()), changed, "{found}");
        let section =
            document.descendants().find(|node| node.attribute("id") == Some("differences")).expect("a section");
        let (head, rows) = tables(section).into_iter().next().expect("a table");
        let place = |name: &str| head.iter().position(|column| column == name).expect("a column");
        for (row, own) in rows.iter().zip(&found.linear.differences) {
            assert_eq!(text(row[0]), own.name);
            assert_eq!(number(row[place("B - A")]), own.difference, "{}", own.name);
            assert_eq!(number(row[place("z")]), own.z, "{}", own.name);
            assert_eq!(text(row[place("outcome")]) == "changed", own.changed, "{}", own.name);
            // The interval is drawn beside no difference, which is the middle of the strip, and on the side of its sign.
            let of = |class: &str, field: &str| -> f64 {
                let mark = row[place("difference")].descendants().find(|node| node.attribute("class") == Some(class));
                mark.and_then(|mark| mark.attribute(field)?.parse().ok()).unwrap_or_else(|| panic!("no {class}"))
            };
            let (low, width, value) = (of("bar", "x"), of("bar", "width"), of("value", "x1"));
            assert_eq!(of("zero", "x1"), 100.0, "{}", own.name);
            assert!(low > 0.0 && low + width < 200.0, "{}: {low} and {width}", own.name);
            assert!((value - 100.0) * own.z.expect("a number") >= 0.0, "{}: {value}", own.name);
            let holds = (low..low + width).contains(&100.0);
            assert_eq!(holds, own.z.expect("a number").abs() < 1.96, "{}: {low} and {width}", own.name);
        }
        assert_eq!(rows.len(), found.linear.differences.len());
    }
}

#[test]
fn a_page_of_a_validation_says_what_the_validation_says() {
    let (log, model, ..) = recorded("mass_spring_drag", &[], "1");
    let result = from_log(&model, LogRequest::new(log.path())).expect("identifies");
    let mut verdicts = Vec::new();
    // The machine itself, one with a little more mass, and a cable that is swapped.
    for (mass, gain) in [("2.0", 1.0), ("2.1", 1.0), ("2.0", -1.0)] {
        let case = format!("{mass} kg, gain {gain}");
        let (other, ..) = recorded("mass_spring_drag", &[("plant.parameters.m", mass)], "2");
        let mut request = LogRequest::new(other.path());
        request.reading.columns.scale.insert("u".to_owned(), gain);
        let found = validate(&model, request, &result).expect("a validation");
        let page = Page::from(&found).html().expect("a page");
        let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
        let document = Document::parse_with_options(&page, options).expect("well-formed");
        let with = |field: &str, value: &str| document.descendants().find(|node| node.attribute(field) == Some(value));
        // The headline: what is missing, or that tests failed.
        let verdict = document
            .descendants()
            .find(|node| node.attribute("class").is_some_and(|class| class.starts_with("verdict")))
            .expect("a verdict");
        let (class, said) = (verdict.attribute("class").expect("a class"), text(verdict));
        let shortfall = found.shortfall();
        assert_eq!(class.contains("short"), shortfall.is_some(), "{case}: {said}");
        assert!(shortfall.as_ref().is_none_or(|why| said.contains(why)), "{case}: {said}");
        let channels = found.simulation.iter().flat_map(|simulation| &simulation.channels);
        let tests: Vec<bool> = channels
            .clone()
            .flat_map(|own| own.whiteness.iter().chain(own.independence.iter().map(|input| &input.test)))
            .map(|test| test.passed)
            .collect();
        assert_eq!(class.contains("caution"), shortfall.is_none() && tests.contains(&false), "{case}: {said}");
        // Its number, and the tables below.
        let key = text(with("class", "key").expect("the most important values"));
        assert!(key.contains("largest share missed"), "{case}: {key}");
        let first = with("class", "key").and_then(number);
        assert_eq!(first, found.prediction_error, "{case}: {key}");
        let all = tables(with("id", "against").expect("a section"));
        let column = |head: &[String], name: &str| head.iter().position(|own| own == name).expect("a column");
        let (head, rows) = &all[0];
        assert_eq!(rows.len(), found.rows.len(), "{case}");
        for (row, own) in rows.iter().zip(&found.rows) {
            assert_eq!(text(row[0]), own.name, "{case}");
            assert_eq!(number(row[column(head, "share missed")]), Some(own.share), "{case}: {}", own.name);
        }
        let (head, rows) = &all[1];
        for (row, own) in rows.iter().zip(channels.clone()) {
            assert_eq!(text(row[0]), own.name, "{case}");
            assert_eq!(number(row[column(head, "one step, rms")]), Some(own.one_step.rms), "{case}: {}", own.name);
            let free = own.free_run.as_ref().map(|run| run.rms);
            assert_eq!(number(row[column(head, "free run, rms")]), free, "{case}: {}", own.name);
        }
        let (_, rows) = tables(with("id", "residual").expect("a section")).swap_remove(0);
        let stated: Vec<bool> = rows.iter().map(|row| text(row[row.len() - 1]) == "passed").collect();
        assert_eq!(stated, tests, "{case}");
        verdicts.push((shortfall.is_some(), tests.contains(&false)));
    }
    assert!(!verdicts[0].0 && verdicts[1].1 && verdicts[2].0, "{verdicts:?}");
}
