"""Which robots there are: rows of a CSV, or folders that each hold a description and its measurements."""

from __future__ import annotations

import glob
import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from urdfcal.base.errors import InputError, UsageError
from urdfcal.base.files import sha256
from urdfcal.base.tables import Table, read_table
from urdfcal.base.version import __version__
from urdfcal.fleet.fit_words import named, unsuitable

COLUMNS = ("name", "description", "measurements", "options")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_DESCRIPTIONS, _MEASUREMENTS = ("*.urdf", "*.xacro"), ("*.csv", "*.xlsx")


@dataclass(frozen=True)
class FleetRow:
    """A robot and how it is to be fitted.

    Attributes:
        name: Of the robot, and of its folder among the results.
        folder: Where relative paths begin.
        description: Its URDF or xacro file.
        measurements: What was measured of it.
        options: Further words for `fit`.
        trouble: Why it cannot be fitted; empty where it can.
    """

    name: str
    folder: Path
    description: Path
    measurements: Path
    options: tuple[str, ...] = ()
    trouble: str = ""

    def made_of(self) -> str:
        """Hash of all that decides its result: the files that it names, the options, this version."""
        files = [self.description, self.measurements, *(self.folder / word for word in named(self.options))]
        contents = [sha256(file.read_bytes()) for file in files if file.is_file()]
        return sha256("\n".join([__version__, *map(str, self.options), *contents]).encode())


def fleet_rows(manifest: str, options: Sequence[str] = ()) -> list[FleetRow]:
    """The robots of a manifest.

    Args:
        manifest: A CSV with the columns `description`, `measurements` and, if need be, `name` and `options`; or a pattern of folders.
        options: Words for `fit` of all of them, before a row's own.

    Raises:
        InputError: the manifest cannot be read, or names robots alike.
        UsageError: no folder matches, or an option is none for a robot of a fleet.
    """
    if said := unsuitable(options):
        raise UsageError(f"--fit: {said}")
    path = Path(manifest)
    rows = list(_from_table(path, tuple(options)) if path.suffix.lower() in (".csv", ".tsv") else _from_folders(manifest, tuple(options)))
    names = [row.name for row in rows]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{len(twice)} names stand for several robots, such as '{twice[0]}'; a column `name` tells them apart", path)
    return rows


def _from_table(path: Path, options: tuple[str, ...]) -> Iterator[FleetRow]:
    table = read_table(path, "columns description and measurements", "one row a robot")
    for column in ("description", "measurements"):
        if column not in table.names:
            raise table.fail(None, column, f"is missing; expected columns {', '.join(COLUMNS)}")
    folder = path.resolve().parent
    for row in range(len(table.columns["description"])):
        description, measurements = (_cell(table, column, row) for column in ("description", "measurements"))
        name = _cell(table, "name", row) or Path(measurements).stem or f"row{row + 1}"
        trouble = _trouble(name, {"description": description, "measurements": measurements})
        try:
            own = tuple(shlex.split(_cell(table, "options", row)))
        except ValueError as error:
            own, trouble = (), trouble or f"options: {error}"
        trouble = trouble or _beginning(f"row {row + 1}: ", unsuitable(own))
        yield FleetRow(name, folder, folder / description, folder / measurements, (*options, *own), trouble)


def _cell(table: Table, column: str, row: int) -> str:
    return str(table.columns[column][row]).strip() if column in table.names else ""


def _beginning(start: str, text: str) -> str:
    return start + text if text else ""


def _trouble(name: str, files: dict[str, str]) -> str:
    missing = [what for what, file in files.items() if not file]
    if missing:
        return f"names no {' and no '.join(missing)}"
    return "" if _NAME.fullmatch(name) else f"'{name}' can be no folder; expected letters, figures, '.', '_' and '-'"


def _from_folders(pattern: str, options: tuple[str, ...]) -> Iterator[FleetRow]:
    folders = [Path(found) for found in sorted(glob.glob(pattern)) if Path(found).is_dir()]
    if not folders:
        raise UsageError(f"{pattern}: no such manifest (.csv), and no folder matches; expected folders with a description and measurements")
    for folder in folders:
        found = {what: _of(folder, endings) for what, endings in (("description", _DESCRIPTIONS), ("measurements", _MEASUREMENTS))}
        off = [f"holds {len(files)} files of {what}, expected one" for what, files in found.items() if len(files) != 1]
        files = [own[0] if len(own) == 1 else folder for own in found.values()]
        yield FleetRow(folder.name, folder.resolve(), files[0].resolve(), files[1].resolve(), options, off[0] if off else "")


def _of(folder: Path, endings: Sequence[str]) -> list[Path]:
    return sorted(file for ending in endings for file in folder.glob(ending) if file.is_file())
