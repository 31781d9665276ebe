"""How help looks: commands and options in groups, what people need first before the rest, an example at the end; plain, 80 columns."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup

from urdfcal.cli.streams import drop_stdout
from urdfcal.cli.usage import no_such_command

EXPERT = "Expert"  # the group of what few need; groups stand in the order in which their first member does, and this one last
_WIDTH = 80


class OurCommand(TyperCommand):
    """A command whose options stand in groups."""

    def invoke(self, ctx: Any) -> Any:
        """Run it; whoever reads its output may have seen enough at any time, which is no error."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:  # click would end with 1
            drop_stdout()
            return 0

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Names of arguments as they are called elsewhere: what must be given in no brackets at all."""
        pieces = [self.options_metavar] if self.options_metavar else []
        for parameter in self.get_params(ctx):
            if parameter.param_type_name == "argument":
                name = f"{parameter.metavar or str(parameter.name).upper()}{'' if parameter.nargs == 1 else '...'}"
                pieces.append(name if parameter.required else f"[{name}]")
        return pieces

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then the options of each group."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                usual = "Arguments" if parameter.param_type_name == "argument" else "Options"
                groups.setdefault(getattr(parameter, "rich_help_panel", None) or usual, []).append(record)
        _write(formatter, groups)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the example as it stands."""
        if self.epilog:
            with formatter.section("Example"):
                formatter.write("".join(f"  {line}\n" for line in self.epilog.splitlines()))


class OurGroup(TyperGroup):
    """The commands in groups, one line each."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that the first word names.

        Raises:
            UsageError: there is none.
        """
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None and not ctx.resilient_parsing:
            raise no_such_command(args[0], self.list_commands(ctx))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands of each group."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command: Any = self.get_command(ctx, name)
            panel = command.rich_help_panel or "Commands"
            groups.setdefault(panel, []).append((name, command.get_short_help_str(_WIDTH)))
        _write(formatter, groups)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write what comes last as it stands."""
        if self.epilog:
            formatter.write_paragraph()
            formatter.write(f"{self.epilog}\n")


def _write(formatter: Any, groups: dict[str, list[tuple[str, str]]]) -> None:
    """Write groups, the expert's last."""
    for name in sorted(groups, key=lambda name: name == EXPERT):
        with formatter.section(name):
            formatter.write_dl(groups[name], col_max=24)
