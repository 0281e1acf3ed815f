"""Worlds of a batch grouped by model: by meshes, their scales, and the ratios of their springs' constants."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.laws import require_laws
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import ModelPlan, plan_model
from balloon_warp.model.law_tables import with_law_tables
from balloon_warp.model.rows import rows_of
from balloon_warp.model.vary import SHAPING, VaryError, check_vary
from balloon_warp.provenance import mesh_label
from balloon_warp.scene import Scene
from balloon_warp.scene.overrides import override_scene

BatchVary = TypeAliasType("BatchVary", Mapping[str, Any])
"""Dotted paths of the scene, with a number for each world; for the path of a mesh, a mesh or its file for each"""
SHA256 = ".sha256"
"""End of the name of a value: the hash of the file that the value before it names"""
MOST_WORLDS = 100_000_000
"""Largest number of worlds, whose numbers alone take a gigabyte"""


@dataclass(frozen=True)
class Group:
    """Worlds of one model."""

    plan: ModelPlan
    worlds: NDArray[np.int64]
    """Numbers of the worlds in the batch, ascending"""

    def part(self, rows: NDArray[np.integer]) -> Self:
        """Return some of its worlds, by their numbers in its plan, ascending."""
        return replace(self, plan=self.plan.of_worlds(rows), worlds=self.worlds[rows])

    def those_of(self, chosen: NDArray[np.integer]) -> NDArray[np.integer]:
        """Find the chosen worlds of this group, by their numbers in the batch."""
        return self.worlds[self.rows_of(chosen)]

    def rows_of(self, chosen: NDArray[np.integer]) -> NDArray[np.integer]:
        """Find the chosen worlds of this group, by their numbers in its plan."""
        return np.flatnonzero(np.isin(self.worlds, chosen))


def plan_groups(scene: Scene, world_count: int, vary: BatchVary, laws: Sequence[Law] = ()) -> list[Group]:
    """Plan a model for each set of meshes, and of other values that need a model of their own.

    All take the same step, which suits the stiffest world.

    Args:
        laws: User-defined laws beside the built-in ones.

    Raises:
        InputError: as `plan_model`.
    """
    if world_count < 1:
        raise InputError(f"world_count {world_count}: expected at least 1")
    if world_count > MOST_WORLDS:
        raise InputError(f"world_count {world_count}: expected at most {MOST_WORLDS:,}")
    shaping = {path: _column(path, vary[path], world_count) for path in vary if SHAPING.fullmatch(path)}
    require_laws(laws)
    rows = rows_of((*LAWS, *laws))
    scene = with_law_tables(scene, rows)
    scalars = check_vary(scene, rows, world_count, {path: vary[path] for path in vary if path not in shaping})
    members: dict[tuple[Any, ...], Any] = {} if shaping else {(): np.arange(world_count)}
    for world in range(world_count if shaping else 0):
        members.setdefault(tuple(_identity(column[world]) for column in shaping.values()), []).append(world)
    groups = []
    for worlds in members.values():
        own_scene = _own_scene(scene, {path: column[worlds[0]] for path, column in shaping.items()}, worlds[0])
        own_values = {path: values[worlds] for path, values in scalars.items()}
        groups.append(Group(plan_model(own_scene, len(worlds), own_values, laws=laws), np.array(worlds)))
    substeps = max(group.plan.substeps for group in groups)
    return [replace(group, plan=replace(group.plan, substeps=substeps)) for group in groups]


def vary_columns(vary: BatchVary) -> dict[str, NDArray]:
    """Write varied values as columns of a table: numbers, and the meshes' names, shape (world_count,).

    Files are named without their folders: `BatchTask.varied` has their hashes.
    """
    return {
        path: np.array([_label(value) for value in values]) if is_mesh(path) else np.asarray(values, dtype=np.float64)
        for path, values in vary.items()
    }


def is_mesh(path: str) -> bool:
    """Return whether the values at a path are meshes."""
    return path.startswith("balloon.") and path.endswith(".mesh")


def _column(path: str, values: Any, world_count: int) -> list[Any]:
    """Write a value for each world: a mesh or a file, or a number, whole where it may be."""
    what = "mesh" if is_mesh(path) else "number"
    try:
        column = list(values)
    except TypeError:
        raise InputError(f"{path}: expected a {what} for each of {world_count} worlds (got {values})") from None
    if len(column) != world_count:
        raise InputError(f"{path}: expected a {what} for each of {world_count} worlds (got {len(column)})")
    if not is_mesh(path):
        return [value.item() if isinstance(value, np.generic) else value for value in column]
    return [Path(value) if isinstance(value, str) else value for value in column]


def _own_scene(scene: Scene, values: Mapping[str, Any], world: int) -> Scene:
    """Make the scene of a group, whose first world is given.

    Raises:
        VaryError: names that world, where a number is wrong.
    """
    for path, value in values.items():
        try:
            scene = override_scene(scene, [(path, value)])
        except InputError as mistake:
            raise VaryError(mistake if is_mesh(path) else f"{mistake}, in world {world}", path) from None
    return scene


def _identity(value: Any) -> Any:
    """Return a value that identifies a mesh without a file, and other values themselves."""
    return value if isinstance(value, Path | float | int | str) else id(value)


def _label(mesh: str | Path | PolygonMesh) -> str:
    return Path(mesh_label(mesh)).name
