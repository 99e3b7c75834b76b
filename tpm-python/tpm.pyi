"""Identifies the parameters of non-linear machines by the Trajectory Pattern Method."""

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from fractions import Fraction
from os import PathLike
from typing import Any, Literal, Protocol, TypedDict, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

__version__: str

_Path = str | PathLike[str]
_Bounds = Mapping[str, tuple[float, float]]
_Exact = Mapping[str, int | float | str | Fraction]
_Change = bool | int | float | str | Sequence["_Change"] | Mapping[str, "_Change"]
_Changes = Mapping[str, _Change]

class _Frame(Protocol):
    """A frame of pandas or polars: columns by name."""

    @property
    def columns(self) -> Any: ...
    def __getitem__(self, key: Any, /) -> Any: ...

_Signals = Mapping[str, ArrayLike] | _Frame
# Numbers of seconds, or times of numpy, pandas, polars or Python.
_Stamps = ArrayLike | Sequence[datetime] | Sequence[timedelta]

class _ColumnSettings(TypedDict, total=False):
    map: Mapping[str, str] | None
    scale: Mapping[str, float] | None
    offset: Mapping[str, float] | None

class _LogSettings(_ColumnSettings, total=False):
    from_sample: int | None
    period: float | None
    hold: Literal["none", "zoh"] | None
    delay: Mapping[str, float | Literal["fit"]] | None
    low_pass: Mapping[str, tuple[float, float]] | None
    domain: Literal["harmonics", "time"] | None
    harmonics: int | None
    weights: Literal["noise", "equal"] | None
    refine: Literal["auto", "output-error", "none"] | None
    constants: Mapping[str, float] | None
    prior: Mapping[str, float] | None
    freeze: Mapping[str, float] | None
    bounds: _Bounds | None

class Error(Exception):
    """What is wrong with the input, and what to give instead."""

