"""Meshes from the wild: with legs and thin walls, of many parts, open."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import odd_meshes
from meshes import grid, joined, lattice, mesh_of, quad_sphere, with_tips
from numpy.typing import NDArray
from odd_meshes import band, box, chair, deformed, merged, without

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import face_centers


def _twice(mesh: PolygonMesh) -> NDArray[np.bool_]:
    """Return the faces that coincide with others: the walls between neighboring parts."""
    sets = [frozenset(f.tolist()) for f in np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])]
    counts = Counter(sets)
    return np.array([counts[corners] > 1 for corners in sets])


def ball_with_holes() -> PolygonMesh:
    """Return a ball of quads, from whose underside a round patch is missing, and a face elsewhere."""
    ball = quad_sphere(16, 0.5)
    centers = face_centers(ball)
    drop = centers @ np.array([0.0, -1.0, 0.0]) > 0.5 * np.cos(0.22)
    drop[(centers @ np.array([1.0, 0.3, 0.0])).argmax()] = True
    return without(ball, drop)


def table() -> PolygonMesh:
    """Return a top on four thin legs, in one piece of quads, Z up."""
    top = box((0.0, 0.0, 0.7), (1.0, 0.6, 0.06), (20, 12, 1))
    legs = [box((x, y, 0.335), (0.05, 0.05, 0.67), (1, 1, 12)) for x in (-0.475, 0.475) for y in (-0.275, 0.275)]
    whole = merged(joined(top, *legs))
    return replace(without(whole, _twice(whole)), up_axis="Z")


def cup() -> PolygonMesh:
    """Return a closed cup, with a wall of a twelfth of its width."""
    outer = [(0.2, 0.0), (0.3, 0.0), *((0.3, h) for h in np.linspace(0.08, 0.7, 9))]
    inner = [*((0.25, h) for h in np.linspace(0.7, 0.1, 9)), (0.25, 0.05), (0.15, 0.05)]
    turn = 2.0 * np.pi * np.arange(32) / 32
    reach, height = np.array(outer + inner).T[..., None]
    circles = np.stack([reach * np.cos(turn), height + 0.0 * turn, -reach * np.sin(turn)], axis=-1)
    return with_tips(circles, [(0.0, 0.0, 0.0), (0.0, 0.05, 0.0)])


def bowl() -> PolygonMesh:
    """Return an open hemisphere."""
    ball = quad_sphere(12, 0.5)
    return without(ball, face_centers(ball)[:, 1] > 0.0)


def sword() -> PolygonMesh:
    """Return a flat blade of 1 m by 5 cm by 4 mm, a guard and a grip, which overlap; Y up."""
    blade = box((0.0, 0.7, 0.0), (0.05, 1.0, 0.004), (3, 60, 1))
    blade = deformed(blade, lambda p: p * np.where(p[:, 1:2] > 1.05, [[0.3, 1.0, 1.0]], 1.0))
    guard = box((0.0, 0.2, 0.0), (0.2, 0.03, 0.03), (12, 2, 2))
    grip = box((0.0, 0.1, 0.0), (0.03, 0.19, 0.03), (2, 12, 2))
    return joined(blade, guard, grip)


def head() -> PolygonMesh:
    """Return a round head with a brow, a nose and thin ears."""
    ball = quad_sphere(24, 0.5)

    def shaped(points: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = points.T / 0.5
        more = 0.08 * np.exp(-((y - 0.35) ** 2) / 0.01) * (z > 0.2)  # brow
        more = more + 0.25 * np.exp(-(x**2 + (y - 0.05) ** 2) / 0.02) * (z > 0)  # nose
        more = more - 0.08 * np.exp(-((np.abs(x) - 0.3) ** 2 + (y - 0.17) ** 2) / 0.01) * (z > 0)  # eyes
        more = more + 0.5 * np.exp(-((y - 0.1) ** 2) / 0.08 - z**2 / 0.006) * (np.abs(x) > 0.5)  # ears
        return points * (1.0 + more)[:, None]

    return deformed(ball, shaped)


def hair(ribbons: int = 200, length: int = 10) -> PolygonMesh:
    """Return ribbons of quads that hang from a scalp, each by itself, one quad wide."""
    numbers = np.random.default_rng(3)
    strands = []
    for _ in range(ribbons):
        turn, tilt = numbers.uniform(0.0, 2.0 * np.pi), numbers.uniform(0.0, 1.2)
        out = np.array([np.sin(tilt) * np.cos(turn), np.cos(tilt), np.sin(tilt) * np.sin(turn)])
        side = 0.012 * np.array([-np.sin(turn), 0.0, np.cos(turn)])
        along = np.linspace(0.0, 1.0, length + 1)[:, None]
        middle = 0.12 * out + along * (0.1 * out + [0.0, -0.05, 0.0]) - [0.0, 0.25, 0.0] * along**2
        points = np.concatenate([middle - side, middle + side])
        strands.append(mesh_of(points, lattice(np.arange(2 * length + 2).reshape(2, -1)).tolist()))
    return joined(*strands)


def haired() -> PolygonMesh:
    """Return a closed head under open hair."""
    return joined(deformed(quad_sphere(12, 0.12), lambda p: p * [1.0, 1.2, 1.0]), hair(60))


def car(windshield: bool = True) -> PolygonMesh:
    """Return a body, a cabin, bumpers, lamps, doors, handles and wheels, thirty closed parts that touch and overlap;
    and an open windshield. Z up, 4 m long."""
    parts = [
        box((0.0, 0.0, 0.6), (4.0, 1.6, 0.5), (16, 8, 2)),
        box((-0.2, 0.0, 1.1), (1.8, 1.4, 0.5), (8, 6, 2)),
        box((2.05, 0.0, 0.45), (0.12, 1.7, 0.2), (1, 8, 2)),
        box((-2.05, 0.0, 0.45), (0.12, 1.7, 0.2), (1, 8, 2)),
        box((0.0, 0.0, 0.32), (2.0, 1.2, 0.06), (6, 4, 1)),
    ]
    for side in (-1.0, 1.0):
        parts += [box((x, 0.81 * side, 0.62), (0.7, 0.03, 0.4), (4, 1, 3)) for x in (-0.6, 0.2)]
        parts += [box((x, 0.85 * side, 0.7), (0.12, 0.02, 0.03), (2, 1, 1)) for x in (-0.6, 0.2)]
        parts += [box((0.8, 0.86 * side, 0.95), (0.08, 0.16, 0.1))]
        parts += [box((x, 0.55 * side, 0.65), (0.06, 0.25, 0.12)) for x in (-2.02, 2.02)]
        parts += [box((0.0, 0.55 * side, 1.37), (1.2, 0.04, 0.04), (6, 1, 1))]
    for x in (-1.25, 1.25):
        for side in (-1.0, 1.0):
            wheel = deformed(quad_sphere(4, 0.32), lambda p: p * [1.0, 0.35, 1.0])
            parts.append(deformed(wheel, lambda p, x=x, side=side: p + [x, 0.8 * side, 0.32]))
            parts.append(box((x, 0.9 * side, 0.32), (0.1, 0.06, 0.1)))
    if windshield:
        glass = deformed(grid(6, 3), lambda p: p / [6.0, 3.0, 1.0])
        parts.append(
            deformed(glass, lambda p: p @ [[0.0, 1.3, 0.0], [-0.35, 0.0, 0.4], [0.0] * 3] + [1.15, -0.65, 0.9])
        )
    return replace(joined(*parts), up_axis="Z")


IN_ODD_MESHES = "chair walled two_at_an_edge two_at_a_vertex finned klein t_junction doubled"
ODD: dict[str, Callable[[], PolygonMesh]] = {
    **{name: getattr(odd_meshes, name) for name in IN_ODD_MESHES.split()},
    "whole_chair": lambda: chair(holes=False, mixed=False),
    "mixed_chair": lambda: chair(holes=False),
    "moebius": band,
    "twisted": lambda: band(turns=1.0),
    **{make.__name__: make for make in (ball_with_holes, table, cup, bowl, sword, head, hair, haired, car)},
}
"""by name"""
