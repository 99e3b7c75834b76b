"""Models: what they say, what they show, and what logs say of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Union

import numpy as np
from numpy.typing import NDArray

from tpm import _tpm
from tpm._result import Identification, Result, Validation, json_of
from tpm._settings import Bounds, Exact, LogSettings, Path, Signals, Stamps, prepared, told, values_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

Change = Union[bool, int, float, str, Sequence["Change"], Mapping[str, "Change"]]
Changes = Mapping[str, Change]


class Model:
    """A model of a machine: its text, its exact form, and its evaluation.

    >>> import tpm
    >>> model = tpm.Model.from_text(tpm._example.CART)
    >>> model.name, model.coordinates, model.inputs, model.parameters
    ('Cart', ['x'], ['u'], ['m', 'd', 'k'])
    """

    def __init__(self, native: _tpm.Model, path: Path | None = None) -> None:
        self._native = native
        self._path = path

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return (Model.from_text, (self.text,)) if self._path is None else (Model.from_file, (self._path,))

    @staticmethod
    def from_file(path: Path) -> Model:
        """Reads a model file (.tpm); an experiment is looked for beside it."""
        return Model(_tpm.Model.from_file(path), path)

    @staticmethod
    def from_text(text: str, name: str = "model") -> Model:
        """A model from its text; `name` is what messages call it."""
        return Model(_tpm.Model.from_text(text, name))

    @property
    def name(self) -> str:
        """The model's name."""
        return self._native.name

    @property
    def text(self) -> str:
        """The text in which it was declared."""
        return self._native.text

    @property
    def coordinates(self) -> list[str]:
        """Names of the generalised coordinates."""
        return self._native.coordinates

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs."""
        return self._native.inputs

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters in which it is linear."""
        return self._native.parameters

    @property
    def remarks(self) -> str:
        """What there is to say about the text."""
        return self._native.remarks

    def expand(
        self, pattern: str | None = None, *, harmonics: int | None = None, allow_large: bool = False
    ) -> _tpm.Table:
        """The exact harmonic coefficient table under a pattern (Feng, Eqns 3.26, 4.44).

        >>> import tpm
        >>> table = tpm.Model.from_text(tpm._example.CART).expand()
        >>> table.entries[0].coefficient
        Fraction(1, 2)
        """
        return self._native.expand(pattern, harmonics=harmonics, allow_large=allow_large)

    def identifiability(
        self,
        pattern: str | Sequence[str] | None = None,
        *,
        values: Exact | None = None,
        harmonics: int | None = None,
        any_motion: bool = False,
        rest: Exact | None = None,
        allow_large: bool = False,
    ) -> dict[str, Any]:
        """What a pattern, or any motion, can show: rank, unobservable directions, base parameters.

        >>> import tpm
        >>> tpm.Model.from_text(tpm._example.CART).identifiability()["rank"]
        3
        """
        return self._native.identifiability(
            pattern, values=values, harmonics=harmonics, any_motion=any_motion, rest=rest, allow_large=allow_large
        )

    @told(LogSettings)
    def identify(self, t: Stamps, signals: Signals, **settings: Unpack[LogSettings]) -> Identification:
        """Identifies the parameters from arrays: stamps in seconds or as times, and coordinates and applied inputs by name."""
        return Identification._of(self._native.identify([(t, signals)], prepared(settings)))

    @told(LogSettings)
    def identify_log(self, log: Path | Sequence[Path], **settings: Unpack[LogSettings]) -> Identification:
        """Identifies the parameters from the file of a log, or from several of one machine together."""
        logs = list(log) if isinstance(log, (list, tuple)) else [log]
        return Identification._of(self._native.identify(logs, prepared(settings)))

    def identify_simulated(
        self,
        experiment: Path | None = None,
        *,
        changes: Changes | None = None,
        pattern: str | None = None,
        bounds: Bounds | None = None,
        runs: Path | None = None,
    ) -> Identification:
        """Plays an experiment on the simulated machine and identifies the parameters from its runs, as `tpm identify MODEL`."""
        return Identification._of(
            self._native.identify_simulated(experiment, changes=changes, pattern=pattern, bounds=bounds, runs=runs)
        )

    def simulate(
        self, experiment: Path | None = None, *, changes: Changes | None = None, pattern: str | None = None
    ) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """The first run of an experiment on the simulated machine: stamps, and coordinates and inputs by name."""
        return self._native.simulate(experiment, changes=changes, pattern=pattern)

    @told(LogSettings)
    def validate(
        self, t: Stamps, signals: Signals, result: Result, **settings: Unpack[LogSettings]
    ) -> Validation:
        """Predicts arrays with the parameters of a result, as `tpm validate`: nothing is fitted."""
        return Validation(*_tpm.validate(self._native, (t, signals), json_of(result), prepared(settings)))

    @told(LogSettings)
    def validate_log(self, log: Path, result: Result, **settings: Unpack[LogSettings]) -> Validation:
        """Predicts the file of a log with the parameters of a result, as `tpm validate`: nothing is fitted."""
        return Validation(*_tpm.validate(self._native, log, json_of(result), prepared(settings)))

    def generate(
        self,
        lang: Literal["c", "rust"] = "c",
        *,
        prefix: str | None = None,
        real: Literal["double", "float"] = "double",
        parts: Sequence[str] | None = None,
        params: Result | None = None,
        forgetting: bool = False,
        strokes: bool = False,
    ) -> dict[str, str]:
        """Source code of the model's estimator and dynamics: text by the name of its file.

        >>> import tpm
        >>> sorted(tpm.Model.from_text(tpm._example.CART).generate("c"))
        ['cart.c', 'cart.h']
        """
        values = None if params is None else json_of(params)
        parts = None if parts is None else list(parts)
        return self._native.generate(
            lang, prefix=prefix, real=real, parts=parts, params=values, forgetting=forgetting, strokes=strokes
        )

    def export(
        self, to: Literal["casadi", "st", "arduino"], params: Result
    ) -> tuple[dict[str, str], list[str]]:
        """The model with the values of a result for another program, as `tpm export`: text by the name of its file, and what the format does not
        hold."""
        return self._native.export(to, json_of(params))

    def __repr__(self) -> str:
        names = self.parameters
        return f"<tpm.Model {self.name}: {', '.join(names[:8])}{' ...' if len(names) > 8 else ''}>"


