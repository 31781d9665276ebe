"""xacro's work on a file: our package look-up and our refusals, its own expansion. The file's Python runs in this process."""

from __future__ import annotations

import contextlib
import io
import re
import xml.dom.expatbuilder
import xml.dom.minidom
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path
from xml.parsers import expat

from urdfcal.base.errors import InputError, RobotError
from urdfcal.base.reading import DESCRIPTION, content_of
from urdfcal.robot.entities import refuse_entities
from urdfcal.robot.packages import OWN, find_package, own_package, resolve_uri
from urdfcal.robot.xacro_faults import memory_ended, refuse_macros_alone, refuse_unknown_arguments, xacro_fault
from urdfcal.robot.xacro_probe import content_over, probing

_EXPANDED = "Expanded from {} by xacro; edit that file, not this one."


def expand(
    path: Path, xacro_args: Mapping[str, str], package_dirs: tuple[Path, ...], overlay: Mapping[str, bytes] | None = None
) -> tuple[bytes, list[Path]]:
    """The expanded document, and the files that were read for it.

    Args:
        path: The xacro file.
        xacro_args: Values of `<xacro:arg>`.
        package_dirs: Folders in which `$(find pkg)` looks first.
        overlay: Content to be read in place of files, by their real paths; given, it is even if empty, YAML is among the files, and what
            stands in `xacro_probe` is known to the files' Python.

    Raises:
        RobotError: what xacro, or a refusal of ours, says of it.
        MemoryError: it takes more than this process may have.
    """
    import xacro

    chatter, sources, loaded = io.StringIO(), {path: content_of(path, DESCRIPTION, RobotError)}, dict[Path, None]()
    probed = nullcontext() if overlay is None else probing(overlay, loaded)
    with (
        _our_look_up(package_dirs, sources, overlay or {}),
        probed,
        contextlib.redirect_stderr(chatter),
        contextlib.redirect_stdout(chatter),
    ):
        try:
            xacro.init_stacks(str(path))
            document = xacro.parse(None, str(path))
            xacro.process_doc(document, mappings=dict(xacro_args))
            comment = document.createComment(re.sub("-+", "-", f" {_EXPANDED.format(path.name)} "))
            document.insertBefore(comment, document.firstChild)
            text: bytes = document.toprettyxml(indent="  ", encoding="utf-8")
        except RobotError:
            raise
        except Exception as error:  # xacro runs the file's own Python: anything can come out of it
            if memory_ended(error):
                raise MemoryError from None
            raise xacro_fault(error, xacro.filestack, path) from None
    read = b"".join(sources.values())
    refuse_unknown_arguments(path, xacro_args, read)
    refuse_macros_alone(path, len(document.getElementsByTagName("link")), read)
    return text, [*sources, *loaded]


def _comes_along(filename: str) -> str:
    """The way out for a missing file that is one of ours, as in a copy of one of our robots."""
    name = Path(filename).name
    there = (own_package() / "robots" / name).is_file()
    return f"; it comes with {OWN}: include $(find {OWN})/robots/{name}" if there else ""


def expanded_calls(calls: str) -> str:
    """What calls of our own macros expand to: elements as they stand right under <robot>, two blanks deeper each level, in lines."""
    import xacro

    include = f'<xacro:include filename="$(find {OWN})/robots/slm.urdf.xacro"/>'
    with _our_look_up((), {}, {}), contextlib.redirect_stderr(io.StringIO()):
        xacro.init_stacks(None)
        document = xacro.parse(f'<robot name="rig" xmlns:xacro="http://www.ros.org/wiki/xacro">{include}{calls}</robot>')
        xacro.process_doc(document)
        text: str = document.documentElement.toprettyxml(indent="  ")
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines()[1:-1] if line.strip())


def _document(text: bytes) -> xml.dom.minidom.Document:
    """XML known to be well-formed, for xacro; an undeclared prefix is a part of the name."""
    try:
        return xml.dom.minidom.parseString(text)
    except expat.ExpatError:
        return xml.dom.expatbuilder.parseString(text, namespaces=False)


@contextlib.contextmanager
def _our_look_up(package_dirs: tuple[Path, ...], sources: dict[Path, bytes], overlay: Mapping[str, bytes]) -> Iterator[None]:
    """Give xacro our package look-up (its own needs a ROS installation) and our refusal of entities; collect what it reads."""
    import xacro
    import xacro.substitution_args

    absolute, parse, find = xacro.abs_filename_spec, xacro.parse, xacro.substitution_args._eval_find

    def found(spec: str) -> object:
        try:
            return absolute(resolve_uri(spec, package_dirs))
        except RobotError as error:
            raise xacro.XacroException(exc=error) from None

    def safe_parse(inp: object, filename: str | None = None) -> object:
        if inp is not None or filename is None:
            return parse(inp, filename)
        try:
            text = content_over(overlay, filename) or content_of(filename, DESCRIPTION)
        except InputError as error:
            xacro.filestack.pop()
            found = f"the included file {str(error).replace(': ', ' ', 1)}{_comes_along(filename)}"
            missing = OSError(found)  # which xacro passes over where it is optional
            raise xacro.XacroException(exc=missing) from None
        refuse_entities(text, filename)
        sources[Path(filename)] = text
        return _document(text)

    xacro.abs_filename_spec, xacro.parse = found, safe_parse
    xacro.substitution_args._eval_find = lambda name: str(find_package(name, package_dirs))
    try:
        yield
    finally:
        xacro.abs_filename_spec, xacro.parse, xacro.substitution_args._eval_find = absolute, parse, find
