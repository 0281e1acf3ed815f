"""Balloons that touch: what the scene leaves to us, found of their meshes and springs."""

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
"""of a balloon's skin, over an edge of its mesh: a hundredth of a ball's radius, which nobody sees"""
STIFFNESS = 0.25
"""of a contact, over what a particle's springs have together: a ball that is stretched by a quarter is then pressed
in by less than the skin where it lies against another, and the step becomes a quarter shorter"""
LOOSE_RATE = 600.0
"""root of stiffness over mass [1/s] of a balloon without springs"""
STIFFNESSES = "touch_stiffnesses"
"""the name of each balloon's in the parameters, shape (W, balloon_count) [N/m]"""


def settle_touch(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Parameters:
    """How stiff each balloon's contacts are where the scene does not say it; nothing where no balloons touch."""
    if not scene.touches:
        return {}
    columns = [_own_stiffness(shape, number, parameters) for number, shape in enumerate(shapes)]
    return {STIFFNESSES: np.stack(np.broadcast_arrays(*columns), axis=1)}


def _own_stiffness(shape: BalloonShape, number: int, parameters: Parameters) -> NDArray[np.float64]:
    """Of a balloon's mean particle that moves, shape (W,)."""
    moving = max(int(np.count_nonzero(shape.mass_share)), 1)
    total: Any = 0.0
    for kind, row in enumerate(KINDS):
        scales = float(shape.stiffness_scale[shape.springs.kind == kind].sum())
        total = total + 2.0 * scales / moving * parameters[row.name][:, number]
    loose = parameters["mass"][:, number] / moving * LOOSE_RATE**2
    return np.where(total > 0.0, STIFFNESS * total, loose)


def edge_length(mesh: PolygonMesh) -> float:
    """The mean [m]."""
    ends = mesh.points[mesh_edges(mesh).ends]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())


def crowd_of(shapes: Sequence[BalloonShape], number: int, itself: bool) -> float:
    """Contacts on a particle of a balloon where even surfaces lie on each other: its own, and as a corner of triangles
    those of others, as many as fit into what is its own of the surface."""
    counts = np.array([shape.mesh.vertex_count for shape in shapes])
    areas = np.array([shape.area for shape in shapes]) / counts
    crowds = np.clip(areas[number] / np.maximum(areas, 1e-30), 1.0, counts)
    return 1.0 + float(np.max(crowds[_met_by(number, len(shapes), itself)]))


def _met_by(number: int, count: int, itself: bool) -> NDArray[np.bool_]:
    """Which of so many balloons one may touch."""
    return (np.arange(count) != number) | itself


def bound_of_touch(
    scene: Scene, shapes: Sequence[BalloonShape], number: int, parameters: Parameters
) -> dict[Bound, NDArray[np.float64]]:
    """What contacts add to the stiffness [N/m] and to the drag [N s/m] of each particle of a balloon, for the stable
    step: as `Bounds.sums` counts, of which twice is over the mass; shape (W,). Nothing where no balloons touch.

    A particle meets a surface, and is a corner of triangles that others meet: as many as fit into what is its own of
    the surface. When two surfaces move against each other, all of that pulls it back, twice; and then their springs
    rest. While springs are at their stiffest, neighbors go opposite ways, and what a triangle's corners bear is evened
    out: it counts half. Where contacts are stiffer than springs, they set the step alone. Where more meet than that, as
    in what crumples, they share (`share_of_contact`), so that the step is stable in every state.
    """
    if not scene.touches:
        return {}
    said, own = parameters["touch_stiffness"], parameters[STIFFNESSES]
    crowd = crowd_of(shapes, number, scene.touches_itself)
    mass = parameters["mass"][:, number] * shapes[number].mass_share.max()
    others = own[:, _met_by(number, len(shapes), scene.touches_itself)]
    between = 2.0 * own[:, number, None] * others / (own[:, number, None] + others)
    each = np.where(said < 0.0, between.max(axis=1), said)
    both = crowd * each
    stiffness = 0.5 * (both + np.maximum(both - own[:, number] / STIFFNESS, 0.0))
    return {"stiffness": stiffness, "drag": crowd * float(DAMPING_RATIO) * np.sqrt(each * mass)}
