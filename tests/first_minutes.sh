#!/usr/bin/env bash
# A new user's path with a program that is built already, step by step with its time: the README's first command, then init, edit,
# simulate, identify, report, a log, C.
#
#   tests/first_minutes.sh TPM      TPM is the program
set -euo pipefail
tpm=$(realpath "$1")
models=$(realpath "$(dirname "$0")/../models")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

step() {
  local begin end
  begin=$(date +%s.%N)
  "${@:2}" >"$folder/said" 2>&1 || { cat "$folder/said" >&2; exit 1; }
  end=$(date +%s.%N)
  printf '%6.2f s  %s\n' "$(awk -v a="$begin" -v b="$end" 'BEGIN { print b - a }')" "$1"
}

step "identify the README's machine" "$tpm" identify "$models/mass_spring_drag.tpm"
step "init" "$tpm" init my_cart
step "edit: a dry friction" sed -i 's/+ k\*x = u/+ k*x + f*sign(dot(x)) = u/; s/k \[N\/m\];/k [N\/m], f [N];/' my_cart.tpm
sed -i 's/k = 40.0 }/k = 40.0, f = 1.5 }/; s/^k = 0.0/k = 0.0\nf = 0.0/' my_cart.toml
step "check" "$tpm" check my_cart.tpm
step "identify on the simulated machine, with a report" "$tpm" identify my_cart.tpm --report campaign
step "simulate a log" "$tpm" simulate my_cart.tpm -o run.csv
step "inspect the log" "$tpm" inspect run.csv my_cart.tpm
step "identify from the log, with a report" "$tpm" identify my_cart.tpm --log run.csv --hold zoh --report log --json -o result.json
step "C with the identified values" "$tpm" generate my_cart.tpm --lang c --params result.json -o generated
if command -v cc >/dev/null; then
  step "C compiled" cc -std=c99 -Wall -Werror -c generated/*.c -o my_cart.o
fi
