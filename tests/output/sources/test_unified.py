"""Patches as git takes them, of files with odd ends and names."""

from __future__ import annotations

import subprocess
from pathlib import Path

from urdfcal.output.sources.layout import Layout
from urdfcal.output.sources.unified import patch_text


def test_git_makes_the_same_bytes(tmp_path: Path) -> None:
    """Files without a last line end, with Windows' line ends, a byte-order mark, Latin-1 or blanks in their names come out right."""
    before = {"no end.xacro": b"a\nb", "dos.xacro": b"\xef\xbb\xbfa\r\nb\r\n", "é.yaml": b"a: \xe9\n\x0cb: 1\n"}
    after = {"no end.xacro": b"a\nc", "dos.xacro": b"\xef\xbb\xbfa\r\nc\r\n", "é.yaml": b"a: \xe9\n\x0cb: 2\n"}
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    for name, text in before.items():
        (tmp_path / name).write_bytes(text)
    old, new = ({tmp_path.resolve() / name: text for name, text in each.items()} for each in (before, after))
    patch = patch_text(old, new, Layout(tmp_path / "dos.xacro", tuple(old), tuple(new)))
    subprocess.run(["git", "apply"], cwd=tmp_path, check=True, input=patch)
    assert {name: (tmp_path / name).read_bytes() for name in after} == after
