"""What a notebook needs beside identification: results that last, series, pictures, pages, proposals, robots, and documentation."""

import copy
import doctest
import inspect
import json
import pickle
import subprocess
import sys
import types
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from conftest import MODELS, ROOT, Command, read

import tpm
import tpm._campaign
import tpm._model
import tpm._result
import tpm._settings

CART = MODELS / "mass_spring_drag.tpm"


@pytest.fixture(scope="module")
def result(log: Path) -> tpm.Identification:
    return tpm.Model.from_file(CART).identify_log(log, hold="zoh")


def test_the_examples_of_the_docstrings_run() -> None:
    for module in (tpm._settings, tpm._result, tpm._model, tpm._campaign):
        found = doctest.testmod(module)
        assert found.failed == 0, module.__name__


def test_every_member_is_documented() -> None:
    for name in tpm.__all__:
        own = getattr(tpm, name)
        if not name.startswith("__"):
            assert inspect.getdoc(own), name
        if inspect.isclass(own) and own.__module__.startswith("tpm"):
            for member, value in vars(own).items():
                described = callable(value) or isinstance(value, (property, staticmethod, classmethod))
                public = not member.startswith("_") and (described or inspect.isgetsetdescriptor(value))
                assert not public or inspect.getdoc(getattr(own, member)), f"{name}.{member}"


def test_the_keywords_are_the_flags_of_the_command_line(tpm_command: Command) -> None:
    help_text = tpm_command("identify", "--help").stdout
    singular = {"constants": "constant", "bounds": "bound"}
    keywords = list(get_type_hints(tpm._settings.LogSettings))
    chapter = (ROOT / "docs" / "python.md").read_text()
    for keyword in keywords:
        flag = "--" + singular.get(keyword, keyword).replace("_", "-")
        assert f"{flag} " in help_text, flag
        assert keyword in inspect.signature(tpm.identify).parameters
        assert f"    {keyword}: " in (tpm.identify.__doc__ or "")
        assert f"`{keyword}`" in chapter, keyword


def test_a_result_can_be_saved_and_read(result: tpm.Identification, tpm_command: Command, log: Path, tmp_path: Path) -> None:
    result.save(tmp_path / "result.json")
    ways: list[Any] = [
        tpm.Identification.from_json(tmp_path / "result.json"),
        tpm.Identification.from_json(result.json()),
        pickle.loads(pickle.dumps(result)),
        copy.deepcopy(result),
    ]
    model = tpm.Model.from_file(CART)
    validated = tpm.validate_log(model, log, result, hold="zoh")
    for again in ways:
        assert again.json() == result.json() and again == again
        assert dict(again) == dict(result) and again.values.tolist() == result.values.tolist()
        assert again.covariance.tolist() == result.covariance.tolist()
        assert tpm.validate_log(model, log, again, hold="zoh") == validated
        assert model.generate("c", params=again) == model.generate("c", params=result)
        assert "m " in str(again) and "read back" in str(again)
        with pytest.raises(tpm.Error, match="needs the log"):
            again.residuals()
    code = f"import sys, tpm; print(tpm.Identification.from_json({str(tmp_path / 'result.json')!r})['m'])"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(told.stdout) == result["m"]
    for given in (result.to_dict(), tmp_path / "result.json", str(tmp_path / "result.json")):
        assert tpm.validate_log(model, log, given, hold="zoh") == validated
        assert tpm.compare(given, result) == tpm.compare(result, result)
    copied = pickle.loads(pickle.dumps(model))
    assert copied.text == model.text and copied.simulate()[0].size == model.simulate()[0].size
    theirs = tpm_command("validate", CART, "--params", tmp_path / "result.json", "--log", log, "--hold", "zoh", "--json")
    assert json.loads(theirs.stdout) == validated
    for text in ("{}", '{"schema": "tpm.other/1"}'):
        with pytest.raises(tpm.Error, match="no result of an identification"):
            tpm.Identification.from_json(text)


def test_a_result_is_a_mapping_with_intervals(result: tpm.Identification) -> None:
    assert list(result) == [*result.names, *result.physical_names] and len(result) == len(list(result))
    assert "m" in result and "M" not in result
    low, high = result.interval("m")
    assert low < 2.0 < high and abs(0.5 * (low + high) - result["m"]) < 1e-12
    with pytest.raises(KeyError):
        result["M"]
    frame = result.to_frame()
    assert frame.loc["m", "unit"] == "kg" and list(frame["value"]) == [value for _, value in result.items()]


def test_measured_and_model_are_arrays(result: tpm.Identification, log: Path) -> None:
    columns = read(log)
    model = tpm.Model.from_file(CART)
    found = tpm.validate(model, columns["t_s"], columns, result, hold="zoh")
    series = found["series"]
    assert "series" not in json.loads(json.dumps(found))
    measured = series["measured"]["x"]
    at = np.flatnonzero(np.isclose(columns["x"], measured[0]))
    assert any(np.allclose(columns["x"][k : k + 100], measured[:100]) for k in at)
    np.testing.assert_allclose(series["residual"]["x"], measured - series["predicted"]["x"])
    assert result.predict(model, columns["t_s"], columns, hold="zoh").keys() == series.keys()
    (left,) = result.residuals()
    assert np.sqrt(np.nanmean(left["x"] ** 2)) < 0.02 * np.std(columns["x"])
    timed = model.identify_log(log, hold="zoh", domain="time", refine="none")
    force = timed.series()[0]["force/u"]
    left_of_force = timed.residuals()[0]["force/u"]
    assert np.nanstd(left_of_force) < 0.05 * np.nanstd(force["applied"])


