"""What a Collada file asks for, before anything builds it: the pictures that it names, and how far its nodes unfold.

Assimp and the browser follow nodes that contain one another without a limit: a few lines could end the process or fill all memory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from xml.parsers import expat

from urdfcal.base.errors import RobotError

DEEPEST = 200  # elements within one another, and nodes through others
MOST_ELEMENTS = 500_000
MOST_NODES = 10_000  # when every reference to a node is followed

_PRIMITIVES = ("triangles", "polylist", "polygons", "trifans", "tristrips", "lines", "linestrips")
_INSTANCES = ("instance_node", "instance_geometry", "instance_controller")


@dataclass
class Collada:
    """What was found in a file.

    Attributes:
        pictures: Names of pictures, as the file has them.
        well_formed: Whether the browser's reader takes it, too: every prefix is declared.
        corners: Of all faces, when every reference to a node and a geometry is followed; three or fewer a triangle.
    """

    pictures: list[str] = field(default_factory=list)
    well_formed: bool = True
    corners: int = 0


def scan_collada(content: bytes) -> Collada:
    """Look through a Collada file without building it.

    Raises:
        RobotError: it is none, declares a document type, is nested too deep, has too many elements, or its nodes contain themselves
            or unfold to too many.
    """
    scan = _Scan()
    try:
        scan.parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # the last two: an encoding that is none
        raise RobotError(f"is no whole XML ({error})") from None
    scan.require_few_nodes()
    names = ("".join(words).strip() for words in scan.names)
    found = Collada([name for name in names if name], corners=scan.corners())
    try:
        expat.ParserCreate(namespace_separator=" ").Parse(content, True)
    except expat.ExpatError:
        found.well_formed = False
    return found


class _Scan:
    """Reads along: counts elements, keeps the names of pictures, and which node holds which."""

    def __init__(self) -> None:
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler, self.parser.EndElementHandler = self._start, self._end
        self.parser.StartDoctypeDeclHandler = self._refuse_doctype
        self.parser.buffer_text, self.parser.buffer_size = True, 1 << 20
        self.names: list[list[str]] = []
        self._path: list[str] = []
        self._nodes: list[int] = [0]  # those that are open, by their numbers; 0 holds all others
        self._held: list[Counter[int | str]] = [Counter()]  # what each node holds: nodes, and labels of those that it refers to
        self._labelled: dict[str, set[int]] = {}  # nodes by their id and by their name, either of which may be referred to
        self._elements = 0
        self._geometry, self._stride, self._indices = "", 1, 0  # those that are open, and the numbers of the primitive's faces
        self._corners: Counter[str] = Counter()

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        tag = tag.rpartition(":")[2]
        if not self._path and tag != "COLLADA":
            raise RobotError(f"is no Collada, it opens with <{tag}>")
        self._path.append(tag)
        self._elements += 1
        if self._elements > MOST_ELEMENTS or len(self._path) > DEEPEST:
            raise RobotError(f"has more than {MOST_ELEMENTS} elements, or more than {DEEPEST} within one another")
        inside = self._held[self._nodes[-1]]
        if tag in ("node", "visual_scene"):
            number = len(self._held)
            inside[number] += 1
            self._held.append(Counter())
            self._nodes.append(number)
            for label in (attributes.get("id"), attributes.get("name")):
                if label:
                    self._labelled.setdefault(label, set()).add(number)
        elif tag in _INSTANCES:
            inside[attributes.get("url", "").removeprefix("#")] += 1
        elif tag == "init_from" and "image" in self._path:
            self.names.append([])
            self.parser.CharacterDataHandler = self.names[-1].append
        elif tag == "geometry":
            self._geometry = attributes.get("id", "")
        elif tag in _PRIMITIVES:
            self._stride, self._indices = 1, 0
        elif tag == "input" and attributes.get("offset", "").isdecimal():
            self._stride = max(self._stride, 1 + int(attributes["offset"]))
        elif tag == "p":
            self.parser.CharacterDataHandler = self._count_indices

    def _end(self, tag: str) -> None:
        self.parser.CharacterDataHandler = None
        closed = self._path.pop()
        if closed in ("node", "visual_scene"):
            self._nodes.pop()
        elif closed in _PRIMITIVES:
            self._corners[self._geometry] += self._indices // self._stride

    def _count_indices(self, text: str) -> None:
        self._indices += len(text.split())

    def corners(self) -> int:
        """Of all that the scenes unfold to."""
        return self._unfolded(0, {}, (), self._corners.__getitem__)

    def _refuse_doctype(self, *_: object) -> None:
        raise RobotError("declares a document type, which no Collada file needs")

    def require_few_nodes(self) -> None:
        """Follow every reference, each node's own only once."""
        sizes: dict[int, int] = {}
        for root in range(len(self._held)):
            self._unfolded(root, sizes, (), lambda _: 1, own=1)
        if max(sizes.values()) > MOST_NODES:
            raise RobotError(f"has nodes that unfold to more than {MOST_NODES}")

    def _unfolded(self, node: int, sizes: dict[int, int], within: tuple[int, ...], worth: Callable[[str], int], own: int = 0) -> int:
        """What one node is worth with all that it holds and refers to: each node `own`, and what is no node by its label."""
        if node in within or len(within) > DEEPEST:
            raise RobotError(f"has nodes within themselves, or more than {DEEPEST} within one another")
        if node not in sizes:
            total = own
            for held, count in self._held[node].items():
                meant = (held,) if isinstance(held, int) else self._labelled.get(held, ())
                inside = sum(self._unfolded(each, sizes, (*within, node), worth, own) for each in meant)
                total += count * (inside + (worth(held) if isinstance(held, str) else 0))
            sizes[node] = total
        return sizes[node]