@dataclass(frozen=True)
class Proposal:
    """A model to begin with that fits the columns of a log."""

    #: Name of the template.
    template: str
    #: The machine that it is of.
    machine: str
    #: The model, to be changed.
    model: Model
    #: The column of every signal: `identify_log(log, map=proposal.map)`.
    map: dict[str, str]


@dataclass(frozen=True)
class Imported:
    """A robot's description as a model."""

    #: The model.
    model: Model
    #: Values of its parameters in the description: `identify(..., prior=imported.prior)`.
    prior: dict[str, float]
    #: An experiment to begin with (TOML).
    experiment: str
    #: What there is to say about the description.
    remarks: list[str]


@told(LogSettings)
def identify(model: Model, t: Stamps, signals: Signals, **settings: Unpack[LogSettings]) -> Identification:
    """Identifies the parameters of a model from arrays: stamps in seconds or as times, and coordinates and applied inputs by name.

    >>> import numpy as np, tpm
    >>> model = tpm.Model.from_text(tpm._example.CART)
    >>> t = np.arange(8000) * 1e-3
    >>> x = 0.1 * np.sin(5 * t) + 0.05 * np.cos(11 * t)
    >>> v = 0.5 * np.cos(5 * t) - 0.55 * np.sin(11 * t)
    >>> a = -2.5 * np.sin(5 * t) - 6.05 * np.cos(11 * t)
    >>> noise = np.random.default_rng(1).standard_normal(t.size)
    >>> result = tpm.identify(model, t, {"x": x + 1e-5 * noise, "u": 2 * a + 3 * v + 40 * x})
    >>> {name: round(value, 2) for name, value in result.items()}
    {'m': 2.0, 'd': 3.0, 'k': 40.0}
    """
    return model.identify(t, signals, **settings)


