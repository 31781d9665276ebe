"""What is wanted of a xacro's sources beside their patch: a folder of changed copies, or the change in place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from urdfcal.base.errors import RobotError, UsageError
from urdfcal.base.whole_files import require_new_folder
from urdfcal.robot.description import Description

if TYPE_CHECKING:
    from urdfcal.output.sources.patch import SourcePatch


@dataclass(frozen=True)
class SourcesWish:
    """How a xacro's sources are to be changed.

    Attributes:
        split: Whether a number that feeds several joints may become a parameter of its macro.
        folder: Where changed copies go.
        in_place: Whether the files themselves are changed.
        overwrite: Whether what stands in the folder, or as `.orig`, may be replaced.
    """

    split: bool = False
    folder: Path | None = None
    in_place: bool = False
    overwrite: bool = False

    def require_possible(self, description: Description) -> None:
        """Refuse what cannot be, before any work is done.

        Raises:
            RobotError: the description is no xacro.
            UsageError: the folder is in use, or what the sources were before an earlier change would be lost.
        """
        if not description.expanded:
            raise RobotError(
                "is a plain URDF, which --format urdf patches; --format xacro is for sources that xacro expands", description.path
            )
        if self.folder is not None and not self.overwrite:
            require_new_folder(self.folder)
        if self.in_place:
            self._require_free((description.path, *description.included))

    def files(self, patch: SourcePatch) -> dict[str | Path, bytes]:
        """All files that are wanted, by their places; what is changed in place comes after what it was."""
        found: dict[str | Path, bytes] = {}
        if self.folder is not None:
            found |= patch.copies(self.folder)
        if self.in_place:
            self._require_free(patch.after)
            found |= patch.in_place
        return found

    def _require_free(self, files: Iterable[Path]) -> None:
        from urdfcal.output.sources.patch import original

        for file in files:
            if not self.overwrite and original(file).exists():
                raise UsageError(f"{original(file)}: is there already, from an earlier change in place; move it away, or --overwrite")
