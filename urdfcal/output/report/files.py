"""`--report FILE`: a calibration's report as a page, as Markdown or for machines, by the file's ending."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from urdfcal.base.errors import UsageError
from urdfcal.base.files import write_whole
from urdfcal.calibration.analysis.prediction import SpotAccuracy
from urdfcal.calibration.analysis.sag import SagFit
from urdfcal.calibration.result import FitResult
from urdfcal.output.report.sections import sag_section
from urdfcal.output.text.result import calibration_json
from urdfcal.output.text.sag import sag_json

ENDINGS = (".html", ".md", ".json")


def write_report(path: Path, calibration: FitResult, command: Sequence[str]) -> None:
    """Write a report, whole or not at all.

    Args:
        path: Where to; `.html` is one self-contained page, `.md` the same without pictures, `.json` what `--json` prints.
        calibration: What was found.
        command: The command line, for the record.

    Raises:
        UsageError: the file has another ending, or cannot be written.
    """
    write_whole(path, report_bytes(path, calibration, command))


def report_bytes(
    path: Path,
    calibration: FitResult,
    command: Sequence[str],
    sag: SagFit | None = None,
    further: Mapping[str, Any] | None = None,
    spots: SpotAccuracy | None = None,
) -> bytes:
    """The content of a report, by the ending of its file; with what gravity does to the robot, if that is known.

    Args:
        path: The file.
        calibration: What the fit found.
        command: How it was called.
        sag: What gravity does to the robot.
        further: What machines are told beside the fit, for `.json`.
        spots: How far off the spots are predicted to be over the workspace, for the others.

    Raises:
        UsageError: the file has another ending.
    """
    require_report_ending(path)
    if path.suffix.lower() == ".json":
        text = _json(calibration, sag, further or {})
    else:
        text = {".html": _html, ".md": _markdown}[path.suffix.lower()](calibration, command, sag, spots)
    return text.encode("utf-8", "backslashreplace")


def require_report_ending(path: Path) -> None:
    """Refuse a report's file by its name, before any work is done for it.

    Raises:
        UsageError: names the endings that there are.
    """
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"{path}: a report ends in {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}, found '{path.suffix}'")


def _html(calibration: FitResult, command: Sequence[str], sag: SagFit | None, spots: SpotAccuracy | None) -> str:
    from urdfcal.output.report.content import report_of
    from urdfcal.output.report.html import page

    return page(report_of(calibration, command, sag_section(sag), spots), calibration)


def _markdown(calibration: FitResult, command: Sequence[str], sag: SagFit | None, spots: SpotAccuracy | None) -> str:
    from urdfcal.output.report.content import report_of
    from urdfcal.output.report.markdown import markdown

    return markdown(report_of(calibration, command, sag_section(sag), spots))


def _json(calibration: FitResult, sag: SagFit | None, further: Mapping[str, Any]) -> str:
    return json.dumps(calibration_json(calibration) | dict(further) | {"sag": sag_json(sag) if sag is not None else None}, indent=2) + "\n"
