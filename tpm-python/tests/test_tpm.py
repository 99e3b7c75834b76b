"""The module beside the command line: same data, same numbers, same words."""

import datetime
import json
import os
import platform
import re
import signal
import subprocess
import sys
import threading
import time
import types
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import MODELS, Command, read

import tpm

CART = MODELS / "mass_spring_drag.tpm"


def without_names(result: dict[str, Any]) -> dict[str, Any]:
    """A result but for the name of its log, the lines of its file and their fingerprint."""
    result = json.loads(json.dumps(result))
    for key in ("path", "reading", "from_line"):
        result["log"].pop(key, None)
    for key in ("logs", "options"):
        result["provenance"].pop(key)
    return result


def test_arrays_give_the_numbers_of_the_command_line(tpm_command: Command, log: Path) -> None:
    done = tpm_command("identify", CART, "--log", log, "--hold", "zoh", "--json")
    assert done.returncode == 0, done.stderr
    expected = json.loads(done.stdout)
    columns = read(log)
    model = tpm.Model.from_file(CART)
    result = tpm.identify(model, columns["t_s"], {"x": columns["x"], "u": columns["u"]}, hold="zoh")
    assert without_names(result.to_dict()) == without_names(expected)
    assert result.names == [own["name"] for own in expected["parameters"]]
    assert result.values.tolist() == [own["value"] for own in expected["parameters"]]
    assert result.std.tolist() == [own["std"] for own in expected["parameters"]]
    assert result.covariance.tolist() == expected["covariance"]
    assert result["m"] == expected["parameters"][0]["value"]
    assert result.trusted and result.shortfall is None


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the loader of the GNU C library tells what it binds")
def test_elementary_functions_are_those_of_the_module() -> None:
    """Those of the C library would give other last digits from computer to computer."""
    told = {**os.environ, "LD_DEBUG": "bindings", "LD_BIND_NOW": "1"}
    done = subprocess.run([sys.executable, "-c", "import tpm"], env=told, capture_output=True, text=True, check=True)
    own = [line for line in done.stderr.splitlines() if re.search(r"binding file \S*/_tpm\.\S*so ", line)]
    assert own
    assert [line for line in own if "/libm." in line] == []


def test_a_log_gives_the_json_of_the_command_line(tpm_command: Command, log: Path) -> None:
    done = tpm_command("identify", CART, "--log", log, "--json")
    result = tpm.Model.from_file(CART).identify_log(log)
    assert result.json() == done.stdout
    assert result.to_dict() == json.loads(done.stdout)
    assert result.trusted == (done.returncode == 0)


