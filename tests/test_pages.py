"""What the README and the pages in docs/ show is run."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.paths import ROOT
from urdfcal.calibration.rig_file import read_rig_file
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot
from urdfcal.vision.camera.markers import read_screen_markers
from urdfcal.vision.render import usual_camera

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "robots" / "README.md", ROOT / "CONTRIBUTING.md"]
FENCED = re.compile(r"^ *```([^\n]*)\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)


def blocks(*languages: str) -> list[object]:
    """Code blocks of all pages in these languages, named by page and place."""
    return [
        pytest.param(match[2], id=f"{page.relative_to(ROOT)}:{page.read_text('utf-8').count(chr(10), 0, match.start()) + 1}")
        for page in PAGES
        for match in FENCED.finditer(page.read_text("utf-8"))
        if match[1] in languages
    ]


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that has the checkout's robots and nothing else."""
    (tmp_path / "robots").symlink_to(ROOT / "robots")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def half_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """The camera that `render` places has half of its pixels along each side: enough to see most spots."""
    monkeypatch.setattr(usual_camera, "_SIZE", (800, 600))
    monkeypatch.setattr(usual_camera, "_FOCAL", 750.0)


@pytest.mark.parametrize("block", blocks("python"))
def test_python_blocks_run(block: str, checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every Python block runs as it stands, prints the errors and writes the URDF."""
    exec(compile(block, "a page's block", "exec"), {})
    assert "joint1.d_a" in capsys.readouterr().out
    assert (checkout / "arm7_calibrated.urdf").exists()


@pytest.mark.parametrize("block", blocks("python no-run"))
def test_python_blocks_that_need_more_name_what_there_is(block: str) -> None:
    """What a Python block imports from urdfcal, or takes from it, is there even where the block cannot run without data."""
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom) and node.module:
            assert all(hasattr(importlib.import_module(node.module), name.name) for name in node.names)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "urdfcal":
            assert hasattr(importlib.import_module("urdfcal"), node.attr)


@pytest.mark.parametrize("block", blocks("yaml"))
def test_rig_blocks_are_taken(block: str, tmp_path: Path, robots: dict[str, Robot]) -> None:
    """Every rig.yaml is read and fits arm7."""
    path = tmp_path / "rig.yaml"
    path.write_text(block)
    errors = build_error_model(robots["arm7"].chain, robots["arm7"].rig, read_rig_file(path).options())
    assert "joint2.d_a" not in errors.names


@pytest.mark.parametrize("block", blocks("yaml screen.yaml"))
def test_the_screen_block_is_taken(block: str, tmp_path: Path) -> None:
    """The screen.yaml that is shown is read."""
    (tmp_path / "screen.yaml").write_text(block)
    assert len(read_screen_markers(tmp_path / "screen.yaml").centres) == 4


@pytest.mark.parametrize("block", [block for block in blocks("bash") if "# install and" not in str(block)])
@pytest.mark.usefixtures("half_size")
def test_shell_blocks_run(block: str, checkout: Path, run_cli: Callable[..., CliResult]) -> None:
    """Lines of commands run one after the other, as from simulated poses to pictures, spots and a calibrated URDF."""
    for line in block.splitlines():
        done = run_cli(*shlex.split(line, comments=True)[1:])
        assert done.code == 0, done.err
    assert (checkout / "arm7_calibrated.urdf").exists()


def missing(shown: list[str], printed: str) -> list[str]:
    """Lines that are shown and not printed in this order; `...` and empty ones count for nothing."""
    left = iter(line.rstrip() for line in printed.splitlines())
    return [line for line in shown if line.strip() not in ("", "...") and line.rstrip() not in left]


@pytest.mark.parametrize("block", blocks("console"))
@pytest.mark.usefixtures("checkout")
def test_the_output_shown_is_the_output(block: str, run_cli: Callable[..., CliResult]) -> None:
    """What stands under a command is what it prints today."""
    for command, *shown in (part.splitlines() for part in block.split("$ ")[1:]):
        program, *words = shlex.split(command)
        done = run_cli(*words)
        assert (program, done.code) == ("urdfcal", 0), done.err
        assert missing(shown, done.out) == []


def test_what_is_missing_is_seen() -> None:
    """A shown line that is not printed, or printed in another order, is named; lines left out are not."""
    assert missing(["a", "...", "c"], "a\nb\nc") == []
    assert missing(["a", "d"], "a\nb\nc") == ["d"]
    assert missing(["c", "a"], "a\nb\nc") == ["a"]


def test_every_command_is_in_the_table(run_cli: Callable[..., CliResult]) -> None:
    """The README's table of commands has every command of --help."""
    listed = re.search(r"Commands:\n(.*)", run_cli("--help").out, re.DOTALL)
    assert listed
    commands = set(re.findall(r"^  (\w+) ", listed[1], re.MULTILINE)) - {"version"}
    assert commands == set(re.findall(r"^\| `urdfcal (\w+)", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE))


def anchors(page: Path) -> set[str]:
    """What a link into a page may name: its headings, as GitHub writes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def links(page: Path) -> Iterator[tuple[Path, str]]:
    """Files and headings that a page leads to, within the project."""
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCED.sub("", page.read_text("utf-8"))):
        path, _, heading = target.partition("#")
        if "://" not in target:
            yield (page.parent / path if path else page), heading


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    """Every link within the project names a file, and a heading in it, that is there."""
    for path, heading in links(page):
        assert path.exists(), path
        assert not heading or heading in anchors(path), f"{path}#{heading}"


def test_every_page_can_be_found() -> None:
    """Every page in docs/ is linked from the README."""
    linked = {path.resolve() for path, _ in links(ROOT / "README.md")}
    assert set((ROOT / "docs").glob("*.md")) <= linked
