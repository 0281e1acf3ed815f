"""Default thickness, stiffness and reach of contacts between balloons, from their meshes and springs."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.kernels.laws.touch import DAMPING_RATIO
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.model.bounds import Bound
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

THICKNESS = 0.05
"""Thickness of a balloon's skin over an edge of its mesh: a hundredth of a sphere's radius, which is invisible"""
STIFFNESS = 0.25
"""Contact stiffness over the sum of a particle's springs: a sphere stretched by a quarter is then indented by less than
the skin's thickness where it lies against another, and the step becomes a quarter shorter"""
SOFTER = 0.45
"""Contact stiffness over that, of a balloon alone that touches itself softly: its step is then hardly shorter"""
APART = 2.0
"""Initial distance from which on parts of a balloon may touch, in edges: farther than neighbors, nearer than
parts that a sharp fold brings together"""
LOOSE_RATE = 600.0
"""Root of stiffness over mass of a balloon without springs [1/s]"""
STIFFNESSES = "touch_stiffnesses"
"""Name of each balloon's contact stiffness in the parameters, shape (W, balloon_count) [N/m]"""


def settle_touch(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Parameters:
    """Return each balloon's default contact stiffness; empty where no balloons touch."""
    if not scene.touches:
        return {}
    share = stiffness_share(scene)
    columns = [_own_stiffness(shape, number, parameters, share) for number, shape in enumerate(shapes)]
    return {STIFFNESSES: np.stack(np.broadcast_arrays(*columns), axis=1)}


def stiffness_share(scene: Scene) -> float:
    """Return the contact stiffness over the sum of a particle's springs."""
    softly = scene.touches_softly and len(scene.balloon) == 1
    return STIFFNESS * (SOFTER if softly else 1.0)


def _own_stiffness(shape: BalloonShape, number: int, parameters: Parameters, share: float) -> NDArray[np.float64]:
    """Return the stiffness at a balloon's mean moving particle, shape (W,)."""
    moving = max(int(np.count_nonzero(shape.mass_share)), 1)
    total: Any = 0.0
    for kind, row in enumerate(KINDS):
        scales = float(shape.stiffness_scale[shape.springs.kind == kind].sum())
        total = total + 2.0 * scales / moving * parameters[row.name][:, number]
    loose = parameters["mass"][:, number] / moving * LOOSE_RATE**2
    return np.where(total > 0.0, share * total, loose)


def edge_length(mesh: PolygonMesh) -> float:
    """Return the mean length of a mesh's edges [m]."""
    ends = mesh.points[mesh_edges(mesh).ends]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())


def crowd_of(shapes: Sequence[BalloonShape], number: int, itself: bool) -> float:
    """Return the number of contacts on a particle of a balloon where even surfaces lie on each other.

    Its own, and as a corner of triangles those of others, as many as fit into its share of the surface.
    """
    counts = np.array([shape.mesh.vertex_count for shape in shapes])
    areas = np.array([shape.area for shape in shapes]) / counts
    crowds = np.clip(areas[number] / np.maximum(areas, 1e-30), 1.0, counts)
    return 1.0 + float(np.max(crowds[_met_by(number, len(shapes), itself)]))


def _met_by(number: int, count: int, itself: bool) -> NDArray[np.bool_]:
    """Return a mask of the balloons that one may touch."""
    return (np.arange(count) != number) | itself


def bound_of_touch(
    scene: Scene, shapes: Sequence[BalloonShape], number: int, parameters: Parameters
) -> dict[Bound, NDArray[np.float64]]:
    """Return the contribution of contacts to stiffness [N/m] and drag [N s/m] at each particle, for the stable step.

    As in `Bounds.sums`, of which twice is over the mass; shape (W,). Empty where no balloons touch. Drag is that of a
    particle with all of the balloon's mass, and goes with the root of a particle's share: the reduced mass, which
    damps a contact, is at most a particle's own.

    A particle meets a surface, and is a corner of triangles that others meet: as many as fit into its share of the
    surface. When two surfaces move against each other, all of that pulls it back, twice; and then their springs rest.
    While springs are at their stiffest, neighbors go opposite ways, and the load of a triangle's corners is evened out:
    it counts half. Where contacts are stiffer than springs, they set the step alone. Where more meet than that, as in
    crumpled skin, they share (`share_of_contact`), so that the step is stable in every state.
    """
    if not scene.touches:
        return {}
    said, own = parameters["touch_stiffness"], parameters[STIFFNESSES]
    crowd = crowd_of(shapes, number, scene.touches_itself)
    mass = parameters["mass"][:, number]
    others = own[:, _met_by(number, len(shapes), scene.touches_itself)]
    between = 2.0 * own[:, number, None] * others / (own[:, number, None] + others)
    each = np.where(said < 0.0, between.max(axis=1), said)
    both = crowd * each
    stiffness = 0.5 * (both + np.maximum(both - own[:, number] / stiffness_share(scene), 0.0))
    return {"stiffness": stiffness, "drag": crowd * float(DAMPING_RATIO) * np.sqrt(each * mass)}
