"""What a call may say of a log: one table, of which signatures, docstrings, types and the chapter of the book are made."""

from __future__ import annotations

import inspect
import numbers
import os
import typing
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta
from fractions import Fraction
from os import PathLike
from typing import Annotated, Any, Literal, Protocol, TypedDict, TypeVar, Union

from numpy.typing import ArrayLike

from tpm import _tpm

Path = Union[str, "PathLike[str]"]
Bounds = Mapping[str, tuple[float, float]]
Exact = Mapping[str, Union[int, float, str, Fraction]]
# Numbers of seconds, or times of numpy, pandas, polars or Python.
Stamps = Union[ArrayLike, Sequence[datetime], Sequence[timedelta]]


class Frame(Protocol):
    """A frame of pandas or polars: columns by name."""

    @property
    def columns(self) -> Any: ...
    def __getitem__(self, key: Any, /) -> Any: ...


Signals = Union[Mapping[str, ArrayLike], Frame]


class ColumnSettings(TypedDict, total=False):
    """How columns become signals of the model."""

    map: Annotated[Mapping[str, str] | None, "the column of a signal, or an expression of columns: {'x': 'pos_mm'}"]
    scale: Annotated[Mapping[str, float] | None, "what a column is multiplied by: {'x': 1e-3}"]
    offset: Annotated[Mapping[str, float] | None, "what is added to a column after that"]
    sample_time: Annotated[float | None, "time between rows, s, instead of stamps"]


class LogSettings(ColumnSettings, total=False):
    """How a log is read, and what is known of its machine."""

    from_sample: Annotated[int | None, "first sample to use, from 0"]
    period: Annotated[float | None, "period of the motion, s; found when not given"]
    hold: Annotated[Literal["none", "zoh"] | None, "what the inputs do between samples: go on, or hold their value"]
    delay: Annotated[
        Mapping[str, float | Literal["fit"]] | None, "by how much later an input acts than it is recorded, s, or 'fit'"
    ]
    low_pass: Annotated[
        Mapping[str, tuple[float, float]] | None, "low pass of second order behind an input: natural frequency (rad/s), quality"
    ]
    domain: Annotated[Literal["harmonics", "time"] | None, "harmonics of the part that repeats, or every sample"]
    harmonics: Annotated[int | None, "highest harmonic to use"]
    weights: Annotated[
        Literal["noise", "equal"] | None, "equations by their noise, or alike: the model nearest to the forces"
    ]
    refine: Annotated[
        Literal["auto", "output-error", "none"] | None, "whether the estimates are refined by simulating the model"
    ]
    constants: Annotated[Mapping[str, float] | None, "values of constants that the model leaves open"]
    prior: Annotated[
        Mapping[str, float] | Path | None,
        "values known before: what an unobservable direction keeps; or a file of NAME = VALUE lines",
    ]
    freeze: Annotated[Mapping[str, float] | None, "parameters that are held at a value"]
    calibration: Annotated[
        Mapping[str, float] | None, "deviation of a coordinate's zero, or of an input's gain, which enters the deviations"
    ]
    bounds: Annotated[Bounds | None, "least and largest value of a physical parameter"]
    time: Annotated[float | None, "processor time that may be taken, s; 60 when not given"]


def values_of(text: str) -> dict[str, float]:
    """Values of parameters from lines `NAME = VALUE`, as `tpm import` writes them.

    >>> values_of("m = 2.0  # kg")
    {'m': 2.0}
    """
    lines = [line.split("#")[0].split("=") for line in text.splitlines() if "=" in line.split("#")[0]]
    return {name.strip().strip('"'): float(value) for name, value in lines}


def prepared(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as the native module takes them, where what is given cannot be meant."""
    found = dict(settings)
    prior = found.get("prior")
    if isinstance(prior, (str, os.PathLike)):
        with open(prior, encoding="utf-8") as file:
            found["prior"] = values_of(file.read())
    for name in ("harmonics", "from_sample"):
        if isinstance(found.get(name), int) and found[name] < 0:
            raise _tpm.Error(f"{name}={found[name]}: give a number from 0")
    for name in ("map", "scale", "offset", "constants", "prior", "freeze", "calibration"):
        own = found.get(name)
        if own is None:
            continue
        if not isinstance(own, Mapping):
            raise TypeError(f"{name}={own!r}: give a mapping of names, such as {name}={{'x': ...}}")
        wanted = str if name == "map" else numbers.Real
        for key, value in own.items():
            if not isinstance(key, str) or not isinstance(value, wanted):
                what = "a column" if name == "map" else "a number"
                raise TypeError(f"{name}={{{key!r}: {value!r}}}: give the name of a signal or parameter, and {what}")
    return found


F = TypeVar("F", bound=Callable[..., Any])


def told(settings: type) -> Callable[[F], F]:
    """Gives a function that takes `**settings` the signature and the documentation of these settings.

    >>> import inspect, tpm
    >>> "calibration" in inspect.signature(tpm.identify).parameters
    True
    """

    def with_settings(function: F) -> F:
        hints = typing.get_type_hints(settings, include_extras=True)
        lines, keywords = [], []
        for name, hint in hints.items():
            annotation, meaning = typing.get_args(hint)
            lines.append(f"    {name}: {meaning}")
            keywords.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation))
        own = inspect.signature(function)
        given = [one for one in own.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
        function.__signature__ = own.replace(parameters=[*given, *keywords])  # type: ignore[attr-defined]
        body = inspect.cleandoc(function.__doc__ or "")
        function.__doc__ = "\n".join([body, "", "Keyword arguments:", *lines])
        return function

    return with_settings
