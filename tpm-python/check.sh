#!/usr/bin/env bash
# Builds the wheel, installs it into an empty environment, and runs its tests, the type checker, the chapter of the book and the
# notebook. The command line, with which the tests compare, is `TPM`, or is built.
#
#   tpm-python/check.sh [FOLDER]     FOLDER is where the wheel that was tested is left
set -euo pipefail
if [ -n "${TPM:-}" ]; then TPM=$(realpath "$TPM"); fi
kept=${1:+$(realpath "$1")}
cd "$(dirname "$0")"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if [ -z "${TPM:-}" ]; then
  (cd .. && cargo build --release --locked -p tpm-cli)
  target=${CARGO_TARGET_DIR:-../target}
  TPM=$(realpath "$target/release/tpm")
fi
export TPM

python3 -m venv "$work/build"
"$work/build/bin/pip" install --quiet "maturin>=1.9,<2"
"$work/build/bin/maturin" build --release --locked --interpreter "$work/build/bin/python" --out "$work/wheels"
ls "$work/wheels"

# Another environment: what the wheel needs is what pip brings with it.
python3 -m venv "$work/fresh"
"$work/fresh/bin/pip" install --quiet "$work"/wheels/*.whl
(cd "$work" && fresh/bin/python -c 'import tpm; print("tpm", tpm.__version__)')

"$work/fresh/bin/pip" install --quiet pytest mypy pandas polars pandas-stubs nbclient nbformat ipykernel typing_extensions
"$work/fresh/bin/python" -m pytest -q -p no:cacheprovider tests
# Types of the stubs as users of the module have them, and the stubs against the module itself.
MYPYPATH=tests "$work/fresh/bin/mypy" --strict --cache-dir "$work/mypy" tests python/tpm
# And as users copy them from the notebook.
"$work/fresh/bin/python" - ../docs/first.ipynb >"$work/notebook.py" <<'PY'
import json
import sys

cells = json.load(open(sys.argv[1]))["cells"]
print("\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"))
PY
"$work/fresh/bin/mypy" --strict --cache-dir "$work/mypy" "$work/notebook.py"
# What maturin adds to the module.
printf '%s\n' 'tpm\._tpm\.__all__' >"$work/allowed"
"$work/fresh/bin/python" -m mypy.stubtest tpm._tpm --ignore-disjoint-bases --allowlist "$work/allowed"
if [ -n "$kept" ]; then cp "$work"/wheels/*.whl "$kept"; fi
