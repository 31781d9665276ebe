"""The notebooks as pages, with the output that they keep: nothing is run, the tests see to it that it is today's."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

FOLDER = Path(__file__).parents[2] / "notebooks"


def on_files(files: Files, config: Any) -> Files:
    """Add a page a notebook, and its pictures."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        parts, pictures = [], []
        for cell in json.loads(path.read_text("utf-8"))["cells"]:
            parts += list(_cell(cell, path.stem, pictures))
        files.append(File.generated(config, f"tutorials/{path.stem}.md", content="\n\n".join(parts) + "\n"))
        for number, picture in enumerate(pictures):
            files.append(File.generated(config, f"tutorials/{path.stem}_{number}.png", content=picture))
    return files


def _cell(cell: dict[str, Any], name: str, pictures: list[bytes]) -> Iterator[str]:
    text = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield text
        return
    yield f"```python\n{text}\n```"
    for output in cell["outputs"]:
        data = output.get("data", {})
        if "image/png" in data:
            yield f"![What the code above draws]({name}_{len(pictures)}.png)"
            pictures.append(base64.b64decode("".join(data["image/png"])))
        else:
            yield f"```text\n{''.join(output.get('text') or data['text/plain']).rstrip()}\n```"
