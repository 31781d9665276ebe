"""Entity declarations in XML are refused before anything expands them."""

from __future__ import annotations

from pathlib import Path
from xml.parsers import expat

from urdfcal.base.errors import RobotError


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
