"""What the README and the pages in docs/ show is run."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import json
import re
import shlex
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import typer

import urdfcal
from tests.conftest import CliResult
from tests.support.meshes import STL
from tests.support.paths import ROOT
from urdfcal.calibration.asking.stands_out import WORDS, StandsOut
from urdfcal.calibration.rig_file import RigFile, read_rig_file
from urdfcal.cell.collisions import cell_of
from urdfcal.cli.main import app
from urdfcal.model.gauge import build_error_model
from urdfcal.planning.limits import read_limits
from urdfcal.robot.configurations import joint_limits, random_positions
from urdfcal.robot.robot import Robot
from urdfcal.vision.camera.camera_file import read_camera
from urdfcal.vision.camera.markers import read_screen_markers
from urdfcal.vision.render import usual_camera

DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [ROOT / "README.md", *DOCS, ROOT / "robots" / "README.md", ROOT / "CONTRIBUTING.md"]
FENCED = re.compile(r"^ *```([^\n]*)\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)

Runs = dict[tuple[str, ...], tuple[CliResult, dict[str, bytes]]]  # by all commands up to one: what it printed, and the files there are then


def blocks(*languages: str) -> list[object]:
    """Code blocks of all pages in these languages, named by page and place."""
    return [
        pytest.param(
            textwrap.dedent(match[2]), id=f"{page.relative_to(ROOT)}:{page.read_text('utf-8').count(chr(10), 0, match.start()) + 1}"
        )
        for page in PAGES
        for match in FENCED.finditer(page.read_text("utf-8"))
        if match[1] in languages
    ]


@pytest.fixture(scope="module")
def printed() -> Runs:
    """What commands printed and wrote, by all that ran up to them: pages show the same ones, which then run once."""
    return {}


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
    assert ("joint2.d_a" in errors.names) is ("joint*.d_a: {fixed: true}" not in block)


@pytest.mark.parametrize("block", blocks("yaml screen.yaml"))
def test_the_screen_block_is_taken(block: str, tmp_path: Path) -> None:
    """The screen.yaml that is shown is read."""
    (tmp_path / "screen.yaml").write_text(block)
    assert len(read_screen_markers(tmp_path / "screen.yaml").centres) == 4


@pytest.mark.parametrize("block", blocks("yaml limits.yaml"))
def test_limits_on_pages_are_read(block: str, tmp_path: Path, robots: dict[str, Robot]) -> None:
    """The limits.yaml that is shown narrows a UR5's."""
    (tmp_path / "limits.yaml").write_text(block)
    narrower, own = read_limits(tmp_path / "limits.yaml", robots["ur5"]), joint_limits(robots["ur5"])
    assert (np.ptp(narrower, axis=0) < np.ptp(own, axis=0)).any()


@pytest.mark.parametrize("block", blocks("yaml scene.yaml"))
def test_scene_blocks_are_taken(block: str, tmp_path: Path, robots: dict[str, Robot]) -> None:
    """The scene.yaml that is shown stands around a UR5."""
    (tmp_path / "scene.yaml").write_text(block)
    (tmp_path / "fixture.stl").write_text(STL)
    free = cell_of(robots["ur5"], scene=tmp_path / "scene.yaml").free(random_positions(robots["ur5"], 40, np.random.default_rng(0)))
    assert 0 < free.sum() < 40


@pytest.mark.parametrize("block", blocks("yaml camera.yaml"))
def test_the_camera_block_is_taken(block: str, tmp_path: Path) -> None:
    """The camera.yaml that is shown is read."""
    (tmp_path / "camera.yaml").write_text(block)
    assert read_camera(tmp_path / "camera.yaml").size == (640, 480)


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
def test_the_output_shown_is_the_output(block: str, checkout: Path, run_cli: Callable[..., CliResult], printed: Runs) -> None:
    """What stands under a command is what it prints today, its tables in 80 columns."""
    ran: tuple[str, ...] = ()
    for command, *shown in (part.splitlines() for part in block.split("$ ")[1:]):
        ran = (*ran, command)
        done = again(ran, checkout, run_cli, printed)
        assert (shlex.split(command)[0], done.code) == ("urdfcal", 0), done.err
        assert missing(shown, done.out) == []
        assert [line for line in done.out.splitlines() if "─" in line and len(line) > 80] == []


