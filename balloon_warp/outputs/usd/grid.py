"""Worlds of a batch in one stage, side by side."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from balloon_warp.model import ModelPlan
from balloon_warp.outputs.usd.grid_layout import ROOM, grid_shifts, horizontal_axes, world_bounds
from balloon_warp.outputs.usd.grid_world import GridWorld
from balloon_warp.outputs.usd.growing import GrowingStage, MovingGroup
from balloon_warp.outputs.usd.metadata import describe_stage
from balloon_warp.outputs.usd.planes import SIZES, define_square, planes_of
from balloon_warp.outputs.usd.prototypes import Prototypes
from balloon_warp.outputs.usd.velocities import author_velocities

PIECE = 0.4
"""Half the side of a world's own piece of ground or water, as a fraction of its cell"""


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


class GridWriter(GrowingStage):
    """Writes frames of the chosen worlds into a stage, which appears at `path` when the `with` block ends well.

    Raises:
        InputError: a texture cannot be written beside it.
    """

    def __init__(self, path: Path, groups: Sequence[GridGroup]):
        super().__init__(path, [group.plan for group in groups])
        self.groups = groups

    def _define(self) -> list[MovingGroup]:
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
        stage = Usd.Stage.Open(self.layer)
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
        root, digits = self.layer.GetPrimAtPath("/World"), len(str(members[-1][0]))
        self._worlds: list[list[GridWorld]] = [[] for _ in self.groups]
        with Sdf.ChangeBlock():
            for shift, (world, number, row, place) in zip(shifts, members, strict=True):
                prim = Sdf.PrimSpec(root, f"World_{world:0{digits}d}", Sdf.SpecifierDef, "Xform")
                values = {path: column[place].item() for path, column in self.groups[number].values.items()}
                self._worlds[number].append(GridWorld(prim, shift, values, prototypes, plans[number], row))
        return [
            MovingGroup(
                [world.path for world in worlds],
                [pair for world in worlds for pair in world.moving],
                2 * 12 * group.plan.particle_count * len(worlds),
            )
            for group, worlds in zip(self.groups, self._worlds, strict=True)
        ]

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
                for own, velocities in world.moving:
                    author_velocities(self.layer, velocities, self.layer, own, number - 1)
        self._end_frame(group, number)

    def last_points(self, group: int, place: int) -> list[list[NDArray[np.float32]]]:
        """Return the points of a chosen world in its last two frames.

        For each frame, of each balloon, shape (particle_count, 3).
        """
        assert self._last is not None
        world = self._worlds[group][place]
        return [world.points(self.layer, number) for number in (self._last - 1, self._last)]

    def last_torn(self, group: int, place: int) -> list[NDArray[np.bool_]]:
        """Return the torn faces of a chosen world in its last frame, as `Frame.torn`."""
        assert self._last is not None
        return self._worlds[group][place].torn(self.layer, self._last)

    def last_obstacle_poses(self, group: int, place: int) -> NDArray[np.float64]:
        """Return the obstacle poses of a chosen world in its last frame, as `Frame.obstacle_poses`."""
        assert self._last is not None
        return self._worlds[group][place].obstacles.poses(self._last)

    def _another(self, path: Path) -> "GridWriter":
        return GridWriter(path, self.groups)

    def _finish(self, last: int) -> None:
        """Add nothing: worlds side by side have no studio."""
