//! What a user of the macro sees. Only messages that are wholly ours are here: a compiler's own may change with it.

#[test]
fn faults_are_shown_on_the_users_tokens() {
    trybuild::TestCases::new().compile_fail("tests/ui/*.rs");
}
