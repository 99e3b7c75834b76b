#!/usr/bin/env bash
# Seconds that a crate which uses `model_file!` takes to build from nothing, and after a change of its model, with cargo's default
# profiles, in a folder of its own. Dependencies are fetched before the clock starts. Prints what compiled longest. Other work on
# the machine counts: the load is printed beside the times.
# Usage: benches/clean_build.sh [FEATURE,...]; `macros` alone when nothing is given, for programs without the standard library.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
features=${1:-macros}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/src"
cp "$root/models/mass_spring_drag.tpm" "$work/model.tpm"
cp "$root/Cargo.lock" "$work/"
cat >"$work/Cargo.toml" <<TOML
[package]
name = "user"
version = "0.0.0"
edition = "2024"

[workspace]

[dependencies]
tpm-runtime = { path = "$root/tpm-runtime", default-features = false, features = [$(sed 's/[^,]*/"&"/g' <<<"$features")] }
TOML
cat >"$work/src/main.rs" <<'RUST'
tpm_runtime::model_file!("model.tpm");
fn main() {
    let motion = mass_spring_drag::Pattern { lambda: 0.3, w: 3.0 }.reference(0.1);
    println!("{}", mass_spring_drag::feed_forward(&motion, &mass_spring_drag::Parameters { m: 2.0, k1: 40.0, k2: 1.5 }).u);
}
RUST
unset RUSTFLAGS CARGO_PROFILE_DEV_OPT_LEVEL CARGO_PROFILE_DEV_BUILD_OVERRIDE_OPT_LEVEL CARGO_INCREMENTAL
export CARGO_TARGET_DIR="$work/target"
cd "$work"
cargo fetch --quiet
seconds() {
    local start end
    start=$(date +%s.%N)
    cargo build --quiet "$@"
    end=$(date +%s.%N)
    awk -v a="$start" -v b="$end" 'BEGIN { printf "%.2f", b - a }'
}
echo "features $features, $(nproc) cores, load $(cut -d' ' -f1 /proc/loadavg) before"
clean=$(seconds --timings)
echo "from nothing: $clean s, $(grep -c '^\[\[package' Cargo.lock) packages in the lock file, load $(cut -d' ' -f1 /proc/loadavg)"
# The report holds its data as one list.
python3 - "$CARGO_TARGET_DIR" <<'PYTHON'
import glob, json, re, sys
[report] = glob.glob(sys.argv[1] + "/cargo-timings/cargo-timing-*.html")[:1]
units = json.loads(re.search(r"const UNIT_DATA = (\[.*?\]);", open(report).read(), re.S).group(1))
for unit in sorted(units, key=lambda unit: -unit["duration"])[:8]:
    print(f"  {unit['duration']:6.2f} s  {unit['name']} {unit['version']}{unit.get('target') or ''}")
PYTHON
for change in 1 2 3; do
    sed -i "s/rest_to_rest(lambda, w, .)\|lambda\*(cos.*;/lambda*(cos(w*t) - 1\/$((9 + change))*cos(3*w*t));/" model.tpm
    grep -q "1/$((9 + change))" model.tpm || { echo "the model was not changed" >&2; exit 1; }
    echo "after a change of the model: $(seconds) s"
done
