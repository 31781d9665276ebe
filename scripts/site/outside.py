"""Pages of the site that are files of the project outside docs/, and links that lead to such.

In the checkout every link is as it stands in the file; here it is turned to where the site has what it leads to. Files that are no
pages (a macro, an example) are copied to `source/`.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contribute/index.md",
    "CHANGELOG.md": "contribute/changes.md",
    "robots/README.md": "reference/robots.md",
} | {f"notebooks/{path.name}": f"tutorials/{path.stem}.md" for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
ORIGINS = {uri: path for path, uri in PAGES.items()}
_LINK = re.compile(r"(^ *```.*?^ *```$)|\]\(([^)\s:]+?)(#[^)\s]*)?\)", re.DOTALL | re.MULTILINE)
_ALONE = ("index.md", "benchmarks.md")  # the only pages under their tabs: no contents beside them
_FENCE = re.compile(r"^( *```\w+) (\S+)$", re.MULTILINE)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages from outside docs/, and the files that any page links to."""
    for path, uri in PAGES.items():
        if path.endswith(".md"):
            files.append(File.generated(config, uri, content=(ROOT / path).read_text("utf-8")))
    for target in sorted({target for page in files.documentation_pages() for target in _sources(page)}):
        files.append(File.generated(config, f"source/{target}", abs_src_path=str(ROOT / target)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn links to where the site has what they lead to, and what our tests read behind a block's language to a title or nothing."""
    if page.file.src_uri in _ALONE:
        page.meta["hide"] = ["navigation"]
    return _FENCE.sub(_fence, _turned(markdown, page.file.src_uri, _place))


def _fence(match: re.Match[str]) -> str:
    return match[1] if match[2] == "no-run" else f'{match[1]} title="{match[2]}"'


def _origin(uri: str) -> str:
    """The file of the project that a page was made from."""
    return ORIGINS.get(uri, f"docs/{uri}")


def _sources(page: File) -> list[str]:
    """Files that a page leads to and that are neither pages nor in docs/."""
    seen: list[str] = []
    if not page.src_uri.startswith("tutorials/"):
        _turned(page.content_string, page.src_uri, lambda target: seen.append(target) or target)
    return [target for target in seen if _place(target) == f"source/{target}"]


def _place(target: str) -> str:
    """Where the site has a file of the project."""
    if target in PAGES:
        return PAGES[target]
    if target.startswith("docs/"):
        return target.removeprefix("docs/")
    if target.startswith("notebooks/"):  # a picture that a notebook keeps
        return target.replace("notebooks/", "tutorials/", 1)
    return f"source/{target}" if (ROOT / target).is_file() else target


def _turned(markdown: str, uri: str, place: Callable[[str], str]) -> str:
    folder = posixpath.dirname(_origin(uri))

    def link(match: re.Match[str]) -> str:
        if match[1] or match[2] is None:
            return match[0]
        target = posixpath.normpath(posixpath.join(folder, match[2]))
        return f"]({os.path.relpath(place(target), posixpath.dirname(uri) or '.')}{match[3] or ''})"

    return _LINK.sub(link, markdown)
