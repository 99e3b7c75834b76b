//! Base parameters of arms through the verbs: the simulated UR5's logs, whose truth is known, and the TX40 with its coupled wrist.

use crate::support::{root, skipped};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_codegen::identified::Identified;
use tpm_codegen::import::{Imported, Options, import_description};
use tpm_codegen::source::Source;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::session::{DeclaredModel, Identifiable as _, Identification, LogRequest, Warning, from_log};
use tpm_symbolic::mechanics::tree::mechanism::Loss;
use tpm_symbolic::regressor::base_parameters::{BaseParameters, Motions, base_parameters, verify};
use tpm_symbolic::regressor::parameter_map::ParameterMap;

fn data(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("TPM_DATA").map(|folder| PathBuf::from(folder).join(name)).filter(|path| path.exists());
    if path.is_none() {
        skipped(&format!("TPM_DATA has no {name}"));
    }
    path
}

fn imported(path: &Path) -> Imported {
    let source = Source::from_bytes("ur5.urdf".to_owned(), std::fs::read(path).expect("a description"));
    let options = Options { losses: Some(vec![Loss::Viscous, Loss::Rotor]), ..Options::default() };
    import_description(&source, &options).unwrap_or_else(|faults| panic!("{}", faults.render(&source)))
}

fn base(model: &DeclaredModel) -> BaseParameters {
    let prepared = model.prepared();
    base_parameters(&prepared.model, &prepared.form, &Motions::default()).expect("a rank")
}

/// What a result states: weights, value and deviation of every parameter that shows alone, and of every combination.
fn stated(result: &Identification, columns: &[String]) -> Vec<(Vec<f64>, f64, f64)> {
    let at = |name: &str| columns.iter().position(|column| column == name).expect("a column");
    let alone = result.parameters.iter().filter_map(|own| {
        let mut weights = vec![0.0; columns.len()];
        weights[at(&own.name)] = 1.0;
        Some((weights, own.value?, own.std?))
    });
    let combined = result.combinations.iter().map(|shown| {
        let mut weights = vec![0.0; columns.len()];
        for (name, weight) in &shown.terms {
            weights[at(name)] = weight.parse().expect("a number");
        }
        (weights, shown.value, shown.std)
    });
    alone.chain(combined).collect()
}

#[test]
fn a_noisy_log_of_an_arm_shows_its_exact_base_parameters() {
    let (Some(robot), Some(logs)) = (data("robots/ur5_robot.urdf"), data("hard_logs")) else { return };
    let imported = imported(&robot);
    let model = DeclaredModel::parse("ur5", &imported.model).expect("a model");
    let exact = base(&model);
    assert_eq!((exact.rank, exact.parameters.len()), (46, 59));
    // True values: the description's inertias, friction and rotors of the simulation.
    let text = std::fs::read_to_string(logs.join("ur5_c1_guess_noisy.json")).expect("the truth");
    let truth: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let lines = imported.prior.lines().filter_map(|line| line.split_once(" = "));
    let mut values: BTreeMap<String, f64> =
        lines.filter_map(|(name, value)| Some((name.to_owned(), value.parse().ok()?))).collect();
    let joints: Vec<String> =
        model.prepared().model.coordinates.iter().map(|coordinate| coordinate.name.clone()).collect();
    for (i, joint) in joints.iter().enumerate() {
        for (symbol, key) in [("fv", "d"), ("Ia", "arm")] {
            values.insert(format!("{symbol}_{joint}"), truth["params"][key][i].as_f64().expect("a number"));
        }
    }
    let map = ParameterMap::new(model.prepared());
    // What moves nothing has no value in the prior, and enters no column.
    let columns = map.evaluate(|symbol| values.get(map.name(symbol)).copied().unwrap_or(f64::NAN));
    for log in ["noisy", "clean"] {
        // Without noise only what repeats in every period is wrong: rounding, and harmonics that are left out.
        let bound = |std: f64| if log == "noisy" { 5.0 * std } else { 1e-5 };
        let mut request = LogRequest::new(logs.join(format!("ur5_c1_guess_{log}.csv"))).hold(Hold::Zoh);
        for (i, joint) in joints.iter().enumerate() {
            request = request.map(joint, &format!("q{}", i + 1)).map(&format!("tau_{joint}"), &format!("tau{}", i + 1));
        }
        let result = from_log(&model, request).expect("the log identifies");
        // The lines of the rows tell what a simulation, which would take minutes, would tell: none is missed.
        let left_out = result.warnings.iter().any(|warning| matches!(warning, Warning::LongSimulation(_)));
        assert!(!left_out, "{log}");
        assert_eq!(result.rank, 46, "{log}");
        let shown = stated(&result, &exact.parameters);
        assert_eq!(shown.len(), 46, "{log}");
        let mut near = 0;
        for (weights, value, std) in &shown {
            // No direction that the model hides changes it.
            for direction in exact.hidden(&[]) {
                let along: f64 = direction
                    .iter()
                    .map(|(column, factor)| weights[*column] * tpm_symbolic::number::rational::to_f64(factor))
                    .sum();
                assert!(along.abs() < 1e-8, "{log}: {weights:?} changes by {along} along {direction:?}");
            }
            let wanted: f64 = weights
                .iter()
                .zip(&columns)
                .filter(|(weight, _)| **weight != 0.0)
                .map(|(weight, own)| weight * own)
                .sum();
            near += usize::from((value - wanted).abs() <= 2.0 * std);
            assert!((value - wanted).abs() <= bound(*std), "{log}: {value} +- {std}, and {wanted} is true");
        }
        assert!(near >= 40, "{log}: {near} of 46 within two deviations");
        // Few terms: what `identifiability` prints.
        let terms = exact.base.as_ref().expect("exact factors").iter().map(|own| 1 + own.others.len()).sum::<usize>();
        let printed: usize =
            shown.iter().map(|(weights, ..)| weights.iter().filter(|weight| **weight != 0.0).count()).sum();
        assert!(printed <= terms, "{printed} terms are printed, {terms} are enough");
        // No single parameter has a value that the data do not show, in no output.
        for own in &result.physical {
            let Some(value) = own.value else { continue };
            let wanted = values[&own.name];
            let std = own.std.expect("a shown parameter has a deviation");
            assert!((value - wanted).abs() <= bound(std), "{log}: {} = {value} +- {std}, {wanted}", own.name);
        }
        let identified = Identified::from(&result);
        let told = identified.settled().expect("46 combinations and 13 directions");
        assert_eq!(told.open.len(), 13, "{log}");
    }
}

