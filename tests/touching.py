"""Scenes of balloons in contact, which tests share."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from meshes import box, grid, mesh_of, quad_sphere, with_tips
from numpy.typing import NDArray

from balloon_warp import Atmosphere, Balloon, Ground, Inflation, PolygonMesh, Scene, Simulator, Stiffness, Touch
from balloon_warp.benchmarks.overlap import Points, deepest_overlap, dot, surface

RADIUS = 0.5
SLACK = Inflation(pressure=0.0)
"""no pressure at all"""
VACUUM: dict[str, Any] = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0)}


def ball(*position: float, **fields: Any) -> Balloon:
    """Return a balloon of 386 particles."""
    return Balloon(**{"mesh": quad_sphere(8, RADIUS), "position": position, "mass": 0.3, "damping": 0.0} | fields)


def collision(speed: float = 2.0, touch: Touch | None = None, **fields: Any) -> Scene:
    """Return two equal balls that collide off their centers in empty space, one turning."""
    firm = {"inflation": SLACK, "stiffness": Stiffness(flexion=50.0)}
    balls = [
        ball(-0.7, 0.0, 0.0, velocity=(speed, 0.0, 0.0), angular_velocity=(0.0, 0.0, speed), **firm),
        ball(0.7, 0.2, 0.1, velocity=(-speed, 0.0, 0.0), **firm),
    ]
    return Scene(**{"balloon": balls, "touch": touch or Touch(), "substeps": 48} | VACUUM | fields)


def fast() -> Scene:
    """Return two balls of air at 20 m/s towards each other, nearly along their centers, a twentieth of their radius in
    a substep."""
    air = Inflation(kind="gas", start_pressure=30.0)
    balls = [ball(x, 0.1 * x, 0.0, velocity=(-10.0 * x, 0.0, 0.0), inflation=air) for x in (-1, 1)]
    return Scene(balloon=balls, touch=Touch(), **VACUUM)


def pile(**fields: Any) -> Scene:
    """Return a ball on another, on the ground, which keeps them where they are."""
    balls = [ball(0.0, 0.52, 0.0, damping=0.6), ball(0.0, 1.56, 0.0, damping=0.6)]
    return Scene(**{"balloon": balls, "ground": Ground(), "touch": Touch()} | fields)


def square(cells: int, size: float, axis: int = 2) -> PolygonMesh:
    """Return a flat square of so many cells a side about the origin, across an axis."""
    flat = grid(cells, cells)
    points = size * (flat.points / cells - (0.5, 0.5, 0.0))
    return replace(flat, points=np.roll(points, axis - 2, axis=1))


def ramp(degrees: float, friction: float) -> Scene:
    """Return a stiff block on a fixed tilted plane; it is viscous, as a rattling one creeps."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    along = np.array([0.0, -sine, cosine]), np.array([0.0, cosine, sine])  # down the plane, and out of it
    plane = {"mesh": square(6, 6.0), "rotation": (-90.0 + degrees, 0.0, 0.0), "fixed": list(range(49))}
    block = {"mesh": box((0, 0, 0), (1, 1, 1)), "scale": 0.5, "mass": 1.0, "damping": 0.0, "inflation": SLACK}
    place = tuple(0.27 * along[1] - 0.5 * along[0])
    stiff = Stiffness(structural=2000.0, shear=2000.0, flexion=2000.0, viscosity=1e-3)
    return Scene(
        balloon=[
            Balloon(inflation=SLACK, **plane),
            Balloon(position=place, rotation=(degrees, 0.0, 0.0), stiffness=stiff, **block),
        ],
        touch=Touch(friction=friction, thickness=0.02), atmosphere=Atmosphere(density=0.0),
    )  # fmt: skip


def cushion(cells: int) -> PolygonMesh:
    """Return two flat sheets of 30 cm, joined at their rims."""
    top = grid(cells, cells)
    rim = ((top.points[:, :2] == 0.0) | (top.points[:, :2] == cells)).any(axis=1)
    below = np.where(rim, np.arange(len(rim)), len(rim) + np.cumsum(~rim) - 1)
    faces = top.face_vertex_indices.reshape(-1, 4)
    points = np.concatenate([top.points, top.points[~rim]]) - np.array([cells / 2.0, cells / 2.0, 0.0])
    return mesh_of(0.3 / cells * points, [*faces.tolist(), *below[faces][:, ::-1].tolist()])


def tube(rings: int, around: int) -> PolygonMesh:
    """Return a closed tube of 2 m along x, 16 cm wide."""
    along, angles = np.linspace(-1.0, 1.0, rings), 2.0 * np.pi * np.arange(around) / around
    circles = np.array([[(x, 0.08 * np.cos(a), 0.08 * np.sin(a)) for a in angles] for x in along])
    return with_tips(circles, [(-1.04, 0.0, 0.0), (1.04, 0.0, 0.0)])


def horseshoe() -> PolygonMesh:
    """Return a tube of radius 0.2 m along the unit circle about z, but for some 40 degrees around x."""
    straight = tube(rings=25, around=8)
    x, y, z = straight.points.T * [[1.0], [2.5], [2.5]]
    turn, away = np.pi + np.radians(155.0) * x, 1.0 - y
    return replace(straight, points=np.stack([away * np.cos(turn), away * np.sin(turn), z], axis=1))


def centers(simulator: Simulator, world: int = 0) -> NDArray[np.float64]:
    """Return the centers of the particles of each balloon [m], shape (balloon_count, 3)."""
    points = simulator.state.points.numpy()[world].astype(np.float64)
    return np.array([part.mean(axis=0) for part in np.split(points, simulator.model.particle_offsets[1:-1])])


def touching(simulator: Simulator) -> int:
    """Return the number of particles of all worlds that touch anything."""
    return int((simulator.state.holds.numpy()[..., 3] != 0.0).sum())


def deepest(simulator: Simulator, world: int = 0) -> float:
    """Return the largest distance of a particle within another balloon from its surface [m]; 0 if none is in any."""
    points = simulator.state.points.numpy()[world].astype(np.float64)
    parts = [points[begin:end] for begin, end in pairwise(simulator.model.particle_offsets)]
    return deepest_overlap(parts, [shape.mesh for shape in simulator.model.shapes])


def edges_through(points: Points, ends: NDArray[np.int64], mesh: PolygonMesh) -> int:
    """Return the number of edges of one balloon that pierce faces of another (Möller and Trumbore 1997).

    Args: points: particles of the first balloon. ends: its edges, shape (E, 2). mesh: the other balloon."""
    triangles, count = surface(mesh), 0
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    for begin, end in points[ends]:
        across, start = np.cross(end - begin, second), begin - triangles[:, 0]
        whole = dot(first, across)
        whole = np.where(np.abs(whole) > 1e-15, whole, np.inf)
        beside = np.cross(start, first)
        u, v, part = dot(start, across) / whole, (beside @ (end - begin)) / whole, dot(beside, second) / whole
        count += bool(((u > 0.0) & (v > 0.0) & (u + v < 1.0) & (part > 0.0) & (part < 1.0)).any())
    return count
