"""A balloon of the scene as geometry: its mesh placed in the world, and the springs over it. Host side, float64."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.orientation import oriented_outward
from balloon_warp.mesh.placement import place_mesh
from balloon_warp.mesh.topology import inconsistent_edges, is_closed, mesh_edges
from balloon_warp.scene import Balloon, Scene, Stiffness
from balloon_warp.springs import Springs, build_springs
from balloon_warp.springs.hinges import Hinges, build_hinges

LEAST_SIZE, LARGEST_SIZE = 1.0e-6, 1.0e9
"""of a balloon [m]"""
LEAST_SIZE_OVER_DISTANCE = 1.0e-4
"""a balloon's size over its distance from the origin: float32 then resolves a thousandth of it"""


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

    @cached_property
    def hinges(self) -> Hinges:
        """Where torsion springs would be."""
        return build_hinges(self.mesh)

    @cached_property
    def closed(self) -> bool:
        """Whether no edge of the mesh is on a border."""
        return is_closed(mesh_edges(self.mesh))


def shape_balloon(balloon: Balloon, scene: Scene) -> BalloonShape:
    """Read, place and string the balloon's mesh.

    Raises:
        InputError: the mesh cannot be read, its size or place is too much for float32, or a fixed particle is not in
            it.
    """
    mesh = load_mesh(balloon.mesh) if isinstance(balloon.mesh, Path) else balloon.mesh
    placed = place_mesh(mesh, scene.up_axis, balloon.scale, balloon.rotation, balloon.position)
    _check_size(placed, balloon.mesh if isinstance(balloon.mesh, Path) else mesh.name)
    placed = _outward(replace(placed, name=balloon.name or mesh.name))
    springs = build_springs(placed)
    return BalloonShape(
        name=placed.name,
        mesh=placed,
        springs=springs,
        stiffness_scale=_stiffness_scale(placed, springs, balloon.stiffness),
        mass_share=_mass_shares(placed, balloon),
    )


def _stiffness_scale(mesh: PolygonMesh, springs: Springs, stiffness: Stiffness) -> NDArray[np.float64]:
    """Each spring's constant over that of its kind: drawn, and changing along an axis."""
    draws = np.random.default_rng(stiffness.seed).uniform(-1.0, 1.0, springs.count)
    along = mesh.points[:, "XYZ".index(stiffness.gradient_axis)]
    used = along[mesh.face_vertex_indices]
    lowest, size = used.min(), max(float(np.ptp(used)), LEAST_SIZE)
    place = (along[springs.pairs].mean(axis=1) - lowest) / size
    low, high = stiffness.gradient
    return (1.0 + stiffness.variation * draws) * (low + (high - low) * place)


def _outward(mesh: PolygonMesh) -> PolygonMesh:
    """A closed mesh with its faces wound outward: inflation follows their normals."""
    edges = mesh_edges(mesh)
    if not is_closed(edges) or (len(inconsistent_edges(edges)) == 0 and signed_volume(mesh) >= 0.0):
        return mesh
    return replace(
        oriented_outward(mesh), warnings=(*mesh.warnings, "Faces that were wound inward have been turned outward.")
    )


def _check_size(mesh: PolygonMesh, source: object) -> None:
    """Refuse what float32 cannot simulate: positions far from the origin for their size, and extreme sizes."""
    size = float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).max())
    if not LEAST_SIZE <= size <= LARGEST_SIZE:
        raise InputError(f"{source}: is {size:g} m large; expected {LEAST_SIZE:g} to {LARGEST_SIZE:g} m")
    _check_reach(mesh, source, np.zeros((1, 3)))


def require_resolution(shape: BalloonShape, shifts: NDArray[np.float64]) -> None:
    """Make sure that float32 resolves the balloon wherever a world puts it.

    Args:
        shifts: from where the scene puts it [m], shape (W, 3).

    Raises:
        InputError: it does not.
    """
    _check_reach(shape.mesh, shape.name, shifts)


def _check_reach(mesh: PolygonMesh, source: object, shifts: NDArray[np.float64]) -> None:
    points = mesh.points[mesh.face_vertex_indices]
    lowest, highest = points.min(axis=0), points.max(axis=0)
    size = float((highest - lowest).max())
    reach = max(float(np.abs(lowest + shifts).max()), float(np.abs(highest + shifts).max()))
    if size < LEAST_SIZE_OVER_DISTANCE * reach:
        raise InputError(
            f"{source}: is {size:g} m large and {reach:g} m from the origin, too far for 32-bit numbers; move it closer"
        )


def _mass_shares(mesh: PolygonMesh, balloon: Balloon) -> NDArray[np.float64]:
    """Equal shares for the particles that move: those of a face, and not fixed."""
    moves = np.zeros(mesh.vertex_count, dtype=bool)
    moves[mesh.face_vertex_indices] = True
    for particle in balloon.fixed:
        if particle >= mesh.vertex_count:
            raise InputError(f"fixed: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {particle})")
        moves[particle] = False
    return moves / max(int(moves.sum()), 1)
