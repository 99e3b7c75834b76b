//! The committed sources of the shipped models, in `tests/generated`, are what the generator writes.

use crate::support::{estimator, models_in, root};
use tpm_codegen::generate::{Language, Options, generate};

#[test]
fn committed_sources_are_current() {
    let mut stale = Vec::new();
    for path in models_in("models") {
        let estimator = estimator(&path);
        let name = path.file_name().expect("a file").to_string_lossy().into_owned();
        for (language, lang) in [(Language::Rust, "rust"), (Language::C, "c")] {
            let command = format!("tpm generate {name} --lang {lang}");
            for file in generate(&estimator, &Options::new(language, &command)).expect("shipped models are whole") {
                let present = std::fs::read_to_string(root().join("tests/generated").join(&file.name));
                let present = present.unwrap_or_default();
                if present != file.text {
                    let same = present.lines().zip(file.text.lines()).take_while(|(a, b)| a == b).count();
                    stale.push(format!(
                        "{} differs from line {}: `cargo run -- generate models/{name} --lang {lang} -o tests/generated`",
                        file.name,
                        same + 1
                    ));
                }
            }
        }
    }
    assert!(stale.is_empty(), "{}", stale.join("\n"));
}
