"""Mistakes of a command line that is not understood, in a line of ours: what was found, what comes near, and where to read on."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from urdfcal.base.errors import UsageError, nearest_of
from urdfcal.base.files import YAML_ENDINGS
from urdfcal.output.endings import ELSEWHERE

_CHOICE = re.compile(r"'(?P<found>[^']*)' is not one of (?P<choices>'.*')")
_FILES = (".urdf", ".xacro", ".csv", ".xlsx", *YAML_ENDINGS)


def usage_words(error: Any) -> str:
    """What typer found wrong, in a line; `error` is one of its usage errors."""
    context = getattr(error, "ctx", None)
    message = " ".join(error.format_message().split()).replace("Value error, ", "").removesuffix(".")
    name = getattr(error, "option_name", "")
    if name and "no such option" in message.lower() and context is not None:
        message = f"{context.info_name} has no option '{name}'{nearest_of(name, _options(context))}"
    elif (choice := _CHOICE.search(message)) is not None and "'--format'" in message and choice["found"].lower() in ELSEWHERE:
        message = f"--format {choice['found']}: {ELSEWHERE[choice['found'].lower()]}"
    elif choice is not None:
        message += nearest_of(choice["found"], re.findall(r"'([^']*)'", choice["choices"]))
    return f"{message}{'' if message.endswith('?') else ';'} {_read_on(context)}"


def no_such_command(name: str, commands: Iterable[str]) -> UsageError:
    """What to say of a first word that is no command; a file may stand there, whose command was forgotten."""
    if name.lower().endswith(_FILES) or Path(name).is_file():
        return UsageError(f"'{name}' is no command, but looks like a file; the command comes first, as in: urdfcal fit ROBOT MEASUREMENTS")
    hint = nearest_of(name, commands)
    return UsageError(f"there is no command '{name}'{hint or ';'} urdfcal --help lists all")


def _options(context: Any) -> list[str]:
    """Every option that a command has."""
    return [word for option in context.command.params for word in (*option.opts, *option.secondary_opts) if word.startswith("-")]


def _read_on(context: Any) -> str:
    """Whose help has the rest; where typer does not say at which command it stopped, it is the one that was named."""
    named = [word for word in sys.argv[1:2] if not word.startswith("-")]
    path = context.command_path if context is not None else " ".join(["urdfcal", *named])
    return f"{path} --help says what it takes"
