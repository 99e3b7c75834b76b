#!/usr/bin/env bash
# Reports in a real browser: no error on the console, neither a page nor a table in it wider than its screen at 390 and 1400 pixels.
#
#   tests/browser.sh TPM      TPM is the program
set -euo pipefail
cd "$(dirname "$0")/.."
tpm=$(realpath "$1")
browser=$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)
if [ -z "$browser" ]; then
  echo "SKIPPED: reports in a browser (no Chromium is installed)"
  exit 0
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

"$tpm" identify models/mass_spring_drag.tpm --report "$folder/cart" >/dev/null
"$tpm" identify models/closed_loop_arm.tpm --experiment models/closed_loop_arm_thesis.toml --report "$folder/arm" >/dev/null 2>&1 || [ $? = 1 ]
"$tpm" study models/mass_spring_drag.tpm --seeds 3 --report "$folder/study" >/dev/null
for seed in 1 2; do
  "$tpm" simulate models/mass_spring_drag.tpm --set "seed=$seed" -o "$folder/$seed.csv" 2>/dev/null
  "$tpm" identify models/mass_spring_drag.tpm --log "$folder/$seed.csv" --hold zoh --json -o "$folder/$seed.json" --report "$folder/log" >/dev/null
done
"$tpm" compare "$folder/1.json" "$folder/2.json" --report "$folder/comparison" >/dev/null
"$tpm" validate models/mass_spring_drag.tpm --params "$folder/1.json" --log "$folder/2.csv" --hold zoh --report "$folder/validation" >/dev/null
# An arm from its description: many parameters, long names, a list of correlations.
"$tpm" import tests/fixtures/robots/mujoco.xml -o "$folder/robot.tpm" 2>/dev/null
"$tpm" simulate "$folder/robot.tpm" --experiment "$folder/robot.experiment.toml" --set schedule.measure_time=4.0 -o "$folder/robot.csv" 2>/dev/null
"$tpm" identify "$folder/robot.tpm" --log "$folder/robot.csv" --hold zoh --prior "$folder/robot.prior.toml" --report "$folder/robot" >/dev/null 2>&1 || [ $? = 1 ]

# The page in a frame of the width that is asked for, and how much wider than its frame it or one of its tables is.
cat >"$folder/frame.html" <<'HTML'
<!DOCTYPE html><body><script>
const [page, width] = location.hash.slice(1).split(",");
const frame = document.createElement("iframe");
frame.style.cssText = `width:${width}px;height:900px;border:0`;
frame.onload = () => { document.title = "done"; const shown = frame.contentDocument;
  const over = [shown.documentElement, ...shown.querySelectorAll(".scroll")].map((own) => own.scrollWidth - own.clientWidth);
  document.body.setAttribute("data-over", Math.max(...over)); };
frame.src = page; document.body.append(frame);
</script></body>
HTML

for page in cart arm study log comparison validation robot; do
  for width in 390 1400; do
    found=$("$browser" --headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking \
      --disable-component-update --disable-sync --user-data-dir="$folder/profile" --allow-file-access-from-files \
      --enable-logging=stderr --virtual-time-budget=5000 --dump-dom "file://$folder/frame.html#$page/report.html,$width" 2>"$folder/said")
    over=$(sed -n 's/.*data-over="\([^"]*\)".*/\1/p' <<<"$found")
    if [ "$over" != 0 ]; then
      echo "the report of $page, or a table in it, is ${over:-?} pixels wider than a screen of $width" >&2
      exit 1
    fi
    if grep -E 'CONSOLE' "$folder/said" >&2; then
      echo "the report of $page has errors on the console" >&2
      exit 1
    fi
  done
done
echo "reports in a browser: no error, nothing wider than screens of 390 and 1400 pixels"