def test_a_campaign_equals_that_of_the_command_line(tpm_command: Command, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    assert tpm_command("campaign", "start", CART, theirs).returncode == 0
    while tpm_command("campaign", "next", theirs, "-o", tmp_path / "run.csv").returncode == 0:
        done = tpm_command("simulate", CART, "--play", tmp_path / "run.csv", "-o", tmp_path / "log.csv")
        assert done.returncode == 0, done.stderr
        done = tpm_command("campaign", "submit", theirs, tmp_path / "log.csv")
        assert done.returncode == 0, done.stderr
    expected = json.loads(tpm_command("campaign", "result", theirs, "--json").stdout)

    campaign = tpm.Campaign.begin(tmp_path / "ours", tpm.Model.from_file(CART))
    runs = 0
    while (run := campaign.next()) is not None:
        assert set(run.samples) == {"x_ref", "x_ref_d1", "x_ref_d2", "u_ff"}
        assert run.t.shape == run.samples["x_ref"].shape
        t, signals = campaign.simulate(run)
        submitted = campaign.submit(t, signals)
        assert submitted.kept
        runs += 1
    found = campaign.result().to_dict()
    assert runs == len(expected["runs"]) > 1
    assert campaign.outcome == submitted.outcome is not None
    for result in (found, expected):
        for log in result["provenance"]["logs"]:
            log["path"] = Path(log["path"]).name
    assert found == expected
    assert tpm.Campaign.open(tmp_path / "ours").result().values.tolist() == campaign.result().values.tolist()


def test_a_simulated_machine_equals_that_of_the_command_line(tpm_command: Command) -> None:
    done = tpm_command("identify", CART, "--set", "seed=3", "--json")
    result = tpm.Model.from_file(CART).identify_simulated(changes={"seed": 3})
    assert result.json() == done.stdout


def test_changes_of_an_experiment_are_values(tpm_command: Command) -> None:
    stage = {"lambda": 0.2, "w": 4.4}
    done = tpm_command("identify", CART, "--set", "schedule.stages=[{ lambda = 0.2, w = 4.4 }]", "--set", "schedule.avoid_modes=true", "--json")
    model = tpm.Model.from_file(CART)
    result = model.identify_simulated(changes={"schedule.stages": [stage], "schedule.avoid_modes": True})
    assert result.json() == done.stdout
    written = {"schedule.stages": "[{ lambda = 0.2, w = 4.4 }]", "schedule.avoid_modes": "true"}
    assert model.identify_simulated(changes=written).json() == done.stdout
    with pytest.raises(TypeError, match="a value of an experiment is a number"):
        model.identify_simulated(changes={"seed": object()})  # type: ignore[dict-item]


def test_tables_are_exact(tpm_command: Command) -> None:
    table = tpm.Model.from_file(CART).expand()
    assert table.json() == tpm_command("expand", CART, "--format", "json").stdout
    assert table.markdown() == tpm_command("expand", CART).stdout
    assert len(table) == len(table.entries) == len(table.to_dict()["entries"])
    for entry, stored in zip(table.entries, table.to_dict()["entries"], strict=True):
        assert isinstance(entry.coefficient, Fraction)
        assert entry.coefficient == Fraction(stored["coefficient"])
        assert entry.parameter == stored["parameter"]


def test_identifiability_is_that_of_the_command_line(tpm_command: Command) -> None:
    model = tpm.Model.from_file(CART)
    assert model.identifiability() == json.loads(tpm_command("identifiability", CART, "--json").stdout)
    arm = MODELS / "robots" / "planar_arm.tpm"
    for arguments, rest in (([], None), (["--rest", "q2=0"], {"q2": 0})):
        expected = json.loads(tpm_command("identifiability", arm, "--json", *arguments).stdout)
        assert tpm.Model.from_file(arm).identifiability(any_motion=True, rest=rest) == expected


def test_code_is_that_of_the_command_line(tpm_command: Command, tmp_path: Path) -> None:
    assert tpm_command("generate", CART, "--lang", "c", "-o", tmp_path).returncode == 0
    for name, text in tpm.Model.from_file(CART).generate("c").items():
        theirs = (tmp_path / name).read_text()
        # The comment above the code names the command that gives it again.
        (ours, code), (other, expected) = text.split("*/", 1), theirs.split("*/", 1)
        assert "tpm.Model.generate" in ours and "tpm generate" in other
        assert code == expected and len(code) > 500


def test_arrays_need_not_be_contiguous_nor_floats() -> None:
    model = tpm.Model.from_text(CART.read_text())
    t = np.arange(2000) * 1e-3
    x, u = np.sin(5 * t) + 0.3 * np.sin(9 * t), np.cos(7 * t)
    both = np.column_stack([x, u])
    plain = model.identify(t, {"x": x, "u": u})
    assert model.identify(t.tolist(), {"x": both[:, 0], "u": both[:, 1].tolist()}).values.tolist() == plain.values.tolist()
    whole = model.identify(t, {"x": x, "u": np.round(100 * u).astype(np.int32)}, scale={"u": 0.01})
    assert np.all(np.isfinite(whole.values))


def test_a_missing_reading_is_bridged_and_said(log: Path) -> None:
    columns = read(log)
    columns["x"][5000] = np.nan
    result = tpm.identify(tpm.Model.from_file(CART), columns["t_s"], {"x": columns["x"], "u": columns["u"]})
    assert result.trusted and any("missing" in said for said in result.remarks), result.remarks


def test_faults_have_the_words_of_the_command_line(tpm_command: Command, log: Path, tmp_path: Path) -> None:
    model = tpm.Model.from_file(CART)
    columns = read(log)
    t, signals = columns["t_s"], {"x": columns["x"], "u": columns["u"]}

    def words(text: str) -> str:
        """A message without what the front ends spell each in its own way: names of flags and keywords, and of the log."""
        text = text.strip().removeprefix("error: ").replace(str(log), "arrays")
        return re.sub(r" \([^()]*\)$", "", text)

    header, rest = log.read_text().split("\n", 1)
    other = tmp_path / "other.csv"
    other.write_text(header.replace(",x,", ",y,") + "\n" + rest)
    theirs = tpm_command("identify", CART, "--log", other).stderr.replace(str(other), "arrays")
    with pytest.raises(tpm.Error) as ours:
        model.identify(t, {"y": columns["x"], "u": columns["u"]})
    # The columns of a dictionary stand in the order of their names.
    assert "no column `x`" in str(ours.value) and "no column `x`" in theirs
    assert 'map={"x": "y"}' in str(ours.value)

    for keyword, flag in (({"prior": {"M": 1.0}}, "--prior"), ({"freeze": {"M": 1.0}}, "--freeze")):
        theirs = tpm_command("identify", CART, "--log", log, flag, "M=1").stderr
        with pytest.raises(tpm.Error) as ours:
            model.identify(t, signals, **keyword)  # type: ignore[arg-type]
        assert words(theirs).split(": ", 1)[1] == words(str(ours.value)).split("}: ", 1)[1].removeprefix(" ")

    broken = tmp_path / "broken.tpm"
    broken.write_text("model Broken { coordinate x [m]; m*ddot(x) = u; }")
    theirs = tpm_command("check", broken).stderr
    with pytest.raises(tpm.Error) as ours:
        tpm.Model.from_file(broken)
    assert str(ours.value).strip() == theirs.strip()

    with pytest.raises(tpm.Error, match="give one of none, zoh"):
        model.identify(t, signals, hold="first")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="unexpected keyword argument 'holt'"):
        model.identify(t, signals, holt="zoh")  # type: ignore[call-arg]
    with pytest.raises(tpm.Error, match="has 10 values"):
        model.identify(t[:10], signals)
    with pytest.raises(tpm.Error, match="holds no campaign"):
        tpm.Campaign.open(tmp_path)
    with pytest.raises(tpm.Error, match="experiment=FILE"):
        tpm.Model.from_text(CART.read_text()).identify_simulated()


