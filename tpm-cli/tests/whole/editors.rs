//! Layout of files, and conversations with the server for editors, through the program as it is shipped.

use crate::support::{root, tpm_in};
use lsp_server::{Message, Notification, Request, RequestId};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{BufReader, Read as _, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Output, Stdio};
use tpm_codegen::language::function::{Clause, Function};
use tpm_codegen::language::keywords::KEYWORDS;

/// A model that nobody has laid out.
const ROUGH: &str = "// a cart\nmodel Cart{\n  coordinate x[m];input u [ N ];\n\n\n  parameter m [kg] , k [N / m]; // mass, spring\n  m * ddot( x )+k*x=u;\n}";

/// The same model as `tpm fmt` lays it out.
const SMOOTH: &str = "// a cart\nmodel Cart {\n    coordinate x [m];\n    input u [N];\n\n    parameter m [kg], k [N/m];                       // mass, spring\n    m*ddot(x) + k*x = u;\n}\n";

/// Runs the tool with a text at its standard input.
fn given(text: &str, arguments: &[&str]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_tpm"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the tool starts");
    child.stdin.take().expect("an input").write_all(text.as_bytes()).expect("the tool reads");
    child.wait_with_output().expect("the tool ends")
}

fn at(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).expect("writable");
}

fn text(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).expect("readable")
}

#[test]
fn files_are_laid_out_in_their_places() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    at(here, "rough.tpm", ROUGH);
    at(here, "smooth.tpm", SMOOTH);
    #[cfg(unix)]
    std::os::unix::fs::symlink("rough.tpm", here.join("link.tpm")).expect("a link");
    let checked = tpm_in(here, &["fmt", "--check", "rough.tpm", "smooth.tpm"]);
    assert_eq!((checked.status.code(), checked.stdout.as_slice()), (Some(1), b"rough.tpm\n".as_slice()));
    assert!(String::from_utf8_lossy(&checked.stderr).trim_end().ends_with("`tpm fmt rough.tpm`"), "{checked:?}");
    assert_eq!(text(here, "rough.tpm"), ROUGH, "--check changes nothing");
    let name = if cfg!(unix) { "link.tpm" } else { "rough.tpm" };
    assert_eq!(tpm_in(here, &["fmt", name, "smooth.tpm"]).status.code(), Some(0));
    assert_eq!((text(here, "rough.tpm").as_str(), text(here, "smooth.tpm").as_str()), (SMOOTH, SMOOTH));
    #[cfg(unix)]
    assert!(std::fs::symlink_metadata(here.join("link.tpm")).expect("it is there").is_symlink());
    assert_eq!(tpm_in(here, &["fmt", "--check", "rough.tpm", "smooth.tpm"]).status.code(), Some(0));
    // A file with a fault is refused, and no other is changed.
    at(here, "rough.tpm", ROUGH);
    at(here, "faulty.tpm", "model M {\n  coordinate x [m]\n  m*ddot(x = u;\n}\n");
    let refused = tpm_in(here, &["fmt", "rough.tpm", "faulty.tpm"]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(
        said.contains("a `;` is missing") && said.contains("faulty.tpm:2") && said.contains("no file was changed"),
        "{said}"
    );
    assert_eq!(text(here, "rough.tpm"), ROUGH);
    assert!(text(here, "faulty.tpm").starts_with("model M {\n  coord"));
}

#[test]
fn standard_input_is_laid_out_to_standard_output() {
    let done = given(ROUGH, &["fmt", "-"]);
    assert_eq!((done.status.code(), String::from_utf8_lossy(&done.stdout).as_ref()), (Some(0), SMOOTH));
    let checked = given(ROUGH, &["fmt", "--check", "-"]);
    assert_eq!((checked.status.code(), checked.stdout.as_slice()), (Some(1), b"-\n".as_slice()));
    assert_eq!(given(SMOOTH, &["fmt", "--check", "-"]).status.code(), Some(0));
    let refused = given("model M {", &["fmt", "-"]);
    assert_eq!((refused.status.code(), refused.stdout.len()), (Some(2), 0));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("standard input:1"), "{refused:?}");
}

/// A conversation with the server.
struct Session {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    asked: i32,
}

const URI: &str = "file:///cart.tpm";

