"""The reference of the command line, from the commands themselves."""

from __future__ import annotations

import html
import inspect
from collections.abc import Iterator
from typing import Any

PAGE = "reference/commands.md"
_HEAD = """# Command line

What `urdfcal COMMAND --help` prints, made from the commands themselves. Exit codes and files: [what comes out](results.md#exit-codes).
"""


def on_files(files: Any, config: Any) -> Any:
    """Add the page."""
    from mkdocs.structure.files import File

    files.append(File.generated(config, PAGE, content=page()))
    return files


def page() -> str:
    """All commands, a table of them first."""
    import typer

    from urdfcal.cli.main import app

    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    rows = [f"| [`urdfcal {name}`](#urdfcal-{name}) | {_text(_first(command))} |" for name, command in commands.items()]
    return "\n".join([_HEAD, "| command | does |", "|---|---|", *rows, "", *(line for each in commands.items() for line in _one(*each))])


def _first(command: Any) -> str:
    return (command.help or "").split("\n\n")[0].replace("\n", " ")


def _one(short: str, command: Any) -> Iterator[str]:
    name = f"urdfcal {short}"
    context = command.context_class(command, info_name=name)
    yield f"## {name}\n"
    yield f"```text\n{' '.join([name, *command.collect_usage_pieces(context)])}\n```\n"
    yield _text(command.help or "") + "\n"
    panels: dict[str, list[tuple[str, str]]] = {}
    for each in command.params:
        if record := each.get_help_record(context):
            panels.setdefault(getattr(each, "rich_help_panel", None) or "argument or option", []).append(record)
    for panel, rows in panels.items():
        yield f"| {panel} | what it does |\n|---|---|"
        yield from (f"| {_code(option)} | {_text(words)} |" for option, words in rows)
        yield ""
    if command.epilog:
        yield f"```text\n{inspect.cleandoc(command.epilog)}\n```\n"


def _code(option: str) -> str:
    return f"<code>{html.escape(option.strip()).replace('|', '&#124;')}</code>"


def _text(words: str) -> str:
    """Words as they are: no letter of them is markup."""
    for letter in "\\`*_<|[":
        words = words.replace(letter, "&lt;" if letter == "<" else f"\\{letter}")
    return words.replace("\b", "").strip()