def test_a_result_is_shown_in_a_notebook(log: Path) -> None:
    result = tpm.Model.from_file(CART).identify_log(log)
    html = result._repr_html_()
    assert html.startswith("<table>") and html.count("<tr>") == 1 + len(result.names)
    assert "Identification of MassSpringDrag" in repr(result)
    assert "m " in str(result)


def test_what_is_not_shown_is_not_a_number(log: Path) -> None:
    columns = read(log)
    model = tpm.Model.from_text(CART.read_text().replace("m*ddot(x)", "(m + m2)*ddot(x)").replace("m [kg]", "m [kg], m2 [kg]"))
    result = model.identify(columns["t_s"], {"x": columns["x"], "u": columns["u"]}, refine="none")
    entries = result.to_dict()["parameters"]
    assert [entry["value"] is None for entry in entries] == np.isnan(result.values).tolist()


def test_other_threads_run_meanwhile() -> None:
    ticks = 0
    done = threading.Event()

    def count() -> None:
        nonlocal ticks
        while not done.is_set():
            ticks += 1
            time.sleep(1e-3)

    thread = threading.Thread(target=count)
    thread.start()
    tpm.Model.from_file(CART).identify_simulated()
    done.set()
    thread.join()
    assert ticks > 10


def test_ctrl_c_stops_long_work() -> None:
    # A campaign of many runs of long periods, interrupted after its first moments.
    model = tpm.Model.from_file(CART)
    timer = threading.Timer(0.3, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        for seed in range(1, 1000):
            model.identify_simulated(changes={"seed": seed})


def test_the_version_is_that_of_the_command_line(tpm_command: Command) -> None:
    assert tpm_command("--version").stdout.split()[1] == tpm.__version__


def test_times_of_every_kind_are_seconds(log: Path) -> None:
    columns = read(log)
    model = tpm.Model.from_file(CART)
    signals = {"x": columns["x"], "u": columns["u"]}
    expected = model.identify(columns["t_s"], signals, hold="zoh")
    nanoseconds = np.round(columns["t_s"] * 1e9).astype("int64")
    instants = np.datetime64("2026-03-01T12:00:00", "ns") + nanoseconds.astype("timedelta64[ns]")
    start = datetime.datetime(2026, 3, 1, tzinfo=datetime.timezone.utc)
    times: list[Any] = [
        instants,
        nanoseconds.astype("timedelta64[ns]"),
        nanoseconds.astype("timedelta64[ns]") + np.timedelta64(7, "s"),
        [datetime.timedelta(microseconds=int(own) // 1000) for own in nanoseconds],
        [start.replace(tzinfo=None) + datetime.timedelta(microseconds=int(own) // 1000) for own in nanoseconds],
    ]
    for t in times:
        result = model.identify(t, signals, hold="zoh")
        assert result.trusted
        np.testing.assert_allclose(result.values, expected.values, rtol=1e-6)
    unreadable: list[Any] = [["one"] * 5, [object()] * 5, columns["t_s"] + 1j]
    for wrong in unreadable:
        with pytest.raises(TypeError, match="t: "):
            model.identify(wrong, signals)
    for kind in ("datetime64[ns]", "U8", "complex"):
        with pytest.raises(TypeError, match="signals.*x.*vector of numbers"):
            model.identify(columns["t_s"], {"x": np.zeros(5).astype("int64").astype(kind), "u": columns["u"]})


def test_frames_and_mappings_are_signals(log: Path) -> None:
    columns = read(log)
    model = tpm.Model.from_file(CART)
    expected = model.identify(columns["t_s"], {"x": columns["x"], "u": columns["u"]}, hold="zoh").json()
    assert model.identify(columns["t_s"], types.MappingProxyType(columns), hold="zoh").json() == expected
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(columns)
    frame["note"] = "a text that no model needs"
    assert model.identify(frame.t_s, frame, hold="zoh").json() == expected
    zoned = pandas.to_datetime(frame.t_s, unit="s", utc=True).dt.tz_convert("Europe/Berlin")
    for t in (pandas.to_datetime(frame.t_s, unit="s"), pandas.to_timedelta(frame.t_s, unit="s"), zoned):
        np.testing.assert_allclose(model.identify(t, frame, hold="zoh").values, model.identify(frame.t_s, frame, hold="zoh").values, rtol=1e-6)
    polars = pytest.importorskip("polars")
    other = polars.DataFrame(columns)
    assert model.identify(other["t_s"], other, hold="zoh").json() == expected
    with pytest.raises(TypeError, match="a mapping of names to vectors"):
        model.identify(columns["t_s"], [columns["x"], columns["u"]])  # type: ignore[arg-type]


def test_verdicts_are_those_of_the_command_line(tpm_command: Command, log: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    assert tpm_command("simulate", CART, "--set", "seed=2", "--set", "plant.parameters.m=2.1", "-o", other).returncode == 0
    model = tpm.Model.from_file(CART)
    a, b = (model.identify_log(path, hold="zoh") for path in (log, other))
    for name, result in (("a.json", a), ("b.json", b)):
        (tmp_path / name).write_text(result.json())
    compared = tpm_command("compare", tmp_path / "a.json", tmp_path / "b.json", "--json")
    assert tpm.compare(a, b) == json.loads(compared.stdout)
    validated = tpm_command("validate", CART, "--params", tmp_path / "a.json", "--log", other, "--hold", "zoh", "--json")
    assert tpm.validate_log(model, other, a, hold="zoh") == json.loads(validated.stdout)
    columns = read(other)
    again = tpm.validate(model, columns["t_s"], columns, a, hold="zoh")
    assert again["rows"] == json.loads(validated.stdout)["rows"]
    inspected = tpm_command("inspect", log, "--json")
    assert tpm.inspect_log(log) == json.loads(inspected.stdout)
    inspected = tpm_command("inspect", log, CART, "--json")
    assert tpm.inspect_log(log, model) == json.loads(inspected.stdout)
