"""The chapter and the notebook of the book, executed."""

import json
import re
from pathlib import Path
from typing import Any

import nbclient
import nbformat
import pytest
from conftest import MODELS, ROOT, Command

import tpm


def test_the_chapter_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    text = (ROOT / "docs" / "python.md").read_text()
    snippets = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(snippets) > 5
    names: dict[str, Any] = {}
    for snippet in snippets:
        exec(compile(snippet, "docs/python.md", "exec"), names)


def test_the_notebook_gives_the_numbers_of_the_command_line(tpm_command: Command, tmp_path: Path) -> None:
    notebook = nbformat.read(ROOT / "docs" / "first.ipynb", as_version=4)  # type: ignore[no-untyped-call]
    lines = [line for cell in notebook.cells if cell.cell_type == "code" for line in cell.source.splitlines()]
    assert len(lines) <= 10
    notebook.cells.append(nbformat.v4.new_code_cell("print(result.json())"))  # type: ignore[no-untyped-call]
    client = nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(ROOT)}})
    client.execute()
    shown = "".join(output.get("text", "") for output in notebook.cells[-1].outputs)
    html = [output.data["text/html"] for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output and "text/html" in output.data]
    assert len(html) == 1 and html[0].startswith("<table>")

    cart, log = MODELS / "mass_spring_drag.tpm", tmp_path / "run.csv"
    assert tpm_command("simulate", cart, "-o", log).returncode == 0
    theirs = json.loads(tpm_command("identify", cart, "--log", log, "--hold", "zoh", "--json").stdout)
    ours = json.loads(shown)
    for key in ("parameters", "covariance", "residual", "rank", "condition", "warnings"):
        assert ours[key] == theirs[key], key
    assert tpm.__version__