impl Session {
    /// A server that was not spoken to yet.
    fn silent() -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_tpm"))
            .args(["lsp", "--stdio"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the server starts");
        let (input, output) = (child.stdin.take().expect("an input"), child.stdout.take().expect("an output"));
        Self { child, input, output: BufReader::new(output), asked: 0 }
    }

    fn begun() -> Self {
        let mut session = Self::silent();
        let able = session.ask("initialize", json!({ "capabilities": {} })).expect("capabilities");
        assert_eq!(able["capabilities"]["textDocumentSync"]["change"], 1);
        session.tell("initialized", json!({}));
        session
    }

    fn tell(&mut self, method: &str, params: Value) {
        let message = Message::from(Notification { method: method.to_owned(), params });
        message.write(&mut self.input).expect("the server reads");
    }

    fn next(&mut self) -> Message {
        Message::read(&mut self.output).expect("a message").expect("the server is there")
    }

    /// The answer, or its error; what the server says beside it is left out.
    fn ask(&mut self, method: &str, params: Value) -> Result<Value, (i32, String)> {
        self.asked += 1;
        let id = RequestId::from(self.asked);
        let request = Message::from(Request { id: id.clone(), method: method.to_owned(), params });
        request.write(&mut self.input).expect("the server reads");
        loop {
            if let Message::Response(response) = self.next() {
                assert_eq!(response.id, id);
                return response.response_result.map_err(|error| (error.code, error.message));
            }
        }
    }

    /// What the server says of the document next.
    fn diagnostics(&mut self) -> Value {
        loop {
            if let Message::Notification(own) = self.next() {
                assert_eq!((own.method.as_str(), &own.params["uri"]), ("textDocument/publishDiagnostics", &json!(URI)));
                return own.params["diagnostics"].clone();
            }
        }
    }

    fn open(&mut self, text: &str) {
        let document = json!({ "uri": URI, "languageId": "tpm", "version": 1, "text": text });
        self.tell("textDocument/didOpen", json!({ "textDocument": document }));
    }

    fn change(&mut self, text: &str) {
        let document = json!({ "uri": URI, "version": 2 });
        self.tell("textDocument/didChange", json!({ "textDocument": document, "contentChanges": [{ "text": text }] }));
    }

    /// Asks about the place where a part of the text begins, which the text has before it on ASCII lines.
    fn ask_at(&mut self, method: &str, text: &str, part: &str) -> Value {
        let before = &text[..text.find(part).expect("it stands there")];
        let line = before.matches('\n').count();
        let character = before.rsplit('\n').next().unwrap_or_default().encode_utf16().count();
        let place = json!({ "textDocument": { "uri": URI }, "position": { "line": line, "character": character } });
        self.ask(method, place).expect("an answer")
    }

    fn ends_with(mut self) -> (Option<i32>, String) {
        drop(self.input);
        let mut said = String::new();
        self.child.stderr.take().expect("errors").read_to_string(&mut said).expect("text");
        (self.child.wait().expect("the server ends").code(), said)
    }
}

#[test]
fn a_model_is_edited() {
    let mut session = Session::begun();
    // Two units of UTF-16 stand before the fault on its line, in one letter of four bytes.
    let faulty = SMOOTH.replace("k*x = u", "\u{1d706}*x + kk*x = u");
    session.open(&faulty);
    let said = session.diagnostics();
    let unknown =
        said.as_array().expect("a list").iter().find(|own| own["message"].as_str().is_some_and(|m| m.contains("`kk`")));
    let unknown = unknown.unwrap_or_else(|| panic!("{said}"));
    assert_eq!(
        unknown["range"],
        json!({ "start": { "line": 6, "character": 23 }, "end": { "line": 6, "character": 25 } })
    );
    assert_eq!((&unknown["severity"], &unknown["source"]), (&json!(1), &json!("tpm")));
    assert!(unknown["message"].as_str().is_some_and(|message| message.contains("\nhelp: ")), "{unknown}");
    // A text with a fault is not laid out, and one that is mended has no faults.
    let layout = json!({ "textDocument": { "uri": URI }, "options": { "tabSize": 4, "insertSpaces": true } });
    assert_eq!(session.ask("textDocument/formatting", layout.clone()), Ok(Value::Null));
    session.change(ROUGH);
    assert_eq!(session.diagnostics(), json!([]));

    let hover = session.ask_at("textDocument/hover", ROUGH, "k*x");
    assert_eq!(hover["contents"]["value"], "```tpm\nparameter k [N/m]\n```\n\nmass, spring");
    assert_eq!(hover["range"]["start"], json!({ "line": 6, "character": 16 }));
    let value = |hover: Value| hover["contents"]["value"].as_str().unwrap_or_default().to_owned();
    assert!(value(session.ask_at("textDocument/hover", ROUGH, "ddot")).contains("second time derivative"));
    assert!(value(session.ask_at("textDocument/hover", ROUGH, "u [")).contains("input u [N]"));
    assert!(value(session.ask_at("textDocument/hover", ROUGH, "coordinate")).contains("generalised coordinates"));
    assert_eq!(session.ask_at("textDocument/hover", ROUGH, "* ddot"), Value::Null);
    let words = session.ask_at("textDocument/completion", ROUGH, "k*x");
    let label = |name: &str| words.as_array().expect("a list").iter().find(|own| own["label"] == name).cloned();
    assert_eq!(label("k").expect("the parameter")["detail"], "parameter k [N/m]");
    assert!(label("ddot").is_some() && label("pattern").is_some() && label("rest_to_rest").is_some());
    let edits = session.ask("textDocument/formatting", layout.clone()).expect("edits");
    assert_eq!(edits[0]["newText"], SMOOTH);
    let whole = json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 7, "character": 1 } });
    assert_eq!((edits[0]["range"].clone(), edits[1].clone()), (whole, Value::Null));
    session.change(SMOOTH);
    assert_eq!(session.diagnostics(), json!([]));
    assert_eq!(session.ask("textDocument/formatting", layout.clone()), Ok(json!([])));

    session.tell("textDocument/didClose", json!({ "textDocument": { "uri": URI } }));
    assert_eq!(session.diagnostics(), json!([]));
    assert_eq!(session.ask("textDocument/formatting", layout).expect_err("it is closed").0, -32602);
    assert_eq!(session.ask("textDocument/rename", json!({})).expect_err("unknown").0, -32601);
    assert_eq!(session.ask("textDocument/hover", json!({ "position": 3 })).expect_err("no place").0, -32602);
    session.tell("workspace/unheardOf", json!([1, 2]));
    session.tell("textDocument/didOpen", json!(null));
    assert_eq!(session.ask("shutdown", Value::Null), Ok(Value::Null));
    assert_eq!(session.ask("textDocument/hover", json!({})).expect_err("too late").0, -32600);
    session.tell("exit", Value::Null);
    assert_eq!(session.ends_with(), (Some(0), String::new()));
}