@told(LogSettings)
def validate(
    model: Model, t: Stamps, signals: Signals, result: Result, **settings: Unpack[LogSettings]
) -> Validation:
    """Predicts arrays with the parameters of a result, as `tpm validate --json`: nothing is fitted."""
    return model.validate(t, signals, result, **settings)


@told(LogSettings)
def validate_log(model: Model, log: Path, result: Result, **settings: Unpack[LogSettings]) -> Validation:
    """Predicts the file of a log with the parameters of a result, as `tpm validate --json`: nothing is fitted."""
    return model.validate_log(log, result, **settings)


@told(LogSettings)
def inspect(t: Stamps, signals: Signals, model: Model | None = None, **settings: Unpack[LogSettings]) -> dict[str, Any]:
    """Looks at arrays before anything is identified from them, as `tpm inspect --json`."""
    return _tpm.inspect((t, signals), None if model is None else model._native, prepared(settings))


@told(LogSettings)
def inspect_log(log: Path, model: Model | None = None, **settings: Unpack[LogSettings]) -> dict[str, Any]:
    """Looks at the file of a log before anything is identified from it, as `tpm inspect --json`."""
    return _tpm.inspect(log, None if model is None else model._native, prepared(settings))


def compare(a: Result, b: Result) -> dict[str, Any]:
    """What changed between two results of different data, as `tpm compare --json`."""
    return _tpm.compare(json_of(a), json_of(b))


def _proposals(log: Any, settings: Any) -> list[Proposal]:
    found = _tpm.proposals(log, prepared(settings))
    return [Proposal(name, machine, Model.from_text(text, name), columns) for name, machine, text, columns in found]


@told(LogSettings)
def propose(t: Stamps, signals: Signals, **settings: Unpack[LogSettings]) -> list[Proposal]:
    """Models to begin with that fit the columns of arrays, as `tpm identify LOG`; those that use most of them first.

    >>> import numpy as np, tpm
    >>> t = np.arange(2000) * 1e-3
    >>> found = tpm.propose(t, {"Pos [mm]": np.sin(5 * t), "Force [N]": np.cos(7 * t)})
    >>> found[0].template, found[0].map
    ('spring', {'u': 'Force [N]', 'x': 'Pos [mm]'})
    """
    return _proposals((t, signals), settings)


@told(LogSettings)
def propose_log(log: Path, **settings: Unpack[LogSettings]) -> list[Proposal]:
    """Models to begin with that fit the columns of a file, as `tpm identify LOG`; those that use most of them first."""
    return _proposals(log, settings)


def import_robot(
    path: Path,
    *,
    base: str | None = None,
    tip: str | None = None,
    lock: Mapping[str, float] | None = None,
    losses: Sequence[str] | None = None,
) -> Imported:
    """A robot's description (URDF, MJCF) as a model, as `tpm import`.

    base: the link that does not move; the root when not given. tip: the last link of the chain; all links when not given. lock: joints
    that are held at a position. losses: unknown torques of every drive, of viscous, coulomb, offset, rotor, stribeck; none of them: [].
    """
    model, prior, experiment, remarks = _tpm.import_description_of(
        path, base, tip, None if lock is None else dict(lock), None if losses is None else list(losses)
    )
    return Imported(Model.from_text(model), values_of(prior), experiment, remarks)


def payload(
    model: Model, without: Result, with_load: Result, *, body: str | None = None, density: float = 2700.0
) -> dict[str, Any]:
    """Mass, centre and inertia of a load from two results of an arm, without and with it, as `tpm payload --json`."""
    return _tpm.payload(model._native, json_of(without), json_of(with_load), body, density)


def inertias(
    model: Model,
    result: Result,
    description: Path,
    *,
    values: Mapping[str, float] | None = None,
    weight: float = 1.0,
    base: str | None = None,
    tip: str | None = None,
    lock: Mapping[str, float] | None = None,
) -> tuple[dict[str, Any], str | None]:
    """Inertias that the links of an arm can have, from its result, nearest to those of its description: as `tpm inertias --json`, and the URDF with
    them (nothing for another kind of description)."""
    return _tpm.inertias(
        model._native, json_of(result), description, dict(values or {}), weight, base, tip, None if lock is None else dict(lock)
    )
