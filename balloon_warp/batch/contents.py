"""Contents of the file of a world: attributes, arrays that stay, arrays that move."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.batch.formats import Arrays, Attribute, Field, WorldFile
from balloon_warp.batch.recorder import SHA256, BatchVary, Group, fields_of, is_mesh, units_of
from balloon_warp.errors import InputError
from balloon_warp.frame import things_of
from balloon_warp.kernels.laws import Law
from balloon_warp.mesh.topology import edges_of, triangulate
from balloon_warp.model import ModelPlan
from balloon_warp.run.provenance import describe_scene, without_folders
from balloon_warp.scene import Scene
from balloon_warp.scene.load import override_scene

MOST_ATTRIBUTES = 500
"""Number of values of a scene above which only those are attributes that vary; the manifest has all"""


class Contents:
    """Contents of the files of a batch.

    Args:
        scene: common to all worlds.
        vary: values that differ between them.
        laws: your own.
        every: step between frames that are written.
        columns: the same as `BatchTask.varied`.
        hashes: of the scene's files, by place.
    """

    def __init__(
        self,
        scene: Scene,
        vary: BatchVary,
        laws: Sequence[Law],
        every: int,
        columns: Mapping[str, list[Any]],
        hashes: Mapping[str, str],
    ):
        self.scene, self._every, self._hashes, self.columns = scene, every, hashes, columns
        self._targets = {path: _targets(scene, path, values) for path, values in vary.items()}
        self._units = units_of(scene, vary, laws)
        for path in filter(is_mesh, vary):
            self._targets[f"{path}{SHA256}"] = [f"{target}{SHA256}" for target in self._targets[path]]

    @property
    def frames(self) -> int:
        """Number of frames that are written."""
        return self.scene.frames // self._every + 1

    def of_group(self, group: Group) -> WorldFile:
        """Return the contents common to the files of a group: those of its first world."""
        plan = group.plan
        attributes: dict[str, Attribute] = {**self._common, "substeps": plan.substeps}
        attributes["balloons"] = ", ".join(shape.name for shape in plan.shapes)
        if plan.scene.contacts:
            attributes["things"] = ", ".join(things_of(plan))
        common = WorldFile(attributes, _static(plan), self._times, fields_of(plan, self.frames))
        return self.of_world(common, int(group.worlds[0]), 1)

    def of_world(self, common: WorldFile, world: int, health: int) -> WorldFile:
        """Return the contents of a world's file."""
        own: dict[str, Attribute] = {"world": world, "health": health}
        for path, values in self.columns.items():
            for name in (*self._targets[path], path):
                own[name] = values[world]
        return replace(common, attributes={**common.attributes, **own})

    @cached_property
    def described(self) -> dict[str, Any]:
        """The scene, and the hashes of its files, the same wherever they are."""
        return without_folders({"scene": describe_scene(self.scene), "files": self._hashes})

    @cached_property
    def _common(self) -> dict[str, Attribute]:
        rate = self.scene.frames_per_second
        hashes = {f"{place}{SHA256}": digest for place, digest in self._hashes.items()}
        numbers = _flat(self.described["scene"]) | hashes
        told = numbers if len(numbers) <= MOST_ATTRIBUTES else {}
        ours: dict[str, Attribute] = {"world": 0, "health": 1, "every": self._every, "time_step": self._every / rate}
        units = {**self._units, "time_step": "s"}
        units |= {target: units[path] for path, targets in self._targets.items() if path in units for target in targets}
        return {**told, **ours, "units": json.dumps(units)}

    @property
    def _times(self) -> Arrays:
        times = np.arange(self.frames) * self._every / self.scene.frames_per_second
        return [(Field("time", ("time",), times.shape, "<f8", "s", "times of the frames"), times)]


def _static(plan: ModelPlan) -> Arrays:
    """Return the meshes of all balloons as one."""
    meshes = [shape.mesh for shape in plan.shapes]
    counts = [mesh.vertex_count for mesh in meshes]
    begins = (np.cumsum(counts) - counts).astype(np.int32)
    parts = {
        "rest_pos": [mesh.points for mesh in meshes],
        "mass_share": [shape.mass_share for shape in plan.shapes],
        "particle_balloon": [np.full(count, number) for number, count in enumerate(counts)],
        "edges": [edges_of(mesh) + begin for mesh, begin in zip(meshes, begins, strict=True)],
        "triangles": [triangulate(mesh)[0] + begin for mesh, begin in zip(meshes, begins, strict=True)],
    }
    arrays = {name: np.concatenate(of_meshes) for name, of_meshes in parts.items()}
    return [
        (Field(name, dimensions, arrays[name].shape, dtype, unit, meaning), arrays[name].astype(dtype))
        for name, dimensions, dtype, unit, meaning in STATIC
    ]


STATIC = (
    ("rest_pos", ("particle", "axis"), "<f4", "m", "rest shape: the mesh as the scene places it"),
    ("mass_share", ("particle",), "<f4", "1", "share of a particle in its balloon's mass, 0 if pinned"),
    ("particle_balloon", ("particle",), "<i4", "1", "balloon of a particle, from 0"),
    ("edges", ("edge", "end"), "<i4", "1", "particles at the ends of each side of a face, once"),
    ("triangles", ("triangle", "corner"), "<i4", "1", "particles at the corners of triangles, counterclockwise"),
)
"""Name, dimensions, kind, unit and meaning of arrays that stay"""


def _targets(scene: Scene, path: str, values: Any) -> list[str]:
    """Find the values of a scene that a path sets, such as `balloon.0.mass` for `balloon.mass`."""
    if is_mesh(path):
        distinct = [Path("one"), Path("another")]  # of which only the names are looked at
    else:
        distinct = [values[0], next((value for value in values if value != values[0]), None)]
    try:
        first, second = (_flat(describe_scene(override_scene(scene, [(path, value)]))) for value in distinct)
    except (InputError, TypeError):
        return []
    return [name for name, value in first.items() if second.get(name) != value]


def _flat(table: Any, path: str = "") -> dict[str, Attribute]:
    """Return the numbers and words of nested tables by dotted paths."""
    if isinstance(table, Mapping | list):
        pairs = table.items() if isinstance(table, Mapping) else enumerate(table)
        below = [_flat(value, f"{path}.{name}" if path else str(name)) for name, value in pairs]
        return {name: value for each in below for name, value in each.items()}
    if isinstance(table, bool):
        return {path: int(table)}
    return {path: table} if isinstance(table, int | float | str) and path != "description" else {}