/// The faults that the server tells are those that `tpm check` prints, with their help.
#[test]
fn the_server_says_what_check_prints() {
    let folder = root().join("tests/fixtures/language/fail");
    let mut session = Session::begun();
    session.open("");
    assert!(session.diagnostics()[0]["message"].as_str().is_some_and(|own| own.contains("a model begins with")));
    let mut texts: Vec<String> =
        ["units", "slips", "unknown_name", "energies", "mechanism_words", "series", "unclosed"]
            .iter()
            .map(|name| text(&folder, &format!("{name}.tpm")))
            .collect();
    // What only the algebra finds: an input that is no force, and a pattern without a table.
    texts.push(SMOOTH.replace("= u", "= u^2"));
    texts.push(
        SMOOTH
            .replace("k*x = u;", "k*x/(1 + x) = u;\n    pattern { frequency w; x = cos(w*t); }")
            .replace(" [m]", "")
            .replace(" [N]", "")
            .replace(" [kg]", "")
            .replace(" [N/m]", ""),
    );
    let scratch = tempfile::tempdir().expect("a folder");
    for model in texts {
        session.change(&model);
        let told = session.diagnostics();
        at(scratch.path(), "model.tpm", &model);
        let checked = tpm_in(scratch.path(), &["check", "model.tpm"]);
        let printed = String::from_utf8_lossy(&checked.stdout).into_owned() + &String::from_utf8_lossy(&checked.stderr);
        let told = told.as_array().expect("a list");
        assert!(!told.is_empty(), "nothing is said of\n{model}\n{printed}");
        let errors = told.iter().filter(|own| own["severity"] == 1).count();
        assert_eq!(errors, printed.matches("Error: ").count(), "{told:#?}\n{printed}");
        for own in told {
            let message = own["message"].as_str().expect("a message");
            let (said, help) = message.split_once("\nhelp: ").unwrap_or((message, ""));
            let said = said.rsplit("will refuse it: ").next().unwrap_or_default();
            assert!(printed.contains(help), "`{help}` is not in\n{printed}");
            // The message, and what stands beside the caret.
            assert!(said.split(": ").all(|part| printed.contains(part)), "`{said}` is not in\n{printed}");
        }
    }
}

