"""The page in Chromium, driven by its WebDriver: what `tests/web/run` runs.

Every log is identified twice, by the command line and in the page, from the same files with the same settings, and the two results are
compared as text.
"""

import base64
import json
import os
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Longest time of an answer, s.
LONGEST = 300


class Browser:
    """A session of the WebDriver protocol, as far as it is needed here."""

    def __init__(self, folder):
        self.port = 4000 + os.getpid() % 20000
        self.driver = subprocess.Popen(
            ["chromedriver", f"--port={self.port}", "--silent"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.session = ""
        found = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])))
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
                 "--disable-background-networking", "--disable-component-update", "--disable-sync", f"--user-data-dir={folder}/profile"]
        asked = {"capabilities": {"alwaysMatch": {
            "goog:chromeOptions": {"binary": found, "args": flags}, "goog:loggingPrefs": {"browser": "ALL"},
            "unhandledPromptBehavior": "accept"}}}
        for _ in range(100):
            try:
                self.session = f"/session/{self.call('POST', '/session', asked)['sessionId']}"
                break
            except (urllib.error.URLError, ConnectionError):
                time.sleep(0.1)
        else:
            raise SystemExit("the driver of Chromium does not answer")
        self.call("POST", "/timeouts", {"script": LONGEST * 1000})

    def call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{self.session}{path}", data, {"Content-Type": "application/json"}, method=method)
        with urllib.request.urlopen(request, timeout=LONGEST + 10) as answer:
            return json.load(answer)["value"]

    def open(self, address):
        self.call("POST", "/url", {"url": address})
        self.wait("return !document.querySelector('main').hidden || !document.getElementById('trouble').hidden")

    def run(self, script, *arguments):
        return self.call("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def wait(self, script, longest=LONGEST):
        end = time.monotonic() + longest
        while time.monotonic() < end:
            found = self.run(script)
            if found:
                return found
            time.sleep(0.05)
        raise SystemExit(f"waited {longest} s for: {script}")

    def files(self, *paths):
        element = self.call("POST", "/element", {"using": "css selector", "value": "#files"})
        self.call("POST", f"/element/{next(iter(element.values()))}/value", {"text": "\n".join(map(str, paths))})

    def picture(self, path, width):
        self.call("POST", "/goog/cdp/execute", {"cmd": "Emulation.setDeviceMetricsOverride", "params": {
            "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}})
        time.sleep(0.4)
        over = self.run("const r = document.documentElement; return r.scrollWidth - r.clientWidth")
        if path:
            height = self.run("return Math.min(document.documentElement.scrollHeight, 12000)")
            shot = self.call("POST", "/goog/cdp/execute", {"cmd": "Page.captureScreenshot", "params": {
                "captureBeyondViewport": True, "clip": {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}}})
            Path(path).write_bytes(base64.b64decode(shot["data"]))
        self.call("POST", "/goog/cdp/execute", {"cmd": "Emulation.clearDeviceMetricsOverride", "params": {}})
        return over

    def complaints(self):
        entries = self.call("POST", "/se/log", {"type": "browser"})
        # A page that nobody has touched may not ask before it is closed, which the browser says.
        own = [entry["message"] for entry in entries if entry["level"] in ("SEVERE", "WARNING")]
        return [message for message in own if "beforeunload" not in message]

    def close(self):
        try:
            self.call("DELETE", "")
        finally:
            self.driver.terminate()
            self.driver.wait()


def fault(place):
    return f"const at = document.getElementById('{place}'); return at.hidden ? '' : at.textContent"


SET = """
const settings = arguments[0];
for (const [id, value] of Object.entries(settings)) if (id !== "signals") document.getElementById(id).value = value;
for (const [signal, fields] of Object.entries(settings.signals || {}))
  for (const [kind, value] of Object.entries(fields))
    document.querySelector(`[data-signal="${signal}"][data-kind="${kind}"]`).value = value;
"""


def fresh(browser, address):
    browser.run("try { localStorage.clear() } catch {}")
    browser.open(address)


def identified(browser, address, case):
    """The page's result, and how long it took, from the button to the report, s."""
    fresh(browser, address)
    browser.files(case["model"])
    browser.wait("return state.described && !state.faulty")
    browser.files(*case["logs"])
    browser.wait("return !document.getElementById('seen').hidden || !document.getElementById('log-fault').hidden")
    browser.run(SET, case.get("settings", {}))
    begin = time.monotonic()
    browser.wait("return !document.getElementById('go').disabled")
    browser.run("state.result = null; document.getElementById('go').click()")
    # The page answers while the worker computes.
    alive, shown = 0, ""
    while not browser.run("return !state.running"):
        alive += 1
        shown = browser.run("return document.getElementById('busy').textContent")
        time.sleep(0.05)
    took = time.monotonic() - begin
    refused = browser.run(fault("fault"))
    result = browser.run("return state.result && state.result.result")
    return result, refused, took, alive, shown


def command_line(tpm, folder, case):
    out = folder / "cli.json"
    out.unlink(missing_ok=True)
    words = [tpm, "identify", case["model"].name]
    for log in case["logs"]:
        words += ["--log", log.name]
    begin = time.monotonic()
    done = subprocess.run([*words, *case.get("flags", []), "--json", "-o", str(out)], cwd=case["model"].parent, capture_output=True, text=True)
    took = time.monotonic() - begin
    return (out.read_text() if out.exists() else None), done.stderr, took


def numbers(value, path=""):
    """All numbers of a result by their place."""
    if isinstance(value, dict):
        for key, own in value.items():
            yield from numbers(own, f"{path}.{key}")
    elif isinstance(value, list):
        for n, own in enumerate(value):
            yield from numbers(own, f"{path}[{n}]")
    elif isinstance(value, float):
        yield path, value


def difference(one, other):
    """How two results differ: none, or the largest difference of two numbers in the same place, as a share of the larger one."""
    one, other = (dict(numbers(json.loads(text))) for text in (one, other))
    if one.keys() != other.keys():
        return "other fields: " + ", ".join(sorted(one.keys() ^ other.keys())[:3])
    worst = max(((abs(one[at] - other[at]) / max(abs(one[at]), abs(other[at])), at) for at in one if one[at] != other[at]), default=None)
    return f"{sum(one[at] != other[at] for at in one)} of {len(one)} numbers differ, by up to {worst[0]:.1e} ({worst[1]})" if worst else "other texts"


def simulated(tpm, folder, name, model, experiment, changes=()):
    """A log of a simulated machine, beside its model."""
    place = folder / name
    place.mkdir()
    shutil.copy(model, place)
    log = place / "run.csv"
    words = [tpm, "simulate", str(model), "--experiment", str(experiment), "-o", str(log)]
    for change in changes:
        words += ["--set", change]
    subprocess.run(words, check=True, stderr=subprocess.DEVNULL)
    return place / model.name, log


def cases(tpm, folder):
    models = ROOT / "models"
    sample = ROOT / "tpm-runtime/crates/session/src/sample"
    zoh = {"settings": {"hold": "zoh"}, "flags": ["--hold", "zoh"]}
    model, log = simulated(tpm, folder, "slide", sample / "slide.tpm", sample / "slide.toml")
    yield {"name": "slide", "model": model, "logs": [log], **zoh}
    again = model.parent / "again.csv"
    subprocess.run([tpm, "simulate", str(sample / "slide.tpm"), "--set", "seed=2", "-o", str(again)], check=True, stderr=subprocess.DEVNULL)
    yield {"name": "slide, two logs", "model": model, "logs": [log, again], **zoh}
    model, log = simulated(tpm, folder, "cart", models / "mass_spring_drag.tpm", models / "mass_spring_drag.toml")
    yield {"name": "mass, spring and drag", "model": model, "logs": [log], **zoh}
    yield {"name": "the same, a value held, every sample", "model": model, "logs": [log],
           "settings": {"hold": "zoh", "held": "k1 = 40", "domain": "time", "signals": {"u": {"delay": "fit"}}},
           "flags": ["--hold", "zoh", "--freeze", "k1=40", "--domain", "time", "--delay", "u=fit"]}
    model, log = simulated(tpm, folder, "two", models / "two_carts.tpm", models / "two_carts.toml")
    yield {"name": "two carts", "model": model, "logs": [log], **zoh}
    model, log = simulated(tpm, folder, "dry", models / "rotary_pendulum_dry.tpm", models / "rotary_pendulum_dry.toml")
    yield {"name": "pendulum with dry friction", "model": model, "logs": [log], **zoh}
    logs = ROOT / "tests/fixtures/logs"
    place = folder / "formats"
    place.mkdir()
    shutil.copy(sample / "slide.tpm", place)
    for name in ("matlab5.mat", "arrays.npz", "columns.json", "slider.wpilog", "joint_states.db3", "slider.csv"):
        shutil.copy(logs / name, place)
        yield {"name": name, "model": place / "slide.tpm", "logs": [place / name], **zoh}
    model, log = simulated(tpm, folder, "long", sample / "slide.tpm", sample / "slide.toml", ["schedule.measure_time=100.0"])
    yield {"name": "one coordinate, 100,000 rows", "model": model, "logs": [log], **zoh, "within": 10}
    robot = os.environ.get("TPM_DATA") and Path(os.environ["TPM_DATA"]) / "robots/ur10_robot.urdf"
    if robot and robot.exists():
        place = folder / "ur10"
        place.mkdir()
        subprocess.run([tpm, "import", str(robot), "-o", str(place / "ur10.tpm")], check=True, stderr=subprocess.DEVNULL)
        log = place / "run.csv"
        subprocess.run([tpm, "simulate", str(place / "ur10.tpm"), "--experiment", str(place / "ur10.experiment.toml"),
                        "--set", "schedule.measure_time=10.0", "-o", str(log)], check=True, stderr=subprocess.DEVNULL)
        yield {"name": "UR10 from its URDF", "model": place / "ur10.tpm", "logs": [log], "within": 30,
               "settings": {"hold": "zoh", "known": (place / "ur10.prior.toml").read_text()},
               "flags": ["--hold", "zoh", "--prior", "ur10.prior.toml"]}


def compare(browser, address, tpm, folder):
    short = []
    for case in cases(tpm, folder):
        own, refused, took, alive, shown = identified(browser, address, case)
        other, said, beside = command_line(tpm, folder, case)
        rows = sum(1 for _ in case["logs"][0].open("rb"))
        if own is None or other is None:
            same = own is None and other is None
            print(f"{case['name']}: refused by {'both' if same else 'one of them'}: {refused[:100]!r}, {said[:100]!r}")
            short += [] if same else [f"{case['name']}: page {refused!r}, command line {said!r}"]
            continue
        same = own == other
        print(f"{case['name']}: {rows} lines, page {took:.2f} s, command line {beside:.2f} s, "
              f"{'the same to the last digit' if same else difference(own, other)}", flush=True)
        if not same:
            short.append(f"{case['name']}: {difference(own, other)}")
        if took > case.get("within", LONGEST):
            short.append(f"{case['name']}: {took:.1f} s in the page, {case['within']} s are asked for")
        if took > 1 and alive < 3:
            short.append(f"{case['name']}: the page did not answer while it identified")
    return short


def bad_input(browser, address, folder, tpm):
    """What goes wrong is told by a sentence, and the page goes on."""
    short = []

    def expect(what, found, *words):
        right = found and all(word in found for word in words)
        print(f"{what}: {found!r}")
        if not right:
            short.append(f"{what}: {found!r} says nothing of {words}")

    fresh(browser, address)
    huge, binary, empty = folder / "huge.csv", folder / "noise.csv", folder / "empty.csv"
    with huge.open("wb") as file:
        file.truncate(2 << 30)
    binary.write_bytes(bytes(range(256)) * 400)
    empty.write_bytes(b"")
    for path, words in ((huge, ["2.1 GB"]), (binary, ["noise.csv"]), (empty, ["empty.csv", "empty"])):
        browser.files(path)
        expect(f"a log of {path.name}", browser.wait(fault("log-fault"), 60), *words)
    huge.unlink()
    wrong = folder / "wrong.tpm"
    wrong.write_text("model Wrong {\n  coordinate x [m];\n  input u [N];\n  parameter m [kg];\n  m*ddot(x) + q = u;\n}\n")
    browser.files(wrong)
    expect("a fault in a model", browser.wait("return document.getElementById('findings').textContent"), "line 5")
    if browser.run("return !document.getElementById('go').disabled"):
        short.append("a model with a fault can be identified")
    # Another model begins without what was said of the one before, also while it is not read yet.
    left = browser.run("write('next.tpm', 'model Next {}'); return document.getElementById('findings').textContent + document.getElementById('marks').querySelectorAll('mark').length")
    if left != "0":
        short.append(f"faults of a former model stand beside the next one: {left!r}")
    vast = folder / "vast.tpm"
    vast.write_text(
        "model Vast { coordinate q; input u; parameter m, k; m*ddot(q) + k*abs(ddot(q)^400) = u;\n"
        "  pattern { amplitude l; frequency w; q = rest_to_rest(l, 2*w, 5); } }\n"
    )
    browser.files(vast)
    expect("a model that takes too much", browser.wait("return state.name === 'vast.tpm' && document.getElementById('findings').textContent"), "operations")
    # A column that is not there, and the field that helps.
    place = ROOT / "tpm-runtime/crates/session/src/sample/slide.tpm"
    log = folder / "other.csv"
    log.write_text("t_s,a,b\n" + "".join(f"{n / 100},{n % 7},{n % 5}\n" for n in range(400)))
    browser.files(place)
    browser.wait("return state.name === 'slide.tpm' && !state.faulty")
    browser.files(log)
    browser.wait("return !document.getElementById('seen').hidden")
    browser.run("document.getElementById('go').click()")
    expect("a column that is not there", browser.wait(fault("fault")), "x", "Signals")
    # Stopped midway, and identified again.
    browser.files(folder / "long/run.csv")
    browser.wait("return !document.getElementById('seen').hidden && !document.getElementById('go').disabled")
    browser.run("document.getElementById('hold').value = 'zoh'; document.getElementById('go').click()")
    browser.wait("return /identifying/.test(document.getElementById('busy').textContent)")
    browser.run("document.getElementById('stop').click()")
    expect("stopped midway", browser.run("return document.getElementById('busy').textContent"), "Stopped")
    browser.run("document.getElementById('go').click()")
    browser.wait("return /identifying/.test(document.getElementById('busy').textContent)")
    # The tab is closed midway, and opened again.
    browser.open(address)
    expect("closed midway", browser.wait(fault("log-fault")), "closed", "run.csv")
    if browser.run("return document.getElementById('model').value") != place.read_text():
        short.append("closed midway: the model is not there any more")
    return short


def looks(browser, address, pictures):
    """Nothing is wider than the screen, before and after an identification; what is typed beforehand is the sample."""
    short = []

    def look(name):
        for width in (1400, 390):
            over = browser.picture(pictures and pictures / f"{name}_{width}.png", width)
            if over > 0:
                short.append(f"{name}: {over} pixels wider than {width}")

    fresh(browser, address)
    look("empty")
    browser.run("document.getElementById('sample').click()")
    browser.wait("return !document.getElementById('seen').hidden && !document.getElementById('go').disabled")
    browser.run("document.getElementById('go').click()")
    browser.wait("return !document.getElementById('result').hidden")
    time.sleep(1)
    look("sample")
    for name, ending in (("c", ".c"), ("rust", ".rs")):
        made = browser.call("POST", "/execute/async", {"script": """
            const [language, done] = arguments;
            reader.ask({ ask: "generate", model: state.result.model, language, result: state.result.result }).then(done)""", "args": [name]})
        if not any(file["name"].endswith(ending) for file in made.get("files", [])):
            short.append(f"no code in {name}: {made}")
    browser.run("document.getElementById('model').value += '\\n  equation x = y;'; document.getElementById('model').oninput()")
    browser.wait("return document.getElementById('findings').children.length > 0")
    look("fault")
    return short


def main():
    tpm, page, folder = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    pictures = Path(sys.argv[4]) if len(sys.argv) > 4 else None
    if pictures:
        pictures.mkdir(parents=True, exist_ok=True)
    address = (page / "index.html").as_uri()
    packed = sum(file.stat().st_size for file in page.iterdir())
    print(f"the folder has {packed / 1e6:.2f} MB")
    short = [] if packed < 6e6 else [f"the folder has {packed} bytes, 6 MB are asked for"]
    browser = Browser(folder)
    try:
        short += compare(browser, address, tpm, folder)
        short += bad_input(browser, address, folder, tpm)
        short += looks(browser, address, pictures)
        short += [f"the console says: {text}" for text in browser.complaints()]
    finally:
        browser.close()
    if short:
        raise SystemExit("\n".join(["", *short]))
    print("the page in a browser: as the command line")


main()
