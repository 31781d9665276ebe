"""Notebooks run, and the output kept in them is what they show today."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.run_notebooks import FOLDER, ROOT, executed

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def picture(output: dict[str, Any]) -> np.ndarray:
    """A kept figure as pixels, (height, width, channels)."""
    import matplotlib.image

    return np.asarray(matplotlib.image.imread(io.BytesIO(base64.b64decode(output["data"]["image/png"])), format="png"))


def text(outputs: list[dict[str, Any]]) -> str:
    """What a cell prints, and the value of its last line."""
    lines = [output["text"] if "text" in output else output["data"].get("text/plain", []) for output in outputs]
    return "".join(line for part in lines for line in part)


def pictures(outputs: list[dict[str, Any]]) -> list[np.ndarray]:
    """A cell's figures."""
    return [picture(output) for output in outputs if "image/png" in output.get("data", {})]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_it_keeps(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every code cell runs in order, prints the kept text, and draws as many figures as are kept, of their size and none blank."""
    monkeypatch.chdir(ROOT)
    notebook = json.loads(path.read_text("utf-8"))
    for cell, outputs in executed(notebook, path.stem):
        assert text(outputs) == text(cell["outputs"])
        kept, drawn = pictures(cell["outputs"]), pictures(outputs)
        assert len(kept) == len(drawn)
        for old, new in zip(kept, drawn, strict=True):
            np.testing.assert_allclose(new.shape, old.shape, rtol=0.05)  # fonts differ a little between machines
            assert new[..., :3].std() > 0.02
            assert old[..., :3].std() > 0.02


def test_there_are_notebooks() -> None:
    """The folder is not empty, so that the test above tests something."""
    assert NOTEBOOKS
