#!/usr/bin/env bash
# Milliseconds that the compiler spends in `model!`, in a workspace of its own with cargo's default profiles: macros are then
# built without optimisation, as users build them. The median of RUNS compilations, for each model given (Feng, Eqn 3.24 when
# none is), and instructions by callgrind where valgrind is installed.
#
#   benches/macro_time.sh [MODEL.tpm ...]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
runs=${RUNS:-11}
[ $# -gt 0 ] || set -- "$root/models/mass_spring_drag.tpm"
models=()
for model in "$@"; do models+=("$(realpath "$model")"); done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work"/{timed,user,counted}/src
cat >"$work/Cargo.toml" <<TOML
[workspace]
resolver = "2"
members = ["timed", "user", "counted"]
TOML
cp "$root/Cargo.lock" "$work/"
package() { printf '[package]\nname = "%s"\nversion = "0.0.0"\nedition = "2024"\n' "$1"; }
dependency() { printf '%s = { path = "%s/%s", default-features = false }\n' "$1" "$root" "$1"; }

# The macro's one line, with a clock around it.
{ package timed; printf '[lib]\nproc-macro = true\n[dependencies]\n'; dependency tpm-codegen; } >"$work/timed/Cargo.toml"
cat >"$work/timed/src/lib.rs" <<'RUST'
#[proc_macro]
pub fn model(input: proc_macro::TokenStream) -> proc_macro::TokenStream {
    let start = std::time::Instant::now();
    let output = tpm_codegen::inline::model(input.into()).into();
    eprintln!("expanded in {:.3} ms", 1e3 * start.elapsed().as_secs_f64());
    output
}
RUST
{ package user; printf '[dependencies]\ntimed = { path = "../timed" }\n'; dependency tpm-runtime; } >"$work/user/Cargo.toml"

# The same work outside the compiler, so that it can be counted.
{ package counted; printf '[dependencies]\nproc-macro2 = "1"\n'; dependency tpm-codegen; } >"$work/counted/Cargo.toml"
cat >"$work/counted/src/main.rs" <<'RUST'
use std::hint::black_box;
fn main() {
    let mut arguments = std::env::args().skip(1);
    let text = std::fs::read_to_string(arguments.next().unwrap()).unwrap();
    let tokens: proc_macro2::TokenStream = text.parse().unwrap();
    for _ in 0..arguments.next().unwrap().parse::<u32>().unwrap() {
        black_box(tpm_codegen::inline::model(black_box(tokens.clone())));
    }
}
RUST

unset RUSTFLAGS CARGO_PROFILE_DEV_OPT_LEVEL CARGO_PROFILE_DEV_BUILD_OVERRIDE_OPT_LEVEL
export CARGO_TARGET_DIR="${MACRO_TARGET_DIR:-$work/target}"
count() {
    valgrind --tool=callgrind --callgrind-out-file=/dev/null "$CARGO_TARGET_DIR/debug/counted" "$1" "$2" 2>&1 |
        sed -n 's/.*Collected : \([0-9]*\).*/\1/p'
}
cd "$work"
for model in "${models[@]}"; do
    times=()
    for _ in $(seq "$runs"); do
        { echo '#![no_std]'; echo 'timed::model! {'; cat "$model"; echo '}'; echo "// $RANDOM$RANDOM"; } >user/src/lib.rs
        said=$(cargo check --quiet -p user 2>&1) || { printf '%s\n' "$said" >&2; exit 1; }
        time=$(sed -n 's/^expanded in \(.*\) ms$/\1/p' <<<"$said")
        [ -n "$time" ] || { printf 'no time was printed:\n%s\n' "$said" >&2; exit 1; }
        times+=("$time")
    done
    median=$(printf '%s\n' "${times[@]}" | sort -n | sed -n "$((runs / 2 + 1))p")
    instructions=""
    if command -v valgrind >/dev/null; then
        cargo build --quiet -p counted
        instructions=", $((($(count "$model" 3) - $(count "$model" 1)) / 2)) instructions"
    fi
    echo "$(basename "$model"): $median ms (median of $runs)$instructions"
done
