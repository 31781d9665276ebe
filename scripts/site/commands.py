"""The reference of the command line, from the commands themselves."""

from __future__ import annotations

import html
from collections.abc import Iterator
from itertools import groupby
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
    rows = [(getattr(each, "rich_help_panel", None) or "", *record) for each in command.params if (record := each.get_help_record(context))]
    for panel, group in groupby(sorted(rows, key=lambda row: row[0]), key=lambda row: row[0]):
        yield f"| {panel or 'argument or option'} | what it does |\n|---|---|"
        yield from (f"| {_code(option)} | {_text(words)} |" for _, option, words in group)
        yield ""


def _code(option: str) -> str:
    return f"<code>{html.escape(option.strip()).replace('|', '&#124;')}</code>"


def _text(words: str) -> str:
    """Words as they are: no letter of them is markup."""
    for letter in "\\`*_<|[":
        words = words.replace(letter, "&lt;" if letter == "<" else f"\\{letter}")
    return words.replace("\b", "").strip()