#[test]
fn the_wrist_of_the_tx40_is_coupled() {
    let text = std::fs::read_to_string(root().join("models/robots/tx40.tpm")).expect("the shipped model");
    let whole = DeclaredModel::parse("tx40.tpm", &text).expect("a model");
    // 36 inertial parameters; viscous and dry friction and offset of six joints, rotors of the last four joints, and rotor and two
    // frictions of the coupled motor (the rotors of the first two joints are lumped).
    let found = base(&whole);
    assert_eq!(found.rank, 61);
    let prepared = whole.prepared();
    verify(&prepared.model, &prepared.form, &Motions::default(), &found.certificate, 7).expect("a sound certificate");
    let mut alone = String::new();
    for line in text.lines().filter(|line| !line.trim_start().starts_with("drive q6")) {
        let drive = line.trim_start().starts_with("drive");
        let (kept, end) = if drive { (line.split(" with ").next().unwrap_or(line), ";\n") } else { (line, "\n") };
        alone.push_str(kept);
        alone.push_str(end);
    }
    let alone = DeclaredModel::parse("tx40.tpm", &alone).expect("a model");
    assert_eq!(base(&alone).rank, 36);
    // The motor of the wrist acts on both joints.
    assert_eq!(alone.evaluated().dims().inputs, 6);
    let acts = |input: u32| {
        let symbol = alone.prepared().model.inputs().nth(input as usize).expect("an input");
        let rows = alone.prepared().form.rows.iter();
        rows.filter(|row| row.inputs.iter().any(|(own, _)| *own == symbol)).count()
    };
    assert_eq!([0, 4, 5].map(acts), [1, 1, 2]);
}

/// Three joints whose origins are turned by angles that are no right ones: factors of base parameters have eighty digits.
#[test]
fn factors_of_arms_with_several_skew_angles_are_exact() {
    let link = |name: &str| {
        format!(
            "<link name=\"{name}\"><inertial><origin xyz=\"0.1 0.02 0.03\"/><mass value=\"2\"/>\
             <inertia ixx=\"0.02\" ixy=\"0\" ixz=\"0\" iyy=\"0.03\" iyz=\"0\" izz=\"0.04\"/></inertial></link>"
        )
    };
    let joint = |name: &str, parent: &str, child: &str, origin: &str| {
        format!(
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin {origin}/>\
             <axis xyz=\"0 0 1\"/><limit lower=\"-2\" upper=\"2\" velocity=\"3\" effort=\"60\"/></joint>"
        )
    };
    let text = [
        "<robot name=\"skew\"><link name=\"base\"/>".to_owned(),
        link("a"),
        link("b"),
        link("c"),
        joint("q1", "base", "a", "rpy=\"0.7 0.2 0\""),
        joint("q2", "a", "b", "xyz=\"0.3 0.1 0.2\" rpy=\"0.7 0.3 0\""),
        joint("q3", "b", "c", "xyz=\"0.3 0.1 0.2\" rpy=\"1.1 0.4 0\""),
        "</robot>".to_owned(),
    ]
    .concat();
    let source = Source::new("skew.urdf", text);
    let imported =
        import_description(&source, &Options::default()).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let model = DeclaredModel::parse("skew", &imported.model).expect("a model");
    let found = base(&model);
    let prepared = model.prepared();
    verify(&prepared.model, &prepared.form, &Motions::default(), &found.certificate, 3).expect("a sound certificate");
    let base = found.base.expect("exact factors");
    assert_eq!(
        (base.len(), found.certificate.directions.map(|all| all.len())),
        (found.rank, Some(found.parameters.len() - found.rank))
    );
    // Two hundred and forty bits, four primes, are not enough.
    let longest = base.iter().flat_map(|own| &own.others).map(|(_, factor)| factor.denom().bits()).max();
    assert!(longest.is_some_and(|bits| bits > 120), "{longest:?}");
}
