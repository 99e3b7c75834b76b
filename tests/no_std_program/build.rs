//! No start-up files: the program begins at its own `_start`. The C library is there for the four memory routines that the
//! compiler itself calls; `check.sh` sees to it that nothing else is taken from it.

fn main() {
    println!("cargo:rustc-link-arg-bins=-nostartfiles");
    println!("cargo:rustc-link-arg-bins=-lc");
}
