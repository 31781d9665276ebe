"""Where a command writes: places as users state them, refused before any work is done, and the writing itself at its end.

`-o DIR/` puts the default name into a folder; `-o -` sends the main result to stdout, and what is said to people to stderr.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from urdfcal.base.errors import UsageError

STDOUT = Path("-")
MEASUREMENTS = (".csv", ".txt", ".tsv", "")  # what measurements are written to
_DEFAULT_NAME = "<default name>"


def stated_place(text: str | Path) -> Path:
    """A place as an option states it; in a folder the name is left to `named`."""
    text = str(text)
    if text == str(STDOUT):
        sys.stdout = sys.stderr  # what is printed from here on is for people; `deliver` writes the result
        return STDOUT
    return Path(text, _DEFAULT_NAME) if text.endswith("/") or os.path.isdir(text) else Path(text)


def stated_file(text: str | Path) -> Path:
    """The same of a file beside the main output: `-` is a name like others, whose ending is refused where endings count."""
    return Path("./-") if str(text) == str(STDOUT) else stated_place(text)


def require_no_json(as_json: bool, output: Path | None) -> None:
    """Refuse two results on one standard output.

    Raises:
        UsageError: a file and JSON are both asked for there.
    """
    if as_json and output == STDOUT:
        raise UsageError("-o - and --json both ask for standard output; name a file with -o, or leave one out")


def named(place: Path, default: str) -> Path:
    """The place with a name, the default one where a folder was stated."""
    return place.with_name(default) if place.name == _DEFAULT_NAME else place


def folder_of(place: Path) -> Path:
    """The folder that a place states, with a stroke at its end or without."""
    return place.parent if place.name == _DEFAULT_NAME else place


def beside(place: Path, what: str) -> Path:
    """`<stem>_<what>.yaml` beside a place."""
    return place.parent / f"{place.stem}_{what}.yaml"


def require_places(*outputs: Path, inputs: Iterable[Path | None]) -> None:
    """Refuse outputs that cannot be written or would fall on an input, before any work is done.

    Args:
        outputs: Where files are to be written.
        inputs: Files that this command reads, beside those that were opened already.

    Raises:
        UsageError: names the output.
    """
    from urdfcal.base.files import require_writable

    used = {Path(os.path.realpath(path)) for path in inputs if path is not None}
    taken: set[Path] = set()
    for output in outputs:
        if output == STDOUT:
            continue
        require_writable(output)
        place = Path(os.path.realpath(output))
        if place in used or any(_same(place, path) for path in used):
            raise _is_input(output)
        if place in taken:
            raise UsageError(f"{output}: two outputs of this command would be written to this file; name another with -o")
        taken.add(place)
    _require_unread(outputs)


def deliver(contents: Mapping[str | Path, bytes], beside: Iterable[str | Path] = ()) -> None:
    """Write files whole, and what belongs on stdout there.

    Args:
        contents: By their places.
        beside: Those that are asked for by options of their own: they may replace what was read, in folders that are made for them.

    Raises:
        UsageError: a place cannot be written to, or was read by this command; no file has been touched then.
    """
    from urdfcal.base.files import write_together
    from urdfcal.base.whole_files import make_folders

    kept = set(map(Path, beside))
    _require_unread(place for place in map(Path, contents) if place not in kept)
    make_folders(place.parent for place in kept)
    write_together({place: content for place, content in contents.items() if Path(place) != STDOUT})
    for place, content in contents.items():
        if Path(place) == STDOUT:
            _to_stdout(content)


def told(places: Iterable[str | Path]) -> list[str]:
    """Places as people are told of them."""
    return ["standard output" if Path(place) == STDOUT else str(place) for place in places]


def require_ending(option: str, place: Path, endings: tuple[str, ...], what: str) -> None:
    """Refuse a name that says another kind of file.

    Raises:
        UsageError: names the endings that there are.
    """
    if place != STDOUT and place.suffix.lower() not in endings:
        known = " or ".join(filter(None, (", ".join(endings[:-1]), endings[-1])))
        raise UsageError(f"{option} {place}: {what} ends in {known}, found '{place.suffix}'")


def page_place(
    report: Path | None, default: str, inputs: Iterable[Path | None], made_of: str, overwrite: bool, *beside: Path
) -> Path | None:
    """Where a page is to be written, refused before any work is done; None where none is asked for.

    Args:
        report: As the option states it.
        default: Its name where a folder is stated.
        inputs: Files that this command reads.
        made_of: Their hash, which stands in an earlier page of the same.
        overwrite: Whether another file may give way.
        beside: Other outputs of the command.

    Raises:
        UsageError: it cannot be written there, is called something else than a page, or would replace something else.
    """
    from urdfcal.output.replaced import require_marked
    from urdfcal.output.report.plain import page_mark

    if report is None:
        return None
    place = named(report, default)
    require_ending("--report", place, (".html", ".htm"), "a page")
    require_places(place, *beside, inputs=inputs)
    if not overwrite:
        require_marked(place, (page_mark(made_of),), "page that was made of the same files")
    return place


def _to_stdout(content: bytes) -> None:
    with open(1, "wb", closefd=False) as stream:
        stream.write(content)


def _require_unread(outputs: Iterable[Path]) -> None:
    from urdfcal.base.opened import reads

    for output in outputs:
        if output != STDOUT and reads(output):
            raise _is_input(output)


def _is_input(output: Path) -> UsageError:
    return UsageError(f"{output}: is an input of this command; name another output with -o")


def _same(one: Path, other: Path) -> bool:
    return one.exists() and other.exists() and one.samefile(other)