def again(ran: tuple[str, ...], folder: Path, run_cli: Callable[..., CliResult], printed: Runs) -> CliResult:
    """The last of these commands, run where it has not yet been run behind the others, with its files put back where it has."""
    if ran not in printed:
        done = run_cli(*shlex.split(ran[-1])[1:])
        printed[ran] = done, {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    done, files = printed[ran]
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return done


def test_what_is_missing_is_seen() -> None:
    """A shown line that is not printed, or printed in another order, is named; lines left out are not."""
    assert missing(["a", "...", "c"], "a\nb\nc") == []
    assert missing(["a", "d"], "a\nb\nc") == ["d"]
    assert missing(["c", "a"], "a\nb\nc") == ["a"]


def test_every_command_is_in_the_reference() -> None:
    """The page of commands, which is made from them, has a heading for each and a line for each of its options."""
    page = hook("commands").page()
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        section = page.split(f"\n## urdfcal {name}\n")[1].split("\n## ")[0]
        assert [option for each in command.params for option in each.opts if option.startswith("--") and option not in section] == []


def test_every_public_name_is_in_the_reference() -> None:
    """The page of the Python interface has whatever `import urdfcal` gives."""
    page = (ROOT / "docs" / "reference" / "python.md").read_text("utf-8")
    shown = set(re.findall(r"^::: [\w.]+\.(\w+)$", page, re.MULTILINE)) | set(re.findall(r"`urdfcal\.(\w+)`", page))
    assert set(urdfcal.__all__) - shown == set()


def test_what_the_reference_shows_is_there() -> None:
    """Every name that the page of the Python interface documents is in the module that it is taken from."""
    names = re.findall(r"^::: ([\w.]+)\.(\w+)$", (ROOT / "docs" / "reference" / "python.md").read_text("utf-8"), re.MULTILINE)
    assert [name for module, name in names if not hasattr(importlib.import_module(module), name)] == []


def test_the_keys_of_the_json_are_in_the_reference(checkout: Path, run_cli: Callable[..., CliResult]) -> None:
    """The table of `fit --json` has every key that is printed, and no other."""
    table = (ROOT / "docs" / "reference" / "json.md").read_text("utf-8").split("## fit\n")[1].split("\n```")[0]
    listed = {key for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE) for key in re.findall(r"`(\w+)`", row)}
    assert listed == set(json.loads(run_cli("fit", "robots/arm7/arm7.urdf.xacro", "robots/arm7/measurements.csv", "--json").out))


def test_every_entry_of_rig_yaml_is_in_the_reference() -> None:
    """The table of rig.yaml has every entry that is read, and no other."""
    page = (ROOT / "docs" / "reference" / "rig.md").read_text("utf-8")
    rows = re.findall(r"^\| (`.*?) \|", page, re.MULTILINE)
    assert {key for row in rows for key in re.findall(r"`(\w+)`", row)} == set(RigFile.model_fields)


def test_everything_that_may_stand_out_is_told() -> None:
    """The table of what residuals may ask for has every word of it, beside what would confirm it."""
    page = (ROOT / "docs" / "how-to" / "verdict.md").read_text("utf-8").split("## What the residuals ask for\n")[1]
    rows = [tuple(row.strip("| ").split(" | ")) for row in page.splitlines() if row.startswith("| ")][1:]
    assert rows == [(word, StandsOut(what, "", 0.0).confirmed_by) for what, word in WORDS.items()]


def hook(name: str) -> ModuleType:
    """A part of the site's build, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / "site" / f"{name}.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
    """Every page in docs/ is linked from the README, or from a page there; and stands in the site's contents."""
    pages = [ROOT / "README.md", *DOCS]
    linked = {path.resolve() for page in pages for path, _ in links(page) if path.resolve() != page}
    contents = (ROOT / "mkdocs.yml").read_text("utf-8")
    assert set(DOCS) <= linked
    assert [page.name for page in DOCS if f"{page.relative_to(ROOT / 'docs').as_posix()}\n" not in contents] == []


def test_the_readme_is_short() -> None:
    """A newcomer reads it to its end."""
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 150
