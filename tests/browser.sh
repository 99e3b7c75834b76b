#!/usr/bin/env bash
# Reports in a real browser: no error on the console, no page wider than its screen at 390 and 1400 pixels.
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

# The page in a frame of the width that is asked for, and how much wider it is than its frame.
cat >"$folder/frame.html" <<'HTML'
<!DOCTYPE html><body><script>
const [page, width] = location.hash.slice(1).split(",");
const frame = document.createElement("iframe");
frame.style.cssText = `width:${width}px;height:900px;border:0`;
frame.onload = () => { document.title = "done"; const root = frame.contentDocument.documentElement;
  document.body.setAttribute("data-over", root.scrollWidth - root.clientWidth); };
frame.src = page; document.body.append(frame);
</script></body>
HTML

for page in cart arm study; do
  for width in 390 1400; do
    found=$("$browser" --headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking \
      --disable-component-update --disable-sync --user-data-dir="$folder/profile" --allow-file-access-from-files \
      --enable-logging=stderr --virtual-time-budget=5000 --dump-dom "file://$folder/frame.html#$page/report.html,$width" 2>"$folder/said")
    over=$(sed -n 's/.*data-over="\([^"]*\)".*/\1/p' <<<"$found")
    if [ "$over" != 0 ]; then
      echo "the report of $page is ${over:-?} pixels wider than a screen of $width" >&2
      exit 1
    fi
    if grep -E 'CONSOLE' "$folder/said" >&2; then
      echo "the report of $page has errors on the console" >&2
      exit 1
    fi
  done
done
echo "reports in a browser: no error, nothing wider than 390 and 1400 pixels"
