"""A balloon of the scene as geometry: its mesh placed in the world, and the springs over it. Host side, float64."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import load_mesh
from balloon_warp.scene import Balloon, Scene
from balloon_warp.springs import Springs, build_springs


@dataclass(frozen=True)
class BalloonShape:
    """What a balloon is at the start."""

    name: str
    mesh: PolygonMesh
    """in the world: meters, the scene's up axis, placed"""
    springs: Springs
    stiffness_scale: NDArray[np.float64]
    """each spring's constant over that of its kind, shape (spring_count,)"""
    mass_share: NDArray[np.float64]
    """each particle's part of the balloon's mass, shape (particle_count,); 0 for a particle that does not move"""


def shape_balloon(balloon: Balloon, scene: Scene) -> BalloonShape:
    """Read, place and string the balloon's mesh.

    Raises:
        InputError: the mesh cannot be read, or a fixed particle is not in it.
    """
    mesh = load_mesh(balloon.mesh) if isinstance(balloon.mesh, Path) else balloon.mesh
    placed = replace(
        mesh,
        points=_place(mesh, balloon, scene),
        up_axis=scene.up_axis,
        meters_per_unit=1.0,
        name=balloon.name or mesh.name,
    )
    springs = build_springs(placed)
    draws = np.random.default_rng(balloon.stiffness.seed).uniform(-1.0, 1.0, len(springs.pairs))
    return BalloonShape(
        name=placed.name,
        mesh=placed,
        springs=springs,
        stiffness_scale=1.0 + balloon.stiffness.variation * draws,
        mass_share=_mass_shares(placed, balloon),
    )


def _place(mesh: PolygonMesh, balloon: Balloon, scene: Scene) -> NDArray[np.float64]:
    points = mesh.points * (mesh.meters_per_unit * balloon.scale)
    if mesh.up_axis != scene.up_axis:
        points = points @ (_rotation(0, 90.0) if scene.up_axis == "Z" else _rotation(0, -90.0)).T
    for axis, degrees in enumerate(balloon.rotation):
        points = points @ _rotation(axis, degrees).T
    return points + np.array(balloon.position)


def _rotation(axis: int, degrees: float) -> NDArray[np.float64]:
    """Matrix of a right-handed rotation about a coordinate axis."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix[first, first] = matrix[second, second] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix


def _mass_shares(mesh: PolygonMesh, balloon: Balloon) -> NDArray[np.float64]:
    """Equal shares for the particles that move: those of a face, and not fixed."""
    moves = np.zeros(mesh.vertex_count, dtype=bool)
    moves[mesh.face_vertex_indices] = True
    for particle in balloon.fixed:
        if particle >= mesh.vertex_count:
            raise InputError(f"fixed: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {particle})")
        moves[particle] = False
    return moves / max(int(moves.sum()), 1)
