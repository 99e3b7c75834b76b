"""Results: identified parameters, predictions, and pictures of both."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, KeysView, Mapping
from datetime import datetime, timezone
from html import escape
from typing import TYPE_CHECKING, Any, Union

import numpy as np
from numpy.typing import NDArray

from tpm import _tpm
from tpm._settings import Path

if TYPE_CHECKING:
    import pandas

    from tpm._model import Model

Array = NDArray[np.float64]
Series = dict[str, dict[str, Array]]
# A result, its dictionary, or the file of one.
Result = Union["Identification", Mapping[str, Any], Path]


def series_of(tracks: list[Any]) -> Series:
    """What is compared over time: by the name of a track its stamps `t` and its signals, in the units of the model."""
    return {name: {"t": t, **{signal.split(" [")[0]: own for signal, own in signals}} for name, t, signals in tracks}


def _numbers(values: list[Any]) -> Array:
    return np.array([math.nan if value is None else value for value in values], dtype=np.float64)


def _matrix(rows: list[list[Any]]) -> Array:
    return np.array([[math.nan if value is None else value for value in row] for row in rows], dtype=np.float64).reshape(
        len(rows), len(rows[0]) if rows else 0
    )


def json_of(result: Result) -> str:
    """The JSON of a result: of an `Identification`, of its dictionary, or of the file of one."""
    if isinstance(result, Identification):
        return result.json()
    if isinstance(result, Mapping):
        return json.dumps(result)
    return Identification.from_json(result).json()


class Picture:
    """A figure as SVG; notebooks show it.

    >>> picture = Picture("<svg xmlns='http://www.w3.org/2000/svg'/>")
    >>> picture.svg.startswith("<svg")
    True
    """

    def __init__(self, svg: str) -> None:
        self.svg = svg

    def _repr_svg_(self) -> str:
        return self.svg

    def save(self, path: Path) -> None:
        """Writes the figure into a file ending in .svg."""
        with open(path, "w", encoding="utf-8") as file:
            file.write(self.svg)


class Validation(dict[str, Any]):
    """What a model and a result predict of a log: the dictionary of `tpm validate --json`, and what it compares over time.

    `found["series"]` has the arrays too; they are no part of the dictionary, so that it can be written as JSON.
    """

    #: Arrays by track and signal: the forces of every row (`force/ROW`: `applied`, `predicted`), and of a simulated motion `measured`,
    #: `predicted` (one sample ahead), `residual` and `free_run`.
    series: Series
    #: Why the log is not predicted as it should be; nothing when it is.
    shortfall: str | None

    def __init__(self, found: dict[str, Any], tracks: list[Any], shortfall: str | None) -> None:
        super().__init__(found)
        self.series = series_of(tracks)
        self.shortfall = shortfall

    def __missing__(self, key: str) -> Any:
        if key == "series":
            return self.series
        raise KeyError(key)


class Identification:
    """Identified parameters, and everything that is known about them. Values that are not known are NaN.

    It is a mapping of names to values, can be saved and read again, pickled and copied. What needs the log itself (`series`, `residuals`,
    `report`, `pictures`, `complete`) is there for results of this process.

    >>> import tpm
    >>> result = Identification.from_json(tpm._example.RESULT)
    >>> result["m"], sorted(result), "m" in result
    (2.0, ['d', 'm'], True)
    >>> result.std.tolist()
    [0.01, 0.02]
    """

    def __init__(self, text: str, native: _tpm.Found | None = None) -> None:
        self._text = text
        self._native = native
        self._all: dict[str, Any] = json.loads(text)

    @classmethod
    def _of(cls, native: _tpm.Found) -> Identification:
        return cls(native.json(), native)

    @classmethod
    def from_json(cls, source: Path) -> Identification:
        """Reads a result again: from a file that `save` or `tpm identify --json` wrote, or from its text.

        >>> Identification.from_json("no result")
        Traceback (most recent call last):
        FileNotFoundError: [Errno 2] No such file or directory: 'no result'
        """
        text = source if isinstance(source, str) and source.lstrip().startswith("{") else None
        if text is None:
            with open(source, encoding="utf-8") as file:
                text = file.read()
        _tpm.described(text)
        return cls(text)

    def json(self) -> str:
        """What the command line prints with `--json`."""
        return self._text

    def save(self, path: Path) -> None:
        """Writes `json()` into a file, which `from_json` and every `--params` read; whole or not at all."""
        part = f"{os.fspath(path)}.part"
        with open(part, "w", encoding="utf-8") as file:
            file.write(self._text)
        os.replace(part, path)

    def to_dict(self) -> dict[str, Any]:
        """`json()` as a dictionary, of one's own."""
        found: dict[str, Any] = json.loads(self._text)
        return found

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return Identification.from_json, (self._text,)

    def to_frame(self) -> pandas.DataFrame:
        """A frame of pandas with a row for every parameter: unit, value, std, status."""
        import pandas

        rows = [{key: own.get(key) for key in ("name", "unit", "value", "std", "status")} for own in self._parameters()]
        return pandas.DataFrame(rows).set_index("name").astype({"value": float, "std": float})

    @property
    def model(self) -> str:
        """Name of the model."""
        return str(self._all["model"])

    def _parameters(self) -> list[dict[str, Any]]:
        return [*self._all["parameters"], *self._all.get("physical", [])]

    @property
    def names(self) -> list[str]:
        """Names of the parameters in which the model is linear, in the order of `values`, `std` and `covariance`."""
        return [own["name"] for own in self._all["parameters"]]

    @property
    def units(self) -> list[str | None]:
        """Their units; nothing where the model declares none."""
        return [own.get("unit") for own in self._all["parameters"]]

    @property
    def values(self) -> Array:
        """Their values."""
        return _numbers([own["value"] for own in self._all["parameters"]])

    @property
    def std(self) -> Array:
        """Their standard deviations."""
        return _numbers([own["std"] for own in self._all["parameters"]])

    @property
    def covariance(self) -> Array:
        """Their covariance."""
        return _matrix(self._all["covariance"])

    @property
    def physical_names(self) -> list[str]:
        """Names of the physical parameters behind products and sums; none where nothing was lumped."""
        return [own["name"] for own in self._all.get("physical", [])]

    @property
    def physical_values(self) -> Array:
        """Their values."""
        return _numbers([own["value"] for own in self._all.get("physical", [])])

    @property
    def physical_std(self) -> Array:
        """Their standard deviations."""
        return _numbers([own["std"] for own in self._all.get("physical", [])])

    @property
    def physical_covariance(self) -> Array:
        """Their covariance."""
        return _matrix(self._all.get("physical_covariance", []))

    def interval(self, name: str, deviations: float = 1.96) -> tuple[float, float]:
        """A parameter's value less and plus so many standard deviations; 1.96 hold it 95 times in 100.

        >>> import tpm
        >>> low, high = Identification.from_json(tpm._example.RESULT).interval("m", 2.0)
        >>> round(low, 6), round(high, 6)
        (1.98, 2.02)
        """
        own = self._named(name)
        value, std = (math.nan if own[key] is None else float(own[key]) for key in ("value", "std"))
        return value - deviations * std, value + deviations * std

    @property
    def rank(self) -> int:
        """Independent combinations of the parameters that the data show."""
        return int(self._all.get("rank", 0))

    @property
    def condition(self) -> float | None:
        """Condition number of the scaled equations."""
        return self._all.get("condition")

    @property
    def residual(self) -> float:
        """What is not explained, as a share of the force or of the motion."""
        value = self._all.get("residual")
        return math.nan if value is None else float(value)

    @property
    def warnings(self) -> list[str]:
        """What to read before the numbers are used."""
        if self._native is not None:
            return self._native.warnings()
        return list(self._all.get("warnings", []))

    @property
    def remarks(self) -> list[str]:
        """What was assumed in reading the logs: columns, units, stamps, readings that were left out or mended."""
        logs = [self._all["log"]] if self._all.get("log") else (self._all.get("pool") or {}).get("logs", [])
        logs = [own.get("log", own) for own in logs]
        return [said for own in logs for said in (own.get("reading") or {}).get("remarks", [])]

    @property
    def trusted(self) -> bool:
        """Whether everything that was asked for was identified: where the command line ends with 0."""
        return self.shortfall is None

    @property
    def shortfall(self) -> str | None:
        """Why the result is not trusted; nothing when it is."""
        return self._all.get("shortfall")

    @property
    def completed_model(self) -> str | None:
        """The text of the model with the forces that it lacks, where these make it better; `complete` identifies it."""
        return self._all.get("completed_model")

    def _named(self, name: str) -> dict[str, Any]:
        for own in self._parameters():
            if own["name"] == name:
                return own
        raise KeyError(name)

    def __getitem__(self, name: str, /) -> float:
        value = self._named(name)["value"]
        return math.nan if value is None else float(value)

    def __iter__(self) -> Iterator[str]:
        return iter([own["name"] for own in self._parameters()])

    def __len__(self) -> int:
        return len(self._parameters())

    def __contains__(self, name: object) -> bool:
        return any(own["name"] == name for own in self._parameters())

    def keys(self) -> KeysView[str]:
        """Names of all parameters, so that `dict(result)` has their values."""
        return dict.fromkeys(self).keys()

    def items(self) -> list[tuple[str, float]]:
        """Names with their values."""
        return [(name, self[name]) for name in self]

    def _of_this_process(self, what: str) -> _tpm.Found:
        if self._native is None:
            raise _tpm.Error(f"{what} needs the log, which a result that was read back does not have; identify it again")
        return self._native

    def series(self) -> list[Series]:
        """Measured beside model over time, log by log: as `Validation.series`, of the logs that the result comes from."""
        return [series_of(own) for own in self._of_this_process("series").tracks()]

    def residuals(self) -> list[dict[str, Array]]:
        """What the model leaves over time, log by log: of every row's force (`force/ROW`), and of every coordinate that was simulated one sample
        ahead."""
        found = []
        for log in self.series():
            left = {name: own for name, own in log.get("residual", {}).items() if name != "t"}
            for track, own in log.items():
                if track.startswith("force/"):
                    left[track] = own["applied"] - own["predicted"]
            found.append(left)
        return found

    def predict(self, model: Model, t: Any, signals: Any, **settings: Any) -> Series:
        """What the values predict of other arrays over time: `tpm.validate(...).series`."""
        return model.validate(t, signals, self, **settings).series

    def pictures(self) -> dict[str, Picture]:
        """The figures of the report by name, such as `measured` and `residual`: notebooks show them."""
        _, figures = self._of_this_process("a picture").page(None, None, None)
        return {name: Picture(svg) for name, svg in figures}

    def report(self, folder: Path, *, title: str | None = None, author: str | None = None) -> str:
        """Writes the page of the result, report.html, and its figures into a folder; returns the path of the page."""
        seconds = os.environ.get("SOURCE_DATE_EPOCH")
        now = datetime.fromtimestamp(int(seconds), timezone.utc) if seconds else datetime.now(timezone.utc)
        html, figures = self._of_this_process("a report").page(title, author, now.date().isoformat())
        os.makedirs(folder, exist_ok=True)
        for name, text in [(f"{name}.svg", svg) for name, svg in figures] + [("report.html", html)]:
            with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
                file.write(text)
        return os.path.join(os.fspath(folder), "report.html")

    def complete(self, *, time: float | None = None) -> tuple[Model, Identification] | None:
        """The model with the forces that it lacks on the logs, and its own result; nothing where none make it better on parts of the logs from
        which its values were not taken. `time` is the processor time that it may take, s; 60 when not given."""
        from tpm._model import Model

        found = self._of_this_process("the completed model").completed(time)
        return None if found is None else (Model(found[0]), Identification._of(found[1]))

    def __str__(self) -> str:
        return _tpm.described(self._text) if self._native is None else self._native.text()

    def __repr__(self) -> str:
        trusted = "" if self.trusted else ", not everything is identified"
        return f"<tpm.Identification of {self.model}: rank {self.rank}{trusted}>"

    def _repr_html_(self) -> str:
        html = f"<table><caption>{escape(self.model)}</caption>"
        html += "<tr><th>parameter</th><th>unit</th><th>identified</th><th>std. dev.</th><th>status</th></tr>"
        for own in self._parameters():
            numbers = ("-" if own[key] is None else f"{own[key]:.6g}" for key in ("value", "std"))
            cells = [own["name"], own.get("unit") or "", *numbers, own["status"]]
            html += "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"
        html += "</table>"
        said = [*([self.shortfall] if self.shortfall else []), *self.warnings]
        return html + "".join(f"<p>{escape(own)}</p>" for own in said)
