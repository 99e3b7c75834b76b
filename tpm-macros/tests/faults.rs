//! What a user of the macros sees: every fault on the tokens that are at fault, as a compiler shows it. The macros' expansion is called
//! here, so that nothing is compiled; what the compiler adds of its own may change with it.

use std::fmt::Write as _;
use std::path::Path;
use syn::{File, Item, LitStr, Macro};

/// The macro call of a file.
fn call(file: &File) -> &Macro {
    let mut calls = file.items.iter().filter_map(|item| match item {
        Item::Macro(item) => Some(&item.mac),
        _ => None,
    });
    calls.next().expect("a macro is called")
}

/// The faults of a file's macro call, laid out as a compiler does.
fn shown(path: &str, source: &str) -> String {
    let file = syn::parse_file(source).expect("tokens");
    let call = call(&file);
    let name = call.path.segments.last().expect("a name").ident.to_string();
    let expansion = match name.as_str() {
        "model" => tpm_codegen::inline::model(call.tokens.clone()),
        _ => tpm_codegen::inline::model_file(call.tokens.clone(), Some(Path::new(env!("CARGO_MANIFEST_DIR")))),
    };
    let expansion: File = syn::parse2(expansion).expect("items");
    let mut text = String::new();
    for item in &expansion.items {
        let Item::Macro(item) = item else { continue };
        let error = &item.mac.path.segments.last().expect("a name").ident;
        assert_eq!(error, "compile_error", "{path}: no fault");
        let message: LitStr = item.mac.parse_body().expect("a message");
        // A compiler shows an error from its first token to its last one.
        let (start, end) = (error.span().start(), item.mac.delimiter.span().join().end());
        assert_eq!(start.line, end.line, "{path}: a fault within one line");
        let line = source.lines().nth(start.line - 1).expect("a line of the file");
        let gutter = " ".repeat(start.line.to_string().len());
        let (place, carets) = (" ".repeat(start.column), "^".repeat(end.column - start.column));
        let message = message.value().replace('\n', "\n       ");
        let (number, column) = (start.line, start.column + 1);
        write!(
            text,
            "error: {message}\n{gutter}--> {path}:{number}:{column}\n{gutter} |\n{number} | {line}\n{gutter} | {place}{carets}\n\n"
        )
        .expect("memory");
    }
    text.trim_end().to_owned() + "\n"
}

#[test]
fn faults_are_shown_on_the_users_tokens() {
    for name in [
        "free_coordinate",
        "impossible_part",
        "many_harmonics",
        "no_chain",
        "no_dynamics",
        "no_feed_forward",
        "no_path",
        "no_run",
        "no_strokes",
        "not_linear",
        "nothing_forgets",
        "several_faults",
        "unknown_part",
    ] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ui");
        let read = |ending: &str| std::fs::read_to_string(folder.join(format!("{name}.{ending}"))).expect("readable");
        assert_eq!(shown(&format!("tests/ui/{name}.rs"), &read("rs")), read("stderr"), "{name}");
    }
}