@final
class Model:
    """A model of a machine: its text, its exact form, and its evaluation."""

    @property
    def name(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def coordinates(self) -> list[str]: ...
    @property
    def inputs(self) -> list[str]: ...
    @property
    def parameters(self) -> list[str]: ...
    @property
    def remarks(self) -> str: ...
    @staticmethod
    def from_file(path: _Path) -> Model: ...
    @staticmethod
    def from_text(text: str, name: str = "model") -> Model: ...
    def expand(
        self, pattern: str | None = None, *, harmonics: int | None = None, allow_large: bool = False
    ) -> Table: ...
    def identifiability(
        self,
        pattern: str | Sequence[str] | None = None,
        *,
        values: _Exact | None = None,
        harmonics: int | None = None,
        any_motion: bool = False,
        rest: _Exact | None = None,
        allow_large: bool = False,
    ) -> dict[str, Any]: ...
    def identify(
        self, t: _Stamps, signals: _Signals, **settings: Unpack[_LogSettings]
    ) -> Identification: ...
    def identify_log(self, log: _Path | Sequence[_Path], **settings: Unpack[_LogSettings]) -> Identification: ...
    def identify_simulated(
        self,
        experiment: _Path | None = None,
        *,
        changes: _Changes | None = None,
        pattern: str | None = None,
        bounds: _Bounds | None = None,
        runs: _Path | None = None,
    ) -> Identification: ...
    def generate(
        self,
        lang: Literal["c", "rust"] = "c",
        *,
        prefix: str | None = None,
        real: Literal["double", "float"] = "double",
        parts: Sequence[str] | None = None,
        params: Identification | None = None,
        forgetting: bool = False,
        strokes: bool = False,
    ) -> dict[str, str]: ...

@final
class Entry:
    """One coefficient of a table."""

    @property
    def equation(self) -> str: ...
    @property
    def harmonic(self) -> int: ...
    @property
    def function(self) -> Literal["cos", "sin"]: ...
    @property
    def parameter(self) -> str | None: ...
    @property
    def coefficient(self) -> Fraction: ...
    @property
    def pi(self) -> int: ...
    @property
    def powers(self) -> dict[str, int]: ...
    @property
    def sign(self) -> dict[str, int]: ...

@final
class Table:
    """The exact harmonic coefficient table of a model under a pattern."""

    @property
    def model(self) -> str: ...
    @property
    def parameters(self) -> list[str]: ...
    @property
    def entries(self) -> list[Entry]: ...
    def to_dict(self) -> dict[str, Any]: ...
    def json(self) -> str: ...
    def csv(self) -> str: ...
    def markdown(self) -> str: ...
    def latex(self) -> str: ...
    def _repr_markdown_(self) -> str: ...
    def __len__(self) -> int: ...

@final
class Identification:
    """Identified parameters, and everything that is known about them. Values that are not known are NaN."""

    @property
    def model(self) -> str: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def values(self) -> NDArray[np.float64]: ...
    @property
    def std(self) -> NDArray[np.float64]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def physical_names(self) -> list[str]: ...
    @property
    def physical_values(self) -> NDArray[np.float64]: ...
    @property
    def physical_std(self) -> NDArray[np.float64]: ...
    @property
    def physical_covariance(self) -> NDArray[np.float64]: ...
    @property
    def rank(self) -> int: ...
    @property
    def condition(self) -> float | None: ...
    @property
    def residual(self) -> float: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def trusted(self) -> bool:
        """Whether everything that was asked for was identified: where the command line ends with 0."""
    @property
    def shortfall(self) -> str | None:
        """Why the result is not trusted; nothing when it is."""
    def to_dict(self) -> dict[str, Any]: ...
    def json(self) -> str:
        """What the command line prints with `--json`."""
    def __getitem__(self, name: str, /) -> float: ...
    def _repr_html_(self) -> str: ...

@final
class Run:
    """A run to be played."""

    @property
    def number(self) -> int: ...
    @property
    def t(self) -> NDArray[np.float64]: ...
    @property
    def samples(self) -> dict[str, NDArray[np.float64]]: ...
    @property
    def terms(self) -> dict[str, Any]: ...

@final
class Submission:
    """What became of a submitted run. A run that is kept stays where `result` raises an Error: the runs do not say enough yet."""

    @property
    def kept(self) -> bool: ...
    @property
    def outcome(self) -> str | None: ...
    @property
    def run(self) -> dict[str, Any]: ...
    @property
    def result(self) -> Identification: ...

@final
class Campaign:
    """A campaign in a folder: model, experiment, and every finished run."""

    @property
    def outcome(self) -> str | None: ...
    @staticmethod
    def begin(
        folder: _Path,
        model: Model,
        experiment: _Path | None = None,
        *,
        changes: _Changes | None = None,
        pattern: str | None = None,
        bounds: _Bounds | None = None,
    ) -> Campaign: ...
    @staticmethod
    def open(folder: _Path, *, bounds: _Bounds | None = None) -> Campaign: ...
    def next(self) -> Run | None: ...
    def submit(
        self,
        t: _Stamps,
        signals: _Signals,
        *,
        stopped: bool = False,
        **settings: Unpack[_ColumnSettings],
    ) -> Submission: ...
    def submit_log(self, log: _Path, *, stopped: bool = False, **settings: Unpack[_ColumnSettings]) -> Submission: ...
    def simulate(self, run: Run) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]: ...
    def result(self) -> Identification: ...

def identify(
    model: Model, t: _Stamps, signals: _Signals, **settings: Unpack[_LogSettings]
) -> Identification: ...
def validate(
    model: Model, t: _Stamps, signals: _Signals, result: Identification, **settings: Unpack[_LogSettings]
) -> dict[str, Any]:
    """Predicts arrays with the parameters of a result, as `tpm validate --json`: nothing is fitted."""

def validate_log(
    model: Model, log: _Path, result: Identification, **settings: Unpack[_LogSettings]
) -> dict[str, Any]:
    """Predicts a log with the parameters of a result, as `tpm validate --json`: nothing is fitted."""

def inspect_log(log: _Path, model: Model | None = None, **settings: Unpack[_LogSettings]) -> dict[str, Any]:
    """Looks at a log before anything is identified from it, as `tpm inspect --json`."""

def compare(a: Identification, b: Identification) -> dict[str, Any]:
    """What changed between two results of different data, as `tpm compare --json`."""
