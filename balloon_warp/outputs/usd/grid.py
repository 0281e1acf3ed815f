"""Worlds of a batch in one stage, side by side."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd

from balloon_warp.errors import InputError
from balloon_warp.files import whole_file
from balloon_warp.model import ModelPlan
from balloon_warp.outputs.usd.grid_layout import ROOM, grid_shifts, horizontal_axes, world_bounds
from balloon_warp.outputs.usd.grid_world import GridWorld
from balloon_warp.outputs.usd.looks import check_textures, write_textures
from balloon_warp.outputs.usd.metadata import describe_stage
from balloon_warp.outputs.usd.planes import SIZES, define_square, planes_of
from balloon_warp.outputs.usd.prototypes import Prototypes

PIECE = 0.4
"""Half the side of a world's own piece of ground or water, as a fraction of its cell"""
SAVE_BYTES = 64 * 2**20
"""Size of time samples that are kept in memory before they are added to the file [bytes]"""


@dataclass(frozen=True)
class GridGroup:
    """Chosen worlds of the same meshes."""

    plan: ModelPlan
    rows: NDArray[np.integer]
    """Numbers of the worlds in the plan, shape (chosen,)"""
    worlds: NDArray[np.integer]
    """Numbers of the worlds in the whole batch, shape (chosen,)"""
    values: Mapping[str, NDArray] = field(default_factory=dict)
    """Values that differ between worlds: dotted paths, and numbers or the files of meshes, shape (chosen,)"""


