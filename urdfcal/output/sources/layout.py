"""Where sources belong: in whose package, below which folder, and whether they are the user's own or installed."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

_INSTALLED = ("/opt", "/usr", "/nix")  # unless it is a checkout
_PARTS = {"site-packages", "dist-packages"}


@dataclass(frozen=True)
class Layout:
    """The files of a description.

    Attributes:
        description: The file that was named by the user.
        read: All files that it is expanded from, real paths.
        changed: Those that changed.
    """

    description: Path
    read: tuple[Path, ...]
    changed: tuple[Path, ...]

    @cached_property
    def root(self) -> Path:
        """What a patch's ways begin at: its repository or package where that has all that changed, else the folder that does."""
        own = [file for file in self.changed if not is_installed(file)]
        for sign in (".git", "package.xml"):
            above = next((folder for folder in self.description.resolve().parents if (folder / sign).exists()), None)
            if above is not None and all(file.is_relative_to(above) for file in own):
                return above
        return _common([*own, self.description.resolve()])

    @property
    def installed(self) -> list[Path]:
        """Those that changed and are not the user's own."""
        return [file for file in self.changed if is_installed(file)]

    def way(self, file: Path) -> Path:
        """A file's way in a patch; an installed one's begins with its package."""
        return _way_in_package(file) if is_installed(file) else file.relative_to(self.root)

    @cached_property
    def manifests(self) -> list[Path]:
        """The package.xml of each package."""
        found = dict.fromkeys(package / "package.xml" for file in self.read if (package := package_of(file)) is not None)
        return list(found)

    def way_in_folder(self, file: Path) -> Path:
        """A file's way in a folder that holds them all; ways between files of one tree stay as they are."""
        return _way_in_package(file) if is_installed(file) else file.relative_to(self._top)

    @cached_property
    def _top(self) -> Path:
        own = [package_of(file) or file.parent for file in (*self.read, self.description.resolve()) if not is_installed(file)]
        folder = Path(os.path.commonpath(own))
        return folder.parent if (folder / "package.xml").is_file() else folder


def is_installed(file: Path) -> bool:
    """Whether a file came with an installation, and the next would replace it."""
    prefixes = [sys.prefix, *(entry for entry in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if entry)]
    if _PARTS & set(file.parts) or any(file.is_relative_to(Path(prefix).resolve()) for prefix in prefixes):
        return True
    return any(file.is_relative_to(prefix) for prefix in _INSTALLED) and not any((above / ".git").exists() for above in file.parents)


def package_of(file: Path) -> Path | None:
    """The nearest folder above that is a package."""
    return next((folder for folder in file.parents if (folder / "package.xml").is_file()), None)


def _way_in_package(file: Path) -> Path:
    package = package_of(file)
    return Path(file.parent.name, file.name) if package is None else Path(package.name) / file.relative_to(package)


def _common(files: Iterable[Path]) -> Path:
    return Path(os.path.commonpath([file.parent for file in files]))
