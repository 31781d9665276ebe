"""Expansion without a process of its own, which is most of the time of a small one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from urdfcal.output.sources import tree
from urdfcal.robot.xacro_child import USUAL_LIMIT, Variant, XacroLimit, _variants


def _here(
    path: Path, args: Mapping[str, str], folders: tuple[Path, ...], limit: XacroLimit, overlays: Sequence[Mapping[str, bytes]]
) -> list[Variant]:
    from base64 import b64decode, b64encode

    request = {
        "path": str(path),
        "xacro_args": dict(args),
        "package_dirs": list(map(str, folders)),
        "gigabytes": 1,
        "seconds": limit.seconds,
    }
    request["overlays"] = [{name: b64encode(text) for name, text in overlay.items()} for overlay in overlays]
    return [
        Variant(b64decode(each["text"]) if "text" in each else None, each.get("error", ""), tuple(map(Path, each.get("files", ()))))
        for each in _variants(request)
    ]


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> XacroLimit:
    """The same expansions in this process; the usual limits."""
    monkeypatch.setattr(tree, "variants", _here)
    return USUAL_LIMIT
