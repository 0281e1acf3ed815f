"""A stage that grows frame by frame, and the parts of it that checkpoints keep."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from pxr import Sdf, Tf, UsdGeom

from balloon_warp.errors import InputError
from balloon_warp.files import whole_file
from balloon_warp.model import Model, ModelPlan
from balloon_warp.outputs.usd.looks import check_textures, write_textures
from balloon_warp.outputs.usd.velocities import author_velocities

SAVE_BYTES = 64 * 2**20
"""Size of time samples that are kept in memory before they are added to the file [bytes]; the time of that depends on
the frames alone, and so do the bytes"""


@dataclass(frozen=True)
class MovingGroup:
    """Prims that move together: of a run all, of a batch those of the worlds that are simulated together."""

    prims: Sequence[Sdf.Path]
    """Prims under which the attributes with time samples are"""
    points: Sequence[tuple[Sdf.Path, Sdf.Path]]
    """Attributes of points, and of their velocities"""
    frame_bytes: int
    """Approximate size of a frame [bytes]"""


class GrowingStage(ABC):
    """Stage that appears at its path when the `with` block ends well, and grows until then.

    A binary file is saved now and then: saving it again adds to it, and frees the samples' memory. Text is kept until
    the end, as it would be written anew each time.

    Prims move in groups, whose frames may come one after the other, or all frames of one group before the next. A
    frame's velocities are differences of points, and so come with the frame that follows; the last one's at the end.

    Args:
        path: Stage to write, .usdc, .usda or .usd.
        textured: Models or plans whose textures go beside the stage.

    Raises:
        InputError: a texture cannot be written there.
    """

    def __init__(self, path: Path, textured: Sequence[Model | ModelPlan]):
        self.path, self._textured = path, textured
        check_textures(path, textured)
        self._grows = path.suffix.lower() != ".usda"
        self._unsaved_bytes = 0
        self._is_whole = True
        """Whether it is complete, and not a part"""
        self._last: int | None = None
        """Last frame, whose velocities wait for the end"""

    @abstractmethod
    def _define(self) -> list[MovingGroup]:
        """Define all prims in `layer`, without any frame; return those that move."""

    @abstractmethod
    def _another(self, path: Path) -> "GrowingStage":
        """Make a writer of the same prims into another stage."""

    @abstractmethod
    def _finish(self, last: int) -> None:
        """Write the prims that depend on all frames, such as the studio, once these are there."""

    def __enter__(self) -> Self:
        with ExitStack() as files:
            self.layer = Sdf.Layer.CreateNew(str(files.enter_context(whole_file(self.path))))
            files.push(self._save)
            self._groups = self._define()
            self._file = files.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.__exit__(kind, error, traceback)

    def copy_part(self, path: Path, numbers: range, groups: Sequence[int]) -> None:
        """Write frames of some groups as they are in a part that a writer of the same prims wrote.

        Raises:
            InputError: it cannot be read.
        """
        try:
            source = Sdf.Layer.OpenAsAnonymous(str(path))
        except Tf.ErrorException:
            raise InputError(f"{path}: USD cannot open it; expected the frames of an interrupted run") from None
        self._copy(source, numbers, groups, self._write_velocities_before)
        self._last = numbers[-1]

    def write_part(self, path: Path, numbers: range, groups: Sequence[int]) -> None:
        """Write frames that are in this stage into one of their own, which appears at `path`.

        Raises:
            InputError: it cannot be written.
        """
        with self._part(path) as part:
            part._copy(
                self.layer, numbers, groups, lambda group, number: part._write_velocities(group, number, self.layer)
            )
            part.layer.startTimeCode = numbers.start

    def write_still(self, path: Path) -> None:
        """Write a stage of the same prims without any frame.

        Raises:
            InputError: it cannot be written.
        """
        with self._part(path):
            pass

    def _part(self, path: Path) -> "GrowingStage":
        part = self._another(path)
        part._is_whole = False
        return part

    def _copy(
        self, source: Sdf.Layer, numbers: range, groups: Sequence[int], write_velocities: Callable[[int, int], None]
    ) -> None:
        """Copy frames in the order in which they are written; `write_velocities` gets each group and frame."""
        group_of = {prim: number for number, group in enumerate(self._groups) for prim in group.prims}
        paths: list[list[Sdf.Path]] = [[] for _ in self._groups]
        for path in _animated_paths(source):
            if path.name != UsdGeom.Tokens.velocities:
                paths[next(group_of[prefix] for prefix in path.GetPrefixes() if prefix in group_of)].append(path)
                self._require(source.GetAttributeAtPath(path))
        for number in numbers:
            for group in groups:
                with Sdf.ChangeBlock():
                    for path in paths[group]:
                        if (value := source.QueryTimeSample(path, number)) is not None:
                            self.layer.SetTimeSample(path, number, value)
                    write_velocities(group, number)
                self._count(group, number)

    def _require(self, attribute: Sdf.AttributeSpec) -> None:
        """Make sure that the layer has an attribute: some come with their first frame."""
        path = attribute.path
        if not self.layer.GetAttributeAtPath(path):
            prim = self.layer.GetPrimAtPath(path.GetPrimPath())
            Sdf.AttributeSpec(prim, attribute.name, attribute.typeName, attribute.variability)

    def _write_velocities(self, group: int, number: int, source: Sdf.Layer) -> None:
        """Write the velocities of a frame, from the points in `source`, a layer of the same prims."""
        for points, velocities in self._groups[group].points:
            author_velocities(self.layer, velocities, source, points, number)

    def _write_velocities_before(self, group: int, number: int) -> None:
        """Write the velocities of the frame before one whose points are there."""
        self._write_velocities(group, number - 1, self.layer)

    def _end_frame(self, group: int, number: int) -> None:
        """End a frame of a group whose samples are written, but for its velocities."""
        self._last = number
        self._count(group, number)

    def _count(self, group: int, number: int) -> None:
        """Save the authored samples once they are large enough, which the frames alone decide, and so the bytes."""
        self.layer.endTimeCode = max(number, self.layer.endTimeCode)
        self._unsaved_bytes += self._groups[group].frame_bytes
        if self._grows and self._unsaved_bytes > SAVE_BYTES:
            self.layer.Save()
            self._unsaved_bytes = 0

    def _save(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the end of the stage and save it before the file closes, so that a failure to save is its own."""
        if kind is not None:
            return
        if self._last is not None:
            with Sdf.ChangeBlock():
                for group in range(len(self._groups)):
                    self._write_velocities(group, self._last, self.layer)
            self._finish(self._last)
        if self._is_whole:
            write_textures(self.path, self._textured)
        self.layer.Save()


def _animated_paths(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the attributes with time samples."""
    found: list[Sdf.Path] = []

    def look(path: Sdf.Path | str) -> None:
        path = Sdf.Path(path)
        if path.IsPropertyPath() and layer.GetNumTimeSamplesForPath(path):
            found.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    return found
