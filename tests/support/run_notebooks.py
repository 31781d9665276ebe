"""Run the notebooks and keep their output in them: `python tests/support/run_notebooks.py [NAME ...]`.

What a cell prints, the value of its last line and its figures are kept as Jupyter keeps them; Jupyter itself is not needed. The tests
run the cells in the same way and compare.
"""

from __future__ import annotations

import argparse
import ast
import base64
import contextlib
import io
import json
import os
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.support.paths import ROOT

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices are small

FOLDER = ROOT / "notebooks"
Output = dict[str, Any]


def executed(notebook: dict[str, Any], name: str) -> Iterator[tuple[dict[str, Any], list[Output]]]:
    """Run the code cells in order in one namespace; gives back each with the output that it makes now.

    Args:
        notebook: The file's content.
        name: For tracebacks.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(code_cells(notebook), start=1):
        yield cell, list(_outputs("".join(cell["source"]), f"{name}[{number}]", names, number))


def code_cells(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """The cells that hold code."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def _outputs(source: str, name: str, names: dict[str, Any], number: int) -> Iterator[Output]:
    import matplotlib.pyplot as plt

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        value = _run(source, name, names)
    if printed.getvalue():
        yield {"name": "stdout", "output_type": "stream", "text": printed.getvalue().splitlines(keepends=True)}
    if value is not None:
        yield {"data": _shown(value), "execution_count": number, "metadata": {}, "output_type": "execute_result"}
    for figure in map(plt.figure, plt.get_fignums()):
        yield {"data": {"image/png": _png(figure)}, "metadata": {}, "output_type": "display_data"}
    plt.close("all")


def _run(source: str, name: str, names: dict[str, Any]) -> Any:
    """The value of the last line, if it is an expression; a semicolon at its end hides it."""
    tree = ast.parse(source, name)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) and not source.rstrip().endswith(";") else None
    exec(compile(tree, name, "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), name, "eval"), names)


def _shown(value: Any) -> dict[str, list[str]]:
    shown = {"text/plain": repr(value).splitlines(keepends=True)}
    if hasattr(value, "_repr_html_"):
        shown["text/html"] = value._repr_html_().splitlines(keepends=True)
    return shown


def _png(figure: Any) -> str:
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=90, bbox_inches="tight", metadata={"Software": None})
    return base64.b64encode(picture.getvalue()).decode()


def stored(path: Path) -> dict[str, Any]:
    """A notebook with the output of today."""
    notebook: dict[str, Any] = json.loads(path.read_text("utf-8"))
    for number, (cell, outputs) in enumerate(executed(notebook, path.stem), start=1):
        cell["outputs"], cell["execution_count"] = outputs, number
    return notebook


def main() -> None:
    """Parse the command line, run, and store."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="notebooks by name without .ipynb (default: all)")
    given = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    warnings.simplefilter("error")
    for path in [FOLDER / f"{name}.ipynb" for name in given.names] or sorted(FOLDER.glob("*.ipynb")):
        start = time.perf_counter()
        content = stored(path)
        path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", "utf-8")
        print(f"{path.name}: {len(code_cells(content))} cells in {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
