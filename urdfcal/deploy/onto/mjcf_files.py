"""An MJCF model with the files that it includes, and what its compiler and defaults say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from urdfcal.base.geometry import DEG
from urdfcal.deploy.onto.orientations import Angles
from urdfcal.deploy.onto.text import Document, Element, read_document

_DEPTH = 20  # of files that include each other


@dataclass(frozen=True)
class MjcfFiles:
    """The documents of a model.

    Attributes:
        documents: By path as the model names it; the main one first.
        includes: The document that each <include> stands for.
    """

    documents: dict[Path, Document]
    includes: dict[Element, Document]

    @property
    def main(self) -> Document:
        """The one that was named."""
        return next(iter(self.documents.values()))

    def children(self, element: Element, *tags: str) -> Iterator[Element]:
        """The children of an element, those of included files in the place of each <include>."""
        for child in element.children:
            if child in self.includes:
                yield from self.children(self.includes[child].root, *tags)
            elif not tags or child.tag in tags:
                yield child

    def angles(self) -> Angles:
        """Of all <compiler> elements, later ones over earlier.

        Raises:
            RobotError: an angle's unit or an order of turns that MuJoCo does not have, or global coordinates.
        """
        said: dict[str, str] = {}
        for compiler in self.children(self.main.root, "compiler"):
            said |= compiler.attributes
            seq = said.get("eulerseq", "xyz")
            if said.get("angle", "degree") not in ("degree", "radian"):
                raise compiler.fail(f"<compiler>: angle: found '{said['angle']}', expected degree or radian")
            if len(seq) != 3 or set(seq.lower()) - set("xyz") or not (seq.islower() or seq.isupper()):
                raise compiler.fail(f"<compiler>: eulerseq: found '{seq}', expected three of xyz, or three of XYZ")
            if said.get("coordinate", "local") != "local":
                raise compiler.fail("<compiler>: coordinate: global coordinates are not for current MuJoCo; load and save it there first")
        return Angles(1.0 if said.get("angle") == "radian" else DEG, said.get("eulerseq", "xyz"))

    def defaults(self) -> Defaults:
        """Of all <default> elements right under the root."""
        found: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for top in self.children(self.main.root, "default"):
            self._read_class(top, "main", {}, found, top.attributes.get("class", "main"))
        return Defaults(found)

    def _read_class(
        self,
        element: Element,
        name: str,
        above: dict[str, dict[str, str]],
        found: dict[str, dict[str, dict[str, str]]],
        alias: str = "",
    ) -> None:
        own = {tag: dict(values) for tag, values in (above or found.get(name, {})).items()}
        for child in self.children(element):
            if child.tag != "default":
                own.setdefault(child.tag, {}).update(child.attributes)
        found[name] = own
        if alias and alias != name:
            found[alias] = own
        for child in self.children(element, "default"):
            self._read_class(child, child.attributes.get("class", ""), own, found)


@dataclass(frozen=True)
class Defaults:
    """What elements have that do not say it themselves: by class, tag and attribute."""

    classes: dict[str, dict[str, dict[str, str]]]

    def attributes(self, element: Element, childclass: str) -> dict[str, str]:
        """All that an element has, by its own class, the nearest childclass above, or the main one.

        Raises:
            RobotError: there is no such class.
        """
        name = element.attributes.get("class") or childclass or "main"
        if name not in self.classes:
            raise element.fail(f"<{element.tag} {element.name}>: there is no default class '{name}'")
        return self.classes[name].get(element.tag, {}) | element.attributes


def read_mjcf_files(path: Path, text: bytes | None = None, others: dict[Path, bytes] | None = None) -> MjcfFiles:
    """Read a model and what it includes.

    Args:
        path: The model.
        text: What it holds; None reads the file.
        others: What included files hold, in place of the files.

    Raises:
        RobotError: a file cannot be read, or files include each other.
    """
    main = read_document(path, text)
    files = MjcfFiles({path: main}, {})
    _include(files, main, path.parent, others or {}, 0)
    return files


def _include(files: MjcfFiles, document: Document, folder: Path, others: dict[Path, bytes], depth: int) -> None:
    for element in document.root.walk():
        if element.tag != "include":
            continue
        stated = element.attributes.get("file", "")
        if not stated or depth == _DEPTH:
            raise element.fail("<include>: names no file" if not stated else "<include>: files include each other")
        place = next((own for own in (folder / stated, document.path.parent / stated) if own.is_file()), folder / stated)
        if place in files.documents:
            raise element.fail(f"<include>: {stated} is included twice, which MuJoCo refuses, too")
        files.documents[place] = files.includes[element] = read_document(place, others.get(place))
        _include(files, files.documents[place], folder, others, depth + 1)
