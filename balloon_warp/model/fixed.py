"""The particles of a balloon that do not move, from the scene's numbers and groups."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh

MOST_NAMED = 20
"""Largest number of groups that an error lists"""


def fixed_particles(fixed: Sequence[int | str], mesh: PolygonMesh) -> list[int]:
    """Return the numbers of particles, including those of groups.

    Raises:
        InputError: the mesh has no such particle or group.
    """
    return particles_named(fixed, mesh, "fixed")


def particles_named(named: Sequence[int | str], mesh: PolygonMesh, field: str) -> list[int]:
    """Return the numbers of particles, including those of groups, that a field names.

    Raises:
        InputError: the mesh has no such particle or group.
    """
    particles: list[int] = []
    for each in named:
        if isinstance(each, int):
            if each >= mesh.vertex_count:
                raise InputError(f"{field}: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {each})")
            particles.append(each)
        else:
            particles += group_of(mesh, each, field).tolist()
    return particles


def group_of(mesh: PolygonMesh, name: str, field: str) -> NDArray[np.int32]:
    """Return the particles of a group of the mesh.

    Args:
        field: that names it.

    Raises:
        InputError: there is no such group.
    """
    if name in mesh.groups:
        return mesh.groups[name]
    known = ", ".join(list(mesh.groups)[:MOST_NAMED]) or "none"
    raise InputError(f"{field}: {mesh.name} has no group {name[:60]}; it has {known}")
