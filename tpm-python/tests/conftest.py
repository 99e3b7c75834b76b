"""The command line, and data of a simulated machine that both it and the module read."""

import csv
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"

Command = Callable[..., "subprocess.CompletedProcess[str]"]
Columns = dict[str, NDArray[np.float64]]


@pytest.fixture(scope="session")
def tpm_command() -> Command:
    """Runs the command line, which `check.sh` has built."""
    program = os.environ.get("TPM")
    if program is None:
        pytest.fail("TPM names no program; check.sh builds it and runs these tests")

    def run(*arguments: object) -> "subprocess.CompletedProcess[str]":
        return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=False)

    return run


def read(path: Path) -> Columns:
    """Columns of a log; `float` reads every digit that was written."""
    with open(path, newline="") as file:
        header, *rows = csv.reader(file)
    return {name: np.array([float(row[i]) for row in rows]) for i, name in enumerate(header)}


@pytest.fixture(scope="session")
def log(tpm_command: Command, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the shipped cart on its simulated machine."""
    path = tmp_path_factory.mktemp("log") / "run.csv"
    done = tpm_command("simulate", MODELS / "mass_spring_drag.tpm", "-o", path)
    assert done.returncode == 0, done.stderr
    return path
