"""The text of a robot: a URDF's own bytes, or what xacro makes of a xacro file."""

from __future__ import annotations

import contextlib
import io
import re
import threading
import xml.dom.expatbuilder
import xml.dom.minidom
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from urdfcal.base.errors import RobotError
from urdfcal.base.reading import DESCRIPTION, content_of
from urdfcal.robot.packages import find_package, resolve_uri
from urdfcal.robot.xacro_faults import refuse_macros_alone, refuse_unknown_arguments, xacro_fault

_XACRO_LOCK = threading.Lock()  # xacro keeps its state in module globals
_ENDINGS = re.compile(r"(\.(xacro|urdf|xml))+$", re.IGNORECASE)
_EXPANDED = "Expanded from {} by xacro; edit that file, not this one."


@dataclass(frozen=True)
class Description:
    """A robot description as text.

    Attributes:
        path: The file that was named by the user.
        text: URDF document, byte for byte; for xacro the expanded document.
        expanded: Whether the text is xacro's work and not the file's own bytes.
        package_dirs: Folders given by the user in which packages are looked for.
    """

    path: Path
    text: bytes
    expanded: bool
    package_dirs: tuple[Path, ...] = ()

    @property
    def stem(self) -> str:
        """File name without .xacro, .urdf and .xml at its end: `arm7` for `arm7.urdf.xacro`, `cell.left` for `cell.left.urdf`."""
        return _ENDINGS.sub("", self.path.name) or self.path.name

    @property
    def label(self) -> str:
        """How messages name the text; line numbers of an expanded document are its own."""
        return f"{self.path} (expanded)" if self.expanded else str(self.path)


def read_description(path: str | Path, xacro_args: Mapping[str, str] | None = None, package_dirs: Sequence[str | Path] = ()) -> Description:
    """Read a URDF or xacro file.

    A xacro file is code: its `${...}` and `$(eval ...)` run Python.

    Args:
        path: URDF or xacro; taken as xacro by its name (`.xacro`) or by a `<xacro:...>` tag in it.
        xacro_args: Values of `<xacro:arg>`.
        package_dirs: Folders in which `$(find pkg)` looks first.

    Raises:
        RobotError: the file cannot be read or expanded, declares entities, or knows nothing of a xacro argument.
    """
    path = Path(path)
    folders = tuple(Path(folder) for folder in package_dirs)
    for folder in folders:
        if not folder.is_dir():
            raise RobotError(f"--package-dir {folder}: no such folder")
    text = _read_bytes(path)
    tags = refuse_entities(text, path)
    if path.suffix.lower() != ".xacro" and not any(tag.startswith("xacro:") for tag in tags):
        if xacro_args:
            raise RobotError(f"is a plain URDF and takes no xacro argument ({', '.join(xacro_args)})", path)
        if text[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\x00" in text[:64]:
            raise RobotError("is in UTF-16 or UTF-32, whose bytes cannot be kept; save it as UTF-8", path)
        return Description(path, text, expanded=False, package_dirs=folders)
    return Description(path, _expand(path, xacro_args or {}, folders), expanded=True, package_dirs=folders)


def refuse_entities(text: bytes, path: str | Path) -> frozenset[str]:
    """Refuse entity declarations, which can pull in other files or grow without bound; give back the tags that occur.

    Raises:
        RobotError: an entity is declared, or the text is not well-formed XML up to there.
    """
    parser = expat.ParserCreate()
    tags: set[str] = set()

    def refuse(name: str, *_: object) -> None:
        raise RobotError(
            f"declares the entity '{name}'; entity declarations are refused, write the text out", path, parser.CurrentLineNumber
        )

    parser.EntityDeclHandler = refuse
    parser.UnparsedEntityDeclHandler = refuse
    parser.StartElementHandler = lambda tag, _: tags.add(tag)
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise RobotError(f"not well-formed XML: {expat.ErrorString(error.code)} at column {error.offset + 1}", path, error.lineno) from None
    except (ValueError, LookupError) as error:  # an encoding that expat does not know
        if isinstance(error, RobotError):
            raise
        raise RobotError(f"cannot be decoded: {error}", path) from None
    return frozenset(tags)


def _read_bytes(path: str | Path) -> bytes:
    return content_of(path, DESCRIPTION, RobotError)


def _expand(path: Path, xacro_args: Mapping[str, str], package_dirs: tuple[Path, ...]) -> bytes:
    import xacro

    chatter, sources = io.StringIO(), [_read_bytes(path)]
    with _XACRO_LOCK, _our_look_up(package_dirs, sources), contextlib.redirect_stderr(chatter), contextlib.redirect_stdout(chatter):
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
            raise xacro_fault(error, xacro.filestack, path) from None
    refuse_unknown_arguments(path, xacro_args, b"".join(sources))
    refuse_macros_alone(path, len(document.getElementsByTagName("link")), b"".join(sources))
    return text


def _document(text: bytes) -> xml.dom.minidom.Document:
    """XML known to be well-formed, for xacro; an undeclared prefix is a part of the name."""
    try:
        return xml.dom.minidom.parseString(text)
    except expat.ExpatError:
        return xml.dom.expatbuilder.parseString(text, namespaces=False)


@contextlib.contextmanager
def _our_look_up(package_dirs: tuple[Path, ...], sources: list[bytes]) -> Iterator[None]:
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
            text = Path(filename).read_bytes()
        except OSError as error:
            xacro.filestack.pop()
            missing = OSError(f"the included file {filename} cannot be read: {error.strerror or error}")
            raise xacro.XacroException(exc=missing) from None
        refuse_entities(text, filename)
        sources.append(text)
        return _document(text)

    xacro.abs_filename_spec, xacro.parse = found, safe_parse
    xacro.substitution_args._eval_find = lambda name: str(find_package(name, package_dirs))
    try:
        yield
    finally:
        xacro.abs_filename_spec, xacro.parse, xacro.substitution_args._eval_find = absolute, parse, find
