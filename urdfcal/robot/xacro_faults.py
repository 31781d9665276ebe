"""What xacro says of a file that it cannot expand, and what it passes over in silence, in words that lead on."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from urdfcal.base.errors import RobotError, did_you_mean

_PYTHON_CLASS = re.compile(r"<class '[^']*'>: (.*) \1")  # xacro quotes some errors twice, their class first
_ERRNO = re.compile(r"\[Errno \d+\] ")
_NO_VALUE = re.compile(r"Undefined substitution argument (\S+)")
_SHOWN = 5  # macros that are named


def xacro_fault(error: BaseException, filestack: list[str | None] | None, path: Path) -> RobotError:
    """What came out of xacro as an error of ours.

    Args:
        error: Anything: xacro runs the file's own Python.
        filestack: The files that were being read, innermost last.
        path: The file that was named by the user.
    """
    cause = " ".join(_cause(error).split())
    no_value = _NO_VALUE.fullmatch(cause)
    if no_value:
        cause = f"the argument '{no_value[1]}' has no value and no default; give it one with --xacro-arg {no_value[1]}:=VALUE"
    else:
        cause = _ERRNO.sub("", _PYTHON_CLASS.sub(r"\1", cause))
    return RobotError(f"xacro: {cause}{_macros(error)}{_included(filestack, path)}", path)


def refuse_unknown_arguments(path: Path, xacro_args: Mapping[str, str], sources: bytes) -> None:
    """Refuse an argument that no file mentions, probably misspelt.

    Raises:
        RobotError: names the nearest.
    """
    declared = _names("arg", sources)
    for name in xacro_args:
        if name.encode() not in sources:
            raise RobotError(f"takes no xacro argument '{name}'{did_you_mean(name, declared)}", path)


def refuse_macros_alone(path: Path, links: int, sources: bytes) -> None:
    """Refuse a file of macros that nobody calls.

    Args:
        path: The file that was named by the user.
        links: How many the expanded document has.
        sources: Text of all files that were read.

    Raises:
        RobotError: names the macros.
    """
    macros = list(dict.fromkeys(_names("macro", sources)))
    if links or not macros:
        return
    more = f" and {len(macros) - _SHOWN} more" if len(macros) > _SHOWN else ""
    raise RobotError(
        f"only defines macros ({', '.join(macros[:_SHOWN])}{more}), and has no <link> without a call of one; "
        f"name the file that includes it, or write one that includes it and calls <xacro:{macros[0]} .../>",
        path,
    )


def _names(tag: str, sources: bytes) -> list[str]:
    found: Iterable[bytes] = re.findall(rf"""<xacro:{tag}\s[^>]*?\bname\s*=\s*["']([^"']+)""".encode(), sources)
    return [name.decode(errors="replace") for name in found]


def _chain(error: BaseException) -> list[BaseException]:
    """The error and those that xacro wrapped in it."""
    chain = [error]
    while isinstance(inner := getattr(chain[-1], "exc", None), BaseException):
        chain.append(inner)
    return chain


def memory_ended(error: BaseException) -> bool:
    """Whether an error that came out of xacro began with memory running out."""
    return any(isinstance(link, MemoryError) for link in _chain(error))


def _cause(error: BaseException) -> str:
    """What xacro has to say; it wraps other errors, ours among them, and sometimes says nothing itself."""
    chain = _chain(error)
    ours = [str(link) for link in chain if isinstance(link, RobotError)]
    if not ours and isinstance(chain[-1], RecursionError):
        return "macros, properties or includes call themselves without end"
    return next((text for text in [*ours, *map(str, chain)] if text), type(error).__name__)


def _macros(error: BaseException) -> str:
    """The macros that were being called, outermost first."""
    names = [str(macro.body.getAttribute("name")) for link in _chain(error) for macro in getattr(link, "macros", ()) if macro.body]
    return f" (in a call of {', '.join(dict.fromkeys(reversed(names)))})" if names else ""


def _included(filestack: list[str | None] | None, path: Path) -> str:
    innermost = filestack[-1] if filestack else None
    return f" (in {innermost})" if innermost and Path(innermost) != path else ""