class GridWriter:
    """Writes frames of the chosen worlds into a stage, which appears at `path` when the `with` block ends well.

    The file grows as frames come: saving a .usdc again adds to it, and frees the samples' memory. A run that is killed
    leaves nothing at `path`.
    """

    def __init__(self, path: Path, groups: Sequence[GridGroup]):
        self.path, self.groups = path, groups
        check_textures(path, [group.plan for group in groups])
        self._frame_bytes = [2 * 12 * group.plan.particle_count * len(group.rows) for group in groups]
        self._unsaved_bytes = 0
        self._is_whole = True
        """Whether it is complete"""
        self._last: int | None = None
        """Frame that waits for its velocities"""

    def __enter__(self) -> Self:
        with ExitStack() as files:
            self._layer = Sdf.Layer.CreateNew(str(files.enter_context(whole_file(self.path))))
            files.push(self._save)
            self._define_worlds()
            self._file = files.pop_all()
        return self

    def _define_worlds(self) -> None:
        plans = [group.plan for group in self.groups]
        scene = plans[0].scene
        members = sorted(
            (world, number, row, place)
            for number, group in enumerate(self.groups)
            for place, (world, row) in enumerate(zip(group.worlds.tolist(), group.rows.tolist(), strict=True))
        )
        lowest, highest = world_bounds(plans)
        side = ROOM * float(np.max((highest - lowest)[list(horizontal_axes(scene.up_axis))]))
        shifts = grid_shifts(len(members), side, scene.up_axis)
        middle = 0.5 * (lowest + highest)
        stage = Usd.Stage.Open(self._layer)
        describe_stage(stage, scene)
        prototypes = Prototypes(stage, plans, middle, PIECE * side)
        half = SIZES * float(np.max(highest - lowest)) + float(np.abs(shifts).max())
        for plane in planes_of(scene):
            heights = {plans[number].of_world(plane.height, row) for _, number, row, _ in members}
            if len(heights) == 1:
                path = Sdf.Path(f"/World/{plane.name}")
                define_square(stage, path, plane, middle, half, heights.pop(), scene.up_axis)
            else:
                prototypes.define_piece(stage, plane, middle, PIECE * side, scene.up_axis)
        del stage  # it would follow each change of the layer
        root, digits = self._layer.GetPrimAtPath("/World"), len(str(members[-1][0]))
        self._worlds: list[list[GridWorld]] = [[] for _ in self.groups]
        with Sdf.ChangeBlock():
            for shift, (world, number, row, place) in zip(shifts, members, strict=True):
                prim = Sdf.PrimSpec(root, f"World_{world:0{digits}d}", Sdf.SpecifierDef, "Xform")
                values = {path: column[place].item() for path, column in self.groups[number].values.items()}
                self._worlds[number].append(GridWorld(prim, shift, values, prototypes, plans[number], row))

    def write(
        self,
        number: int,
        group: int,
        points: NDArray[np.float32],
        sphere_positions: NDArray[np.float32],
        body_poses: NDArray[np.float32],
        torn: NDArray[np.int8],
        places: Sequence[int] | None = None,
    ) -> None:
        """Write a frame of one group.

        The arrays have shape (chosen, particle_count, 3), (chosen, sphere_count, 3), (chosen, body_count, 7) and
        (chosen, face_count), or (chosen, 0). It follows the one before it, whose velocities are known then.

        Args:
            places: of the worlds that the arrays are of, among the group's; all of them, when missing.
        """
        worlds = self._worlds[group]
        with Sdf.ChangeBlock():
            for row, world in enumerate(worlds if places is None else [worlds[place] for place in places]):
                world.write(number, points[row], sphere_positions[row], body_poses[row], torn[row])
                self._write_velocities_before(world, number)
        self._last = number
        self._end_frame(number, 2 * points.nbytes)

    def last_points(self, group: int, place: int) -> list[list[NDArray[np.float32]]]:
        """Return the points of a chosen world in its last two frames.

        For each frame, of each balloon, shape (particle_count, 3).
        """
        assert self._last is not None
        world = self._worlds[group][place]
        return [world.points(self._layer, number) for number in (self._last - 1, self._last)]

    def last_torn(self, group: int, place: int) -> list[NDArray[np.bool_]]:
        """Return the torn faces of a chosen world in its last frame, as `Frame.torn`."""
        assert self._last is not None
        return self._worlds[group][place].torn(self._layer, self._last)

    def last_obstacle_poses(self, group: int, place: int) -> NDArray[np.float64]:
        """Return the obstacle poses of a chosen world in its last frame, as `Frame.obstacle_poses`."""
        assert self._last is not None
        return self._worlds[group][place].obstacles.poses(self._last)

    def copy_part(self, path: Path, numbers: range, groups: Sequence[int]) -> None:
        """Write frames of some groups as they are in a part that a writer of the same groups wrote.

        Raises:
            InputError: it cannot be read.
        """
        try:
            source = Sdf.Layer.OpenAsAnonymous(str(path))
        except Tf.ErrorException:
            raise InputError(f"{path}: USD cannot open it; expected a part of a batch's stage") from None
        self._copy(source, numbers, groups, self._write_velocities_before)
        self._last = numbers[-1]

    def write_part(self, path: Path, numbers: range, groups: Sequence[int]) -> None:
        """Write frames that are in this stage into one of their own, which appears at `path`.

        Raises:
            InputError: it cannot be written.
        """

        def write_velocities(world: GridWorld, number: int) -> None:
            world.write_velocities(number, self._layer)  # which has the frames beside the part, too

        with self._another(path) as part:
            part._copy(self._layer, numbers, groups, write_velocities)
            part._layer.startTimeCode = numbers.start

    def write_still(self, path: Path) -> None:
        """Write a stage of the same worlds without any frame.

        Raises:
            InputError: it cannot be written.
        """
        with self._another(path):
            pass

    def _another(self, path: Path) -> "GridWriter":
        """Return a writer of the same worlds into another stage, which nobody is to look at."""
        part = GridWriter(path, self.groups)
        part._is_whole = False
        return part

    def _copy(
        self,
        source: Sdf.Layer,
        numbers: range,
        groups: Sequence[int],
        write_velocities: Callable[[GridWorld, int], None],
    ) -> None:
        """Copy frames in the order in which they are written; `write_velocities` gets each world and frame."""
        for number in numbers:
            for group in groups:
                with Sdf.ChangeBlock():
                    for world in self._worlds[group]:
                        world.copy(source, number)
                        write_velocities(world, number)
                self._end_frame(number, self._frame_bytes[group])

    def _write_velocities_before(self, world: GridWorld, number: int) -> None:
        """Write the velocities of the frame before one whose points are there."""
        world.write_velocities(number - 1, self._layer)

    def _end_frame(self, number: int, size: int) -> None:
        """Save what is authored when the size allows: the time depends on the frames alone, so that the bytes do."""
        self._layer.endTimeCode = max(number, self._layer.endTimeCode)
        self._unsaved_bytes += size
        if self._unsaved_bytes > SAVE_BYTES:
            self._layer.Save()
            self._unsaved_bytes = 0

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.__exit__(kind, error, traceback)

    def _save(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            if (last := self._last) is not None:
                with Sdf.ChangeBlock():
                    for world in chain.from_iterable(self._worlds):
                        world.write_velocities(last, self._layer)
            if self._is_whole:
                write_textures(self.path, [group.plan for group in self.groups])
            self._layer.Save()
