//! Holds the integration tests of the workspace, the list of the generated sources that they compile, and the Rust examples of the READMEs
//! and of the book.

pub mod goldens;

#[cfg(doctest)]
mod readme {
    #[doc = include_str!("../../README.md")]
    struct Workspace;

    #[doc = include_str!("../../docs/library.md")]
    struct Library;

    #[doc = include_str!("../../tpm-codegen/README.md")]
    struct Codegen;

    #[doc = include_str!("../../tpm-controller/README.md")]
    struct Core;

    #[doc = include_str!("../../tpm-macros/README.md")]
    struct Macros;

    #[doc = include_str!("../../tpm-runtime/README.md")]
    struct Runtime;

    #[doc = include_str!("../../tpm-symbolic/README.md")]
    struct Symbolic;
}
