"""YAML as a tree of plain values whose entries know their lines: ruamel.yaml, without what a file of ours has no use for.

Numbers, truth values and text are told apart as by YAML 1.2: `1e-3` is a number, `yes` and `1:30` are text, and so is `010`, which one
reader takes for eight and another for ten. Dates, `<<` and `=` are text, too. The name of an entry is text, whatever it looks like.
What OpenCV writes is read, too, though its first line is no YAML: `%YAML:1.0`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.composer import Composer
from ruamel.yaml.constructor import RoundTripConstructor, SafeConstructor
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.events import AliasEvent, CollectionStartEvent
from ruamel.yaml.nodes import MappingNode, ScalarNode
from ruamel.yaml.reader import ReaderError
from ruamel.yaml.resolver import VersionedResolver
from ruamel.yaml.scanner import Scanner

_KIND = "tag:yaml.org,2002:"
_SCALARS = ("null", "bool", "int", "float", "str")
_SAYS_NOTHING = {_KIND + "opencv-matrix"}  # tags of entries that say all by themselves
_PLAIN = {_KIND + kind for kind in (*_SCALARS, "seq", "map")}
_DEEPEST = 30  # levels of nesting; no file of ours has more than six
_MOST_DIGITS = 100  # of a whole number; more fit into neither a double nor a message


class NotPlain(Exception):
    """YAML that is refused.

    Attributes:
        line: Where, counted from 1; None where it is not known.
    """

    def __init__(self, message: str, line: int | None) -> None:
        super().__init__(message)
        self.line = line


def read_tree(text: str) -> tuple[Any, int | None]:
    """A document as ruamel.yaml's CommentedMap, CommentedSeq and plain values, and the line that it begins on; None where it is empty.

    Raises:
        NotPlain: the text is not YAML, or holds an alias, a tag, an entry that stands twice, or more levels or digits than make sense.
    """
    reader = YAML(typ="safe", pure=True)  # without comments, which the C code or another reader would have to keep
    reader.Scanner, reader.Composer, reader.Constructor, reader.Resolver = _Scanner, _Composer, _Constructor, _Resolver
    try:
        return reader.load(re.sub(r"\A%YAML:1\.0", "#", text)), reader.composer.first_line
    except MarkedYAMLError as trouble:
        raise NotPlain(_unreadable(trouble.problem or trouble), _line(trouble.problem_mark)) from None
    except ReaderError as trouble:
        raise NotPlain(_unreadable(trouble.reason), text.count("\n", 0, trouble.position) + 1) from None
    except ValueError as trouble:  # such as 0x_, which looks like a number
        raise NotPlain(_unreadable(trouble), None) from None


def line_of(tree: Any, steps: Sequence[Any]) -> int | None:
    """The line of the value of an entry such as ("joints", "joint3"), or of the last step that is there; None where none is."""
    line = None
    for step in steps:
        if isinstance(tree, CommentedMap) and str(step) in tree:
            place, tree = tree.lc, tree[str(step)]
            line = (place.key if tree is None else place.value)(str(step))[0] + 1  # an empty value is said to be on the next line
        elif isinstance(tree, CommentedSeq) and step in range(len(tree)):
            line, tree = tree.lc.item(step)[0] + 1, tree[step]
        else:
            break
    return line


def plain(tree: Any) -> Any:
    """The same as dictionaries and lists."""
    if isinstance(tree, dict):
        return {name: plain(below) for name, below in tree.items()}
    return [plain(below) for below in tree] if isinstance(tree, list) else tree


class _Scanner(Scanner):
    """Takes a tab where it cannot be meant to indent for a space, as YAML has it."""

    def scan_to_next_token(self) -> None:
        super().scan_to_next_token()
        while not self.allow_simple_key and self.reader.peek() == "\t":
            self.reader.forward()
            super().scan_to_next_token()


class _Composer(Composer):
    """Looks at every part before anything is built from it, so that a small file cannot become a large or an endless one."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self.first_line: int | None = None
        self.levels = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.parser.peek_event()
        line = _line(event.start_mark)
        if isinstance(event, AliasEvent):
            raise NotPlain(f"the alias '*{event.anchor}' is refused; write the entry out", line)
        if event.tag in _SAYS_NOTHING:
            event.ctag = None
        if event.tag is not None:
            raise NotPlain(f"the tag '{event.tag.replace(_KIND, '!!')}' is refused; write the value without it", line)
        event.anchor = None  # nothing refers to it
        self.first_line = self.first_line or line
        self.levels += isinstance(event, CollectionStartEvent)
        if self.levels > _DEEPEST:
            raise NotPlain(f"nested more than {_DEEPEST} levels deep", line)
        node = super().compose_node(parent, index)
        self.levels -= isinstance(event, CollectionStartEvent)
        if isinstance(parent, MappingNode) and index is None:
            _make_name(node, line)
        if isinstance(node, ScalarNode):
            _check(node, line)
        return node


def _check(node: Any, line: int | None) -> None:
    if node.tag == _KIND + "int" and len(node.value) > _MOST_DIGITS:
        raise NotPlain(f"a number of {len(node.value)} digits", line)
    if re.search("[\ud800-\udfff]", node.value):
        raise NotPlain("half of a character (\\ud800 to \\udfff); write the character itself", line)


def _make_name(node: Any, line: int | None) -> None:
    if not isinstance(node, ScalarNode):
        raise NotPlain("the name of an entry is a list or has entries of its own; expected text", line)
    node.tag = _KIND + "str"


class _Resolver(VersionedResolver):
    """What a value without quotes is."""

    processing_version = (1, 2)  # whatever a %YAML line says

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        tag = super().resolve(kind, value, implicit)
        octal = str(tag) == _KIND + "int" and re.match(r"[-+]?0[\d_]", value)
        return self.DEFAULT_SCALAR_TAG if octal or str(tag) not in _PLAIN else tag


class _Constructor(RoundTripConstructor):
    """Keeps the lines of entries, as ruamel.yaml's own does, and makes of values what Python has."""

    construct_scalar = SafeConstructor.construct_scalar

    def check_mapping_key(self, node: Any, key_node: Any, mapping: Any, key: Any, value: Any) -> bool:
        if key in mapping:
            raise NotPlain(f"the entry '{key}' stands twice", _line(key_node.start_mark))
        return True


for _kind in _SCALARS:
    _Constructor.add_constructor(_KIND + _kind, getattr(SafeConstructor, f"construct_yaml_{_kind}"))


def _line(mark: Any) -> int | None:
    return None if mark is None else int(mark.line) + 1


def _unreadable(trouble: object) -> str:
    return f"not readable as YAML: {' '.join(str(trouble).split())}"
