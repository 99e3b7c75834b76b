//! Keeps the elementary functions of the wheel its own.

use std::env;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // An ELF library exports `sin` and its like, which `tpm-elementary` defines by these names, and its own calls go by the name too: the
    // loader finds the function of the C library first, which Python has loaded. As archives export nothing, their calls are bound when
    // the wheel is linked. Libraries of macOS and Windows bind their own functions so in any case.
    let elf = env::var_os("CARGO_CFG_UNIX").is_some() && env::var("CARGO_CFG_TARGET_VENDOR").as_deref() != Ok("apple");
    if elf {
        println!("cargo::rustc-link-arg-cdylib=-Wl,--exclude-libs,ALL");
    }
}