def test_pictures_and_the_page_are_written(result: tpm.Identification, tmp_path: Path) -> None:
    pictures = result.pictures()
    assert pictures and all(picture._repr_svg_().lstrip().startswith("<svg") for picture in pictures.values())
    next(iter(pictures.values())).save(tmp_path / "one.svg")
    page = Path(result.report(tmp_path / "report", title="Cart 7", author="A. Turing"))
    text = page.read_text()
    assert "Cart 7" in text and "A. Turing" in text and "MassSpringDrag" in text
    assert {path.suffix for path in page.parent.iterdir()} == {".html", ".svg"}


def test_what_a_model_lacks_becomes_a_part_of_it() -> None:
    t = np.arange(20_000) * 1e-3
    x = 0.1 * np.sin(5 * t) + 0.05 * np.cos(11 * t)
    v = 0.5 * np.cos(5 * t) - 0.55 * np.sin(11 * t)
    a = -2.5 * np.sin(5 * t) - 6.05 * np.cos(11 * t)
    noise = np.random.default_rng(3)
    signals = {
        "x": x + 1e-6 * noise.standard_normal(t.size),
        "u": 2 * a + 3 * v + 40 * x + 2 * v * np.abs(v) + 0.02 * noise.standard_normal(t.size),
    }
    model = tpm.Model.from_text(tpm._example.CART)
    result = model.identify(t, signals, refine="none", domain="time")
    assert result.completed_model is not None and any("drag" in said for said in result.warnings)
    both = result.complete()
    assert both is not None
    whole, found = both
    assert whole.text == result.completed_model
    added = set(whole.parameters) - set(model.parameters)
    assert len(added) == 1 and abs(found[added.pop()] - 2) < 0.05, found
    assert whole.generate("c", params=found)


def test_models_are_proposed_from_the_columns() -> None:
    t = np.arange(3000) * 1e-3
    signals = {"Pos [mm]": 1e3 * np.sin(5 * t), "Force [N]": np.cos(7 * t)}
    found = tpm.propose(t, signals)
    assert {own.template for own in found} >= {"spring", "slider"}
    first = found[0]
    assert set(first.map) == {*first.model.coordinates, *first.model.inputs}
    assert first.model.identify(t, signals, map=first.map).names == first.model.parameters


def test_a_robot_is_imported_as_by_the_command_line(tpm_command: Command, tmp_path: Path) -> None:
    descriptions = sorted((ROOT / "tests").rglob("*.urdf"))
    assert descriptions, "a description among the tests"
    done = tpm_command("import", descriptions[0], "-o", tmp_path / "arm.tpm")
    assert done.returncode == 0, done.stderr
    found = tpm.import_robot(descriptions[0])
    assert found.model.text == (tmp_path / "arm.tpm").read_text()
    assert found.experiment == (tmp_path / "arm.experiment.toml").read_text()
    assert found.prior and all(isinstance(value, float) for value in found.prior.values())
    with pytest.raises(tpm.Error, match="viscous, coulomb, offset, rotor, stribeck"):
        tpm.import_robot(descriptions[0], losses=["viscosity"])


def test_exports_are_those_of_the_command_line(result: tpm.Identification, tpm_command: Command, tmp_path: Path) -> None:
    result.save(tmp_path / "result.json")
    model = tpm.Model.from_file(CART)
    for to in ("casadi", "st", "arduino"):
        files, lost = model.export(to, result)
        done = tpm_command("export", CART, "--params", tmp_path / "result.json", "--to", to, "-o", tmp_path / to)
        assert done.returncode == 0, done.stderr
        written = {path.name for path in (tmp_path / to).rglob("*") if path.is_file()} if (tmp_path / to).is_dir() else {to}
        assert len(written) == len(files), (written, list(files))
        assert isinstance(lost, list)
    with pytest.raises(tpm.Error, match="casadi, st, arduino"):
        model.export("fmu", result)  # type: ignore[arg-type]


def test_a_simulated_run_is_that_of_the_command_line(log: Path) -> None:
    t, signals = tpm.Model.from_file(CART).simulate()
    columns = read(log)
    np.testing.assert_array_equal(t.size, columns["t_s"].size)
    np.testing.assert_array_equal(signals["x"], columns["x"])


def test_what_cannot_be_meant_is_named(log: Path, tmp_path: Path) -> None:
    columns = read(log)
    model = tpm.Model.from_file(CART)

    def identify(**settings: Any) -> tpm.Identification:
        return model.identify(columns["t_s"], {"x": columns["x"], "u": columns["u"]}, hold="zoh", **settings)

    for wrong, said in (
        ({"scale": {"x": "two"}}, r"scale=\{'x': 'two'\}.*a number"),
        ({"map": {"x": 1}}, r"map=\{'x': 1\}.*a column"),
        ({"freeze": {0: 1.0}}, r"freeze=\{0: 1.0\}"),
        ({"constants": 3}, "constants=3: give a mapping"),
    ):
        with pytest.raises(TypeError, match=said):
            identify(**wrong)
    with pytest.raises(tpm.Error, match="harmonics=-1: give a number from 0"):
        identify(harmonics=-1)
    prior = tmp_path / "cart.prior.toml"
    prior.write_text("m = 1.9  # kg\nk1 = 41\n")
    assert identify(prior=prior).to_dict()["parameters"][0]["prior"] == 1.9


def test_a_search_ends_when_its_time_is_over(log: Path) -> None:
    columns = read(log)
    model = tpm.Model.from_file(CART)
    result = model.identify(columns["t_s"], types.MappingProxyType(columns), hold="zoh", time=1e-3)
    assert result.names == ["m", "k1", "k2"]
