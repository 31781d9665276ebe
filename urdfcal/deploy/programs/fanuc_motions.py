"""What a TP program's motions say of its positions: which are steps, which offsets and registers go with them, which configurations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from urdfcal.deploy.programs.scan import Program, Token

_OFFSETS = {"OFFSET", "TOOL_OFFSET", "VOFFSET"}


def _motions(program: Program, end: int) -> Iterator[Sequence[Token]]:
    """The lines before the positions, as tokens."""
    begun = 0
    for index in range(end):
        if program.tokens[index].text == ";":
            yield program.tokens[begun : index + 1]
            begun = index + 1


def steps_of(program: Program, end: int) -> dict[str, int]:
    """Positions that are steps (`INC`), and the lines of their motions; the motions stand before the token `end`."""
    found: dict[str, int] = {}
    for tokens in _motions(program, end):
        words = [token.text.upper() for token in tokens]
        if "INC" in words:
            its = (at for at in range(len(tokens) - 2) if words[at : at + 2] == ["P", "["])
            found |= {tokens[at + 2].text: program.line(tokens[at].start) for at in its}
    return found


def said_of_motions(program: Program, end: int, steps: Mapping[str, int]) -> Iterator[str]:
    """What goes on by nominal geometry, and what stands in the controller."""
    for name, line in steps.items():
        yield f"{program.path}:{line}: P[{name}] is a step (INC) from a corrected target, by nominal geometry, and left as it stands"
    for tokens in _motions(program, end):
        words = [token.text.upper() for token in tokens]
        at = next((at for at in range(len(words) - 2) if words[at : at + 2] == ["PR", "["]), None)
        if at is None or "=" in words:
            continue
        where, name = f"{program.path}:{program.line(tokens[at].start)}", f"PR[{words[at + 2]}]"
        if _OFFSETS & set(words):
            yield f"{where}: an offset by {name} goes from a corrected target on by nominal geometry; write it out where that matters"
        else:
            yield f"{where}: goes to {name}, whose numbers stand in the controller, and is not corrected"


def configuration(program: Program, begin: int, end: int) -> str:
    """The letters of `CONFIG : 'N U T, 0, 0, 0'`; the empty string where positions of the joints stand."""
    texts = [token.text for token in program.tokens[begin:end]]
    at = texts.index("CONFIG") if "CONFIG" in texts else None
    return "" if at is None or at + 2 >= len(texts) else texts[at + 2].strip("'\"").partition(",")[0].strip()


def said_of_configurations(program: Program, configured: Sequence[tuple[int, str, str]]) -> Iterator[str]:
    """Placements that are in another configuration than the one that they are sought from."""
    before = ""
    for line, name, config in configured:
        if config and before and config != before:
            yield (
                f"{program.path}:{line}: P[{name}] is in the configuration {config}, and the one before it, from which it is sought, in "
                f"{before}; let a position that is told in joints stand before it"
            )
        before = config
