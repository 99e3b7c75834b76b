//! The `tpm` command line.
fn main() {}