#[test]
fn texts_that_are_not_finished_are_borne() {
    let model =
        text(&root().join("models"), "rotary_pendulum.tpm") + &text(&root().join("models/robots"), "planar_arm.tpm");
    let mut session = Session::begun();
    session.open("");
    let ends = (0..model.len()).step_by(37).filter(|&end| model.is_char_boundary(end));
    for (index, end) in ends.enumerate() {
        let part = match index % 3 {
            0 => model[..end].to_owned(),
            1 => model[end..].to_owned(),
            _ => format!("{}\u{feff}\u{1d706}\r[({{{}", &model[..end / 2], &model[end..]),
        };
        session.change(&part);
        for (line, character) in [(0, 0), (3, 17), (end / 60, end % 60), (9999, 9999)] {
            let place = json!({ "textDocument": { "uri": URI }, "position": { "line": line, "character": character } });
            session.ask("textDocument/hover", place.clone()).expect("an answer");
            assert!(
                session
                    .ask("textDocument/completion", place)
                    .expect("words")
                    .as_array()
                    .is_some_and(|all| all.len() > 60)
            );
        }
        session.ask("textDocument/formatting", json!({ "textDocument": { "uri": URI } })).expect("an answer");
        if index % 10 == 0 {
            assert!(session.diagnostics().is_array());
        }
    }
    session.change(SMOOTH);
    while session.diagnostics() != json!([]) {}
}

#[test]
fn conversations_that_go_wrong_are_ended() {
    let mut session = Session::silent();
    assert_eq!(session.ask("textDocument/hover", json!({})).expect_err("too early").0, -32002);
    let (code, said) = session.ends_with();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("without `shutdown`"), "{said}");
    let mut session = Session::begun();
    session.tell("exit", Value::Null);
    assert_eq!(session.ends_with().0, Some(1));
    for nonsense in ["models/emps.tpm\n", "Content-Length: 5\r\n\r\nhello", "Content-Length: many\r\n\r\n"] {
        let refused = given(nonsense, &["lsp"]);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(said.contains("type `tpm check FILE`"), "{said}");
    }
}

/// The words that a pattern of the grammar chooses from.
fn chosen(grammar: &Value, of: &str) -> BTreeSet<String> {
    let pattern = grammar["repository"][of]["match"].as_str().unwrap_or_else(|| panic!("{of} has a pattern"));
    let words = pattern.split(['(', ')']).nth(1).unwrap_or_else(|| panic!("{pattern} has a choice"));
    words.split('|').map(str::to_owned).collect()
}

#[test]
fn the_grammar_colours_the_words_of_the_language() {
    let grammar: Value = serde_json::from_str(&text(&root().join("editors"), "tpm.tmLanguage.json")).expect("JSON");
    let keywords: BTreeSet<String> = KEYWORDS.iter().map(|(word, ..)| (*word).to_owned()).collect();
    let coloured = chosen(&grammar, "keyword").union(&chosen(&grammar, "constant")).cloned().collect();
    assert_eq!(keywords, coloured);
    let functions = Function::ALL.iter().map(|own| own.name()).chain(Clause::names()).map(str::to_owned);
    assert_eq!(functions.collect::<BTreeSet<String>>(), chosen(&grammar, "function"));
    // Every part that is included is there.
    for part in grammar["patterns"].as_array().expect("patterns") {
        let name = part["include"].as_str().expect("a part").trim_start_matches('#');
        assert!(grammar["repository"][name].is_object(), "{name}");
    }
}
