//! Sources that a build script makes of a model file.

use crate::support::root;
use tpm_codegen::build::{BuildError, write};
use tpm_codegen::generate::{Language, Options};

#[test]
fn a_module_to_include_or_two_files_for_a_compiler() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = root().join("models/mass_spring_drag.tpm");
    let rust = write(&model, &Options::new(Language::Rust, "build.rs"), folder.path()).expect("a shipped model");
    assert_eq!(rust, [folder.path().join("mass_spring_drag.rs")]);
    let text = std::fs::read_to_string(&rust[0]).expect("it was written");
    assert!(text.starts_with("pub mod mass_spring_drag {\n//! `MassSpringDrag`") && text.ends_with("}\n}\n"));
    let file = syn::parse_file(&text).expect("Rust");
    assert!(matches!(file.items.as_slice(), [syn::Item::Mod(_)]) && file.attrs.is_empty());

    let c = write(&model, &Options::new(Language::C, "build.rs"), folder.path()).expect("a shipped model");
    assert_eq!(c, ["mass_spring_drag.h", "mass_spring_drag.c"].map(|name| folder.path().join(name)));
    let names: Vec<_> = std::fs::read_dir(folder.path()).expect("readable").collect();
    assert_eq!(names.len(), 3, "nothing else is left: {names:?}");
}

#[test]
fn faults_say_where() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("type.tpm");
    let rust = Options::new(Language::Rust, "build.rs");
    let fault = |folder: &std::path::Path| write(&path, &rust, folder).expect_err("it cannot be written");
    assert!(matches!(fault(folder.path()), BuildError::Read { .. }));
    std::fs::write(&path, "model Type {\n coordinate x; input u; parameter m;\n m*ddot(y) = u;\n}\n")
        .expect("writable");
    let shown = format!("{:?}", fault(folder.path()));
    assert!(shown.contains("type.tpm:3:9") && shown.contains("`y`"), "{shown}");
    std::fs::write(&path, "model Type {\n coordinate x; input u; parameter m;\n m*ddot(x) = u;\n}\n")
        .expect("writable");
    assert!(matches!(fault(&folder.path().join("missing")), BuildError::Write { .. }));
    let written = write(&path, &rust, folder.path()).expect("it is whole");
    let text = std::fs::read_to_string(&written[0]).expect("it was written");
    assert!(text.starts_with("pub mod r#type {\n"), "{}", &text[..40]);
}
