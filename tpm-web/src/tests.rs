//! Questions as the page asks them, and their answers.

use crate::asked::answer;
use crate::file::Bytes;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::session::{DeclaredModel, LogRequest, from_log};

fn ask(question: &Value, logs: &[Bytes]) -> Value {
    serde_json::from_str(&answer(&question.to_string(), logs)).expect("an answer is JSON")
}

/// The model of the sample, and its log.
fn sample() -> (Value, Bytes) {
    let sample = ask(&json!({ "ask": "sample" }), &[]);
    let log = sample["log"]["text"].as_str().expect("a log").as_bytes().to_vec();
    (sample["model"].clone(), Arc::new(log))
}

fn error(answer: &Value) -> &str {
    answer["error"].as_str().unwrap_or_else(|| panic!("no fault: {answer}"))
}

#[test]
fn the_sample_is_identified_as_from_its_file() {
    let (model, log) = sample();
    let seen = ask(&json!({ "ask": "log", "log": "run.csv" }), std::slice::from_ref(&log));
    let columns: Vec<&str> =
        seen["columns"].as_array().expect("columns").iter().filter_map(|column| column["name"].as_str()).collect();
    assert_eq!(columns, ["x", "u"], "{seen}");
    let templates = seen["templates"].as_array().expect("templates");
    let slider = templates.iter().find(|template| template["name"] == "slider").expect("a slider fits");
    let text = slider["model"].as_str().expect("a model");
    let checked = ask(&json!({ "ask": "check", "model": { "name": "slider.tpm", "text": text } }), &[]);
    assert_eq!((&checked["faulty"], &checked["findings"]), (&json!(false), &json!([])));

    let asked = json!({ "ask": "identify", "model": model, "logs": ["run.csv"], "settings": { "hold": "zoh" }, "date": "2030-01-31",
        "title": "Axis <3>" });
    let found = ask(&asked, std::slice::from_ref(&log));
    let folder = std::env::temp_dir().join(format!("tpm-web-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join("run.csv");
    std::fs::write(&path, log.as_slice()).expect("writable");
    let declared = DeclaredModel::parse("slide.tpm", model["text"].as_str().expect("text")).expect("a model");
    let own = from_log(&declared, LogRequest::new(&path).hold(Hold::Zoh)).expect("identifies");
    std::fs::remove_dir_all(&folder).expect("removable");
    let own = serde_json::to_string_pretty(&own).expect("JSON").replace(&path.display().to_string(), "run.csv") + "\n";
    assert_eq!(found["result"].as_str().expect("a result"), own);
    let report = found["report"].as_str().expect("a report");
    assert!(
        report.contains("Axis &lt;3&gt;") && report.contains("2030-01-31") && report.contains("<svg"),
        "the report"
    );
    assert!(!report.contains("<script") && !report.contains("http-equiv"), "a report has no script");

    for (language, ending) in [("c", ".c"), ("rust", ".rs")] {
        let made =
            ask(&json!({ "ask": "generate", "model": model, "language": language, "result": found["result"] }), &[]);
        let files = made["files"].as_array().expect("files");
        assert!(files.iter().any(|file| file["name"].as_str().is_some_and(|name| name.ends_with(ending))), "{made}");
        assert!(made.to_string().contains("result.json"));
    }
}

#[test]
fn faults_have_their_places() {
    // Places count what a browser counts: the letter before the fault takes two units.
    let text = "model A {\n    coordinate x [m];\n    input u [N];\n    parameter m [kg]; // \u{1d70b}\n\n    m*ddot(x) + q = u;\n}\n";
    let found = ask(&json!({ "ask": "check", "model": { "name": "a.tpm", "text": text } }), &[]);
    let fault = &found["findings"][0];
    let units: Vec<u16> = text.encode_utf16().collect();
    let at = |end: &str| fault[end].as_u64().expect("a place") as usize;
    assert_eq!(String::from_utf16(&units[at("from")..at("to")]).expect("text"), "q", "{found}");
    assert_eq!((&fault["line"], &fault["error"], &found["faulty"]), (&json!(6), &json!(true), &json!(true)));
    assert!(found["model"].is_null());
}

#[test]
fn refusals_name_the_field_that_helps() {
    let (model, log) = sample();
    let with = |settings: Value| {
        let asked = json!({ "ask": "identify", "model": model, "logs": ["run.csv"], "settings": settings });
        ask(&asked, std::slice::from_ref(&log))
    };
    for (settings, words) in [
        (json!({ "signals": { "x": { "column": "position" } } }), ["column of x", "position"]),
        (json!({ "signals": { "x": { "factor": "pi/" } } }), ["Factor of x", "pi/180"]),
        (json!({ "signals": { "u": { "delay": "-1" } } }), ["Delay of u", "negative"]),
        (json!({ "period": "soon" }), ["Period", "soon"]),
        (json!({ "held": "m 3" }), ["Held", "m 3"]),
        (json!({ "held": "mass = 3" }), ["Held of mass", "m, d, c, o"]),
        (json!({ "hold": "foh" }), ["Between samples", "foh"]),
    ] {
        let answer = with(settings.clone());
        let said = error(&answer);
        assert!(words.iter().all(|word| said.contains(word)), "{settings}: {said}");
    }
    let answer = ask(&json!({ "ask": "log", "log": "noise.csv" }), &[Arc::new((0..=255).cycle().take(9999).collect())]);
    assert!(error(&answer).contains("noise.csv"), "{answer}");
    assert!(error(&ask(&json!({ "ask": "fly" }), &[])).contains("fly"));
    let vast = "model V { coordinate q; input u; parameter m, k; m*ddot(q) + k*abs(ddot(q)^400) = u; \
                pattern { amplitude l; frequency w; q = rest_to_rest(l, 2*w, 5); } }";
    let found = ask(&json!({ "ask": "check", "model": { "name": "v.tpm", "text": vast } }), &[]);
    assert!(found.to_string().contains("operations"), "{found}");
}

#[test]
fn a_robot_description_becomes_a_model() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/robots/mujoco.xml");
    let text = std::fs::read_to_string(path).expect("a description");
    let made = ask(&json!({ "ask": "import", "description": { "name": "arm.xml", "text": text } }), &[]);
    let text = made["model"].as_str().unwrap_or_else(|| panic!("{made}"));
    let checked = ask(&json!({ "ask": "check", "model": { "name": "arm.tpm", "text": text } }), &[]);
    assert_eq!(checked["faulty"], json!(false), "{checked}");
    assert!(made["known"].as_str().is_some_and(|known| known.contains(" = ")));
    let answer = ask(&json!({ "ask": "import", "description": { "name": "arm.urdf", "text": "<robot" } }), &[]);
    assert!(error(&answer).contains("arm.urdf"), "{answer}");
}
