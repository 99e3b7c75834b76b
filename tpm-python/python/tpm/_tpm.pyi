"""The native part."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

__version__: str

_Array = NDArray[np.float64]
_Track = tuple[str, _Array, list[tuple[str, _Array]]]

class Error(Exception):
    """What is wrong with the input, and what to give instead."""

@final
class Model:
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
    def from_file(path: Any) -> Model: ...
    @staticmethod
    def from_text(text: str, name: str = "model") -> Model: ...
    def expand(
        self, pattern: str | None = None, *, harmonics: int | None = None, allow_large: bool = False
    ) -> Table: ...
    def identifiability(
        self,
        pattern: Any = None,
        *,
        values: Any = None,
        harmonics: int | None = None,
        any_motion: bool = False,
        rest: Any = None,
        allow_large: bool = False,
    ) -> dict[str, Any]: ...
    def identify(self, logs: Sequence[Any], settings: Mapping[str, Any] | None) -> Found: ...
    def identify_simulated(
        self, experiment: Any = None, *, changes: Any = None, pattern: Any = None, bounds: Any = None, runs: Any = None
    ) -> Found: ...
    def simulate(
        self, experiment: Any = None, *, changes: Any = None, pattern: Any = None
    ) -> tuple[_Array, dict[str, _Array]]: ...
    def generate(
        self,
        lang: str = "c",
        *,
        prefix: str | None = None,
        real: str = "double",
        parts: Sequence[str] | None = None,
        params: str | None = None,
        forgetting: bool = False,
        strokes: bool = False,
    ) -> dict[str, str]: ...
    def export(self, format: str, params: str) -> tuple[dict[str, str], list[str]]: ...

@final
class Found:
    def json(self) -> str: ...
    def text(self) -> str: ...
    def warnings(self) -> list[str]: ...
    def tracks(self) -> list[list[_Track]]: ...
    def page(self, title: str | None, author: str | None, date: str | None) -> tuple[str, list[tuple[str, str]]]: ...
    def completed(self, time: float | None) -> tuple[Model, Found] | None: ...

@final
class Entry:
    """One coefficient of a table."""

    @property
    def equation(self) -> str:
        """The equation in which it stands."""
    @property
    def harmonic(self) -> int:
        """The harmonic."""
    @property
    def function(self) -> Literal["cos", "sin"]:
        """Cosine or sine of it."""
    @property
    def parameter(self) -> str | None:
        """The parameter that it belongs to; nothing for known terms."""
    @property
    def coefficient(self) -> Fraction:
        """The exact coefficient, without powers."""
    @property
    def pi(self) -> int:
        """The power of pi."""
    @property
    def powers(self) -> dict[str, int]:
        """Powers of amplitudes, frequency and constants."""
    @property
    def sign(self) -> dict[str, int]:
        """What its sign depends on."""

@final
class Table:
    """The exact harmonic coefficient table of a model under a pattern."""

    @property
    def model(self) -> str:
        """Name of the model."""
    @property
    def parameters(self) -> list[str]:
        """Names of its parameters."""
    @property
    def entries(self) -> list[Entry]:
        """All entries, in the table's order, with exact coefficients."""
    def to_dict(self) -> dict[str, Any]:
        """What `tpm expand --format json` prints, as a dictionary."""
    def json(self) -> str:
        """What `tpm expand --format json` prints."""
    def csv(self) -> str:
        """The table as CSV."""
    def markdown(self) -> str:
        """The table as Markdown; notebooks show it."""
    def latex(self) -> str:
        """The table for LaTeX."""
    def _repr_markdown_(self) -> str: ...
    def __len__(self) -> int: ...

@final
class Run:
    """A run to be played."""

    @property
    def number(self) -> int:
        """Number of the run, from 1."""
    @property
    def t(self) -> _Array:
        """Stamps, s."""
    @property
    def samples(self) -> dict[str, _Array]:
        """Reference with its derivatives, and feed-forward, by the names of the columns that `tpm campaign next` writes."""
    @property
    def terms(self) -> dict[str, Any]:
        """Feedback, limits and timing."""

@final
class Submission:
    @property
    def kept(self) -> bool: ...
    @property
    def outcome(self) -> str | None: ...
    @property
    def run(self) -> dict[str, Any]: ...
    @property
    def result(self) -> Found: ...

@final
class Campaign:
    @property
    def outcome(self) -> str | None: ...
    @staticmethod
    def begin(
        folder: Any, model: Model, experiment: Any = None, *, changes: Any = None, pattern: Any = None, bounds: Any = None
    ) -> Campaign: ...
    @staticmethod
    def open(folder: Any, *, bounds: Any = None) -> Campaign: ...
    def next(self) -> Run | None: ...
    def submit(self, t: Any, signals: Any, *, stopped: bool = False, **settings: Any) -> Submission: ...
    def submit_log(self, log: Any, *, stopped: bool = False, **settings: Any) -> Submission: ...
    def simulate(self, run: Run) -> tuple[_Array, dict[str, _Array]]: ...
    def result(self) -> Found: ...

def described(text: str) -> str: ...
def validate(
    model: Model, log: Any, result: str, settings: Mapping[str, Any] | None
) -> tuple[dict[str, Any], list[_Track], str | None]: ...
def inspect(log: Any, model: Model | None, settings: Mapping[str, Any] | None) -> dict[str, Any]: ...
def compare(a: str, b: str) -> dict[str, Any]: ...
def proposals(
    log: Any, settings: Mapping[str, Any] | None
) -> list[tuple[str, str, str, dict[str, str]]]: ...
def import_description_of(
    path: Any, base: str | None, tip: str | None, lock: dict[str, float] | None, losses: list[str] | None
) -> tuple[str, str, str, list[str]]: ...
def payload(
    model: Model, without: str, with_load: str, body: str | None, density: float
) -> dict[str, Any]: ...
def inertias(
    model: Model,
    result: str,
    path: Any,
    values: dict[str, float],
    weight: float,
    base: str | None,
    tip: str | None,
    lock: dict[str, float] | None,
) -> tuple[dict[str, Any], str | None]: ...
