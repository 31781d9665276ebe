"""One robot of a fleet: `fit` called in a process that serves many, its results in a folder that is there whole or not at all."""

from __future__ import annotations

import contextlib
import json
import shutil
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from urdfcal.fleet.manifest import FleetRow
    from urdfcal.fleet.outcome import Outcome

RESULT = "result.json"
LOADED = ("urdfcal.api", "urdfcal.cli.fit_command", "urdfcal.cli.fit_outputs")
_alone = threading.Lock()  # a command has its process's streams and working folder for itself


def fit_row(row: FleetRow, into: Path) -> Outcome:
    """A robot: as an earlier run left it, if that was made of the same, else fitted."""
    from urdfcal.cli.run import error_of_ours
    from urdfcal.fleet.outcome import Outcome

    if row.trouble:
        return Outcome(row.name, 2, row.trouble)
    try:
        made_of, place = row.made_of(), into / row.name
        earlier = kept(place, made_of)
        return earlier if earlier is not None else _fitted(row, place, made_of)
    except Exception as error:  # the others go on; it is told with its row
        return Outcome(row.name, 70, error_of_ours(error))


def kept(place: Path, made_of: str) -> Outcome | None:
    """What an earlier run left in a folder, if it was made of the same."""
    from urdfcal.fleet.outcome import Outcome

    try:
        told = json.loads((place / RESULT).read_text("utf-8"))
        if told["made_of"] != made_of:
            return None
        return Outcome(place.name, told["exit_code"], "", told["seconds"], True, told["result"], told["joints"])
    except (OSError, ValueError, KeyError, TypeError):  # not there, or not ours: it is fitted
        return None


def _fitted(row: FleetRow, place: Path, made_of: str) -> Outcome:
    from urdfcal.base.errors import UrdfcalError
    from urdfcal.base.whole_files import folder_whole
    from urdfcal.fleet.outcome import Outcome

    began = time.process_time()
    try:
        _cleared(place)
        with folder_whole(place) as folder:
            code, message, result = _called(row, folder)
            if not result:
                raise _NothingThere(code, message)
            seconds = time.process_time() - began
            joints = _joints(folder / f"{row.name}_calibration.yaml")
            told = {"made_of": made_of, "exit_code": code, "seconds": seconds, "result": result, "joints": joints}
            (folder / RESULT).write_text(json.dumps(told), "utf-8")
        return Outcome(row.name, code, "", seconds, False, result, joints)
    except _NothingThere as nothing:
        return Outcome(row.name, nothing.code, nothing.message, time.process_time() - began)
    except UrdfcalError as error:
        return Outcome(row.name, error.exit_code, str(error), time.process_time() - began)


class _NothingThere(Exception):
    """A fit that wrote nothing."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code, self.message = code, message


def _called(row: FleetRow, folder: Path) -> tuple[int, str, dict[str, Any]]:
    """Exit code, complaint and result of `fit`, which begins where the row's paths do."""
    from urdfcal.cli.fit_command import fit
    from urdfcal.cli.run import called
    from urdfcal.fleet.fit_words import placed

    words = [str(row.description), str(row.measurements), *placed(row.options, folder), "-o", str(folder / f"{row.name}_calibrated.urdf")]
    with _alone, contextlib.chdir(row.folder):
        heard = called(fit, [*words, "--json", "-q"])
    lines = [line.removeprefix("urdfcal: ") for line in heard.err.splitlines() if line.strip()]
    try:
        result = json.loads(heard.out)
    except ValueError:
        result = {}
    written = (folder / f"{row.name}_calibration.yaml").is_file()
    return heard.code, lines[-1] if lines else "", result if written else {}


def _cleared(place: Path) -> None:
    """Make room for a result where an earlier one of ours is out of date.

    Raises:
        UsageError: something else is there.
    """
    from urdfcal.base.errors import UsageError

    if not place.exists():
        return
    if not (place / RESULT).is_file():
        raise UsageError(f"{place}: is there already and is no result of urdfcal fleet")
    shutil.rmtree(place)


def _joints(record: Path) -> dict[str, Any]:
    """What a record says of the joints' parameters, as plain lists."""
    import yaml

    content = yaml.load(record.read_text("utf-8"), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    posterior, told = content.get("posterior"), {entry["name"]: entry for entry in content["parameters"]}
    names = [name for name in (posterior or {}).get("names", []) if name in told]
    model = {"model": str(content["robot"]["name"])}
    if not posterior or len(names) < len(posterior["names"]):  # with joints of an earlier calibration: not this robot's own
        return model
    return model | {
        "names": names,
        "units": [told[name]["unit"] for name in names],
        "values": [told[name]["value"] for name in names],
        "covariance": posterior["covariance"],
        "prior_sigma": posterior["prior_sigma"],
        "prior_mean": [told[name].get("prior_mean", 0.0) for name in names],
    }
