"""Meshes are read in a process of its own first, which may crash, wait or fill its memory without harm to ours."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.meshes import OBJ, STL, collada, showing
from urdfcal.output.view import mesh_child
from urdfcal.output.view.mesh_child import faults
from urdfcal.output.view.shapes import robot_shapes


@pytest.fixture
def alone() -> Iterator[None]:
    """No child is running, before or after, and nothing is known of any file."""
    mesh_child._stop()
    mesh_child._read.clear()
    yield
    mesh_child._stop()
    mesh_child._read.clear()


def mesh(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_sound_meshes_are_read_by_one_child(tmp_path: Path, alone: None) -> None:
    """Of every kind, each once, all by the same process."""
    paths = [mesh(tmp_path, "a.stl", STL), mesh(tmp_path, "a.obj", OBJ), mesh(tmp_path, "a.dae", collada())]
    assert faults(paths[:1]) == {}
    (child,) = mesh_child._running
    assert faults(paths * 2) == {}
    assert mesh_child._running == [child]


def test_a_mesh_that_states_a_billion_numbers_is_a_simple_shape(tmp_path: Path, alone: None) -> None:
    """Its reader may have 3 GB, and gives up; the next mesh has a new one."""
    mesh(tmp_path, "big.dae", collada().replace('count="9"', 'count="3999999999"'))
    shapes = robot_shapes(showing("big.dae", tmp_path))
    assert "upper" in shapes.simple
    assert "big.dae cannot be read" in shapes.warnings[0]
    assert faults([mesh(tmp_path, "a.stl", STL)]) == {}


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ("import os; os.kill(os.getpid(), 11)", "ended (killed by SIGSEGV)"),
        ("import sys; sys.exit(7)", "ended (exit code 7)"),
        ("import time; time.sleep(60)", "not read after 0.3 s"),
    ],
)
def test_a_reader_that_ends_is_told_of(ends: str, words: str, tmp_path: Path, alone: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """However it ends, the mesh is a simple shape and the line says how."""
    monkeypatch.setattr(mesh_child, "_COMMAND", f"import sys; sys.stdin.readline(); sys.stdin.readline(); {ends}")
    monkeypatch.setattr(mesh_child, "SECONDS", 0.3 if "sleep" in ends else 20.0)
    mesh(tmp_path, "a.stl", STL)
    shapes = robot_shapes(showing("a.stl", tmp_path))
    assert "upper" in shapes.simple
    assert words in shapes.warnings[0]
    assert not mesh_child._running


@pytest.mark.parametrize(
    ("name", "text"), [("a.obj", f"# caf\xe9\n{OBJ}"), ("a.dae", collada().replace("<asset/>", "<!--\xe9--><asset/>"))]
)
def test_words_in_another_encoding_are_a_simple_shape(name: str, text: str, tmp_path: Path) -> None:
    """The page takes UTF-8 alone."""
    (tmp_path / name).write_text(text.replace('version="1.0"', 'version="1.0" encoding="latin-1"'), encoding="latin-1")
    shapes = robot_shapes(showing(name, tmp_path))
    assert "is not UTF-8 text" in shapes.warnings[0]
