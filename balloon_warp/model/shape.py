"""A balloon of the scene as geometry: its mesh placed in the world, and the springs over it. Host side, float64."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.check import check_mesh
from balloon_warp.mesh.defects import describe_defects
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.placement import place_mesh
from balloon_warp.mesh.repair import repaired, welded
from balloon_warp.mesh.size import LEAST_SIZE, require_size
from balloon_warp.mesh.topology import is_closed, mesh_edges
from balloon_warp.mesh.units import in_unit
from balloon_warp.scene import Balloon, Scene, Stiffness
from balloon_warp.springs import Springs, build_springs
from balloon_warp.springs.hinges import Hinges, build_hinges


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

    @property
    def warnings(self) -> list[str]:
        """What is odd about its mesh, and what became of it, in sentences that begin with its name."""
        return [f"{self.name}: {warning}" for warning in self.mesh.warnings]

    @cached_property
    def closed(self) -> bool:
        """Whether no edge of the mesh is on a border."""
        return is_closed(mesh_edges(self.mesh))


def shape_balloon(balloon: Balloon, scene: Scene) -> BalloonShape:
    """Read, repair, place and string the balloon's mesh.

    Raises:
        InputError: the mesh cannot be read or has no face, its size or place is too much for float32, or a fixed
            particle is not in it.
    """
    mesh, source = _repaired_mesh(balloon)
    placed = place_mesh(in_unit(mesh, balloon.unit), scene.up_axis, balloon.scale, balloon.rotation, balloon.position)
    require_size(placed, source)
    placed = replace(placed, name=balloon.name or mesh.name)
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


def _repaired_mesh(balloon: Balloon) -> tuple[PolygonMesh, object]:
    """The balloon's mesh, repaired and with a warning of what is odd about it, and where it is from."""
    if isinstance(balloon.mesh, Path):
        mesh, source = load_mesh(balloon.mesh, balloon.weld), balloon.mesh
    else:
        mesh, source = balloon.mesh, balloon.mesh.name
        check_mesh(mesh, source, least_corners=2)
        if mesh.face_vertex_counts.max() == 2:  # a net of springs along edges alone
            return mesh, source
        mesh = welded(mesh) if balloon.weld else mesh
    warnings = (*mesh.warnings, *describe_defects(mesh))
    return replace(repaired(mesh, source), warnings=warnings), source


def _mass_shares(mesh: PolygonMesh, balloon: Balloon) -> NDArray[np.float64]:
    """Equal shares for the particles that move: those of a face, and not fixed."""
    moves = np.zeros(mesh.vertex_count, dtype=bool)
    moves[mesh.face_vertex_indices] = True
    for particle in balloon.fixed:
        if particle >= mesh.vertex_count:
            raise InputError(f"fixed: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {particle})")
        moves[particle] = False
    return moves / max(int(moves.sum()), 1)
