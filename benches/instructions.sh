#!/usr/bin/env bash
# Instructions per call of generated and hand-written code, by callgrind, and their ratio.
set -euo pipefail
cd "$(dirname "$0")/.."
command -v valgrind >/dev/null || { echo "valgrind is needed (Debian: apt-get install valgrind)" >&2; exit 2; }
cargo build --release --quiet -p tpm-benches --bin generated_instructions
program="${CARGO_TARGET_DIR:-target}/release/generated_instructions"
count() {
    valgrind --tool=callgrind --callgrind-out-file=/dev/null "$program" "$1" "$2" "$3" 2>&1 |
        sed -n 's/.*Collected : \([0-9]*\).*/\1/p'
}
for model in slider arm; do
    for kind in hand generated; do
        few=$(count "$model" "$kind" 1000)
        many=$(count "$model" "$kind" 11000)
        declare "$kind=$(((many - few) / 10))"
    done
    # Instructions of a thousand calls: whole numbers of them per call, kept to three digits.
    awk -v m="$model" -v h="$hand" -v g="$generated" \
        'BEGIN { printf "%-7s by hand %.1f, generated %.1f instructions a call, ratio %.3f\n", m, h / 1000, g / 1000, g / h }'
done
