"""Campaigns in a folder: what to play next goes out as arrays, what was recorded comes in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tpm import _tpm
from tpm._model import Changes, Model
from tpm._result import Identification
from tpm._settings import Bounds, ColumnSettings, Path, Signals, Stamps, told

if TYPE_CHECKING:
    from typing_extensions import Unpack


class Submission:
    """What became of a submitted run. A run that is kept stays where `result` raises an Error: the runs do not say enough yet."""

    def __init__(self, native: _tpm.Submission) -> None:
        self._native = native

    @property
    def kept(self) -> bool:
        """Whether the run is kept."""
        return self._native.kept

    @property
    def outcome(self) -> str | None:
        """Why the campaign has ended; nothing while it goes on."""
        return self._native.outcome

    @property
    def run(self) -> dict[str, Any]:
        """The run: its motion, its tracking error, and what was left out of it."""
        return self._native.run

    @property
    def result(self) -> Identification:
        """The identification from all runs so far."""
        return Identification._of(self._native.result)

    def __repr__(self) -> str:
        return repr(self._native)


class Campaign:
    """A campaign in a folder: model, experiment, and every finished run."""

    def __init__(self, native: _tpm.Campaign) -> None:
        self._native = native

    @property
    def outcome(self) -> str | None:
        """Why the campaign has ended; nothing while it goes on."""
        return self._native.outcome

    @staticmethod
    def begin(
        folder: Path,
        model: Model,
        experiment: Path | None = None,
        *,
        changes: Changes | None = None,
        pattern: str | None = None,
        bounds: Bounds | None = None,
    ) -> Campaign:
        """Begins a campaign in a folder, as `tpm campaign start`."""
        return Campaign(
            _tpm.Campaign.begin(folder, model._native, experiment, changes=changes, pattern=pattern, bounds=bounds)
        )

    @staticmethod
    def open(folder: Path, *, bounds: Bounds | None = None) -> Campaign:
        """Goes on with a campaign."""
        return Campaign(_tpm.Campaign.open(folder, bounds=bounds))

    def next(self) -> _tpm.Run | None:
        """The run to be played next; nothing when the campaign has ended."""
        return self._native.next()

    @told(ColumnSettings)
    def submit(
        self, t: Stamps, signals: Signals, *, stopped: bool = False, **settings: Unpack[ColumnSettings]
    ) -> Submission:
        """Takes in what was recorded of the run that was to be played next, as arrays. `stopped`: the machine was stopped before its end."""
        return Submission(self._native.submit(t, signals, stopped=stopped, **settings))

    @told(ColumnSettings)
    def submit_log(self, log: Path, *, stopped: bool = False, **settings: Unpack[ColumnSettings]) -> Submission:
        """Takes in the file of a log, as `tpm campaign submit`."""
        return Submission(self._native.submit_log(log, stopped=stopped, **settings))

    def simulate(self, run: _tpm.Run) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """Plays a run on the simulated machine of the experiment: stamps, and coordinates and inputs by name."""
        return self._native.simulate(run)

    def result(self) -> Identification:
        """The identification from all runs so far."""
        return Identification._of(self._native.result())

    def __repr__(self) -> str:
        return repr(self._native)
