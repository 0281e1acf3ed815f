"""Check that nothing starts inside an obstacle or a free body.

It would be torn to the surface in its first step. Host side, float64.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from balloon_warp.errors import InputError
from balloon_warp.mesh.geometry import box_corners
from balloon_warp.model.obstacles import BodyShape, ObstacleShape, initial_centers, initial_turns, obstacle_motion
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.solids import Solid
from balloon_warp.model.starts import start_of
from balloon_warp.scene import Scene

DEEP = 0.01
"""Tolerated depth over the balloon's size, or over the obstacle's extent if that is less, for rounding and for meshes
that stand on surfaces"""


def require_clear_starts(
    scene: Scene, shapes: Sequence[BalloonShape], obstacles: Sequence[ObstacleShape], parameters: Parameters
) -> None:
    """Refuse balloons of which a particle that moves starts inside an obstacle, in any world. Sheets have no inside.

    Args:
        parameters: with those that `settle_starts` makes.

    Raises:
        InputError: names balloon and obstacle, and how deep the one is in the other.
    """
    motion = obstacle_motion(scene)[0]
    for number, obstacle in enumerate(obstacles):
        if not obstacle.closed:
            continue
        solid = Solid(obstacle, np.array(scene.up), Rotation.from_quat(motion[number, 3:]))
        centers = parameters["obstacle_position"][:, number] + motion[number, :3]
        for balloon, shape in enumerate(shapes):
            named = f"obstacle {number}, {scene.obstacle[number].name or f'a {solid.shape.kind}'}"
            _require_outside(scene, balloon, shape, named, solid, centers, parameters)


def require_clear_bodies(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    obstacles: Sequence[ObstacleShape],
    bodies: Sequence[BodyShape],
    parameters: Parameters,
) -> None:
    """Refuse bodies that start in other solids, and balloons and spheres that start in bodies, in any world.

    Other solids are the ground, obstacles and bodies. Sheets have no inside.

    Args:
        parameters: Parameters with the results of `settle_starts`.

    Raises:
        InputError: Names both, and the depth of the one in the other.
    """
    up, motion = np.array(scene.up), obstacle_motion(scene)[0]
    solids = [
        Solid(shape.solid, up, Rotation.from_quat(turn)) if shape.solid.closed else None
        for shape, turn in zip(bodies, initial_turns(scene), strict=True)
    ]
    centers = initial_centers(scene, bodies, parameters["initial_body_positions"])
    ways = [
        (f"obstacle {n}", Solid(shape, up, Rotation.from_quat(motion[n, 3:])), places)
        for n, shape in enumerate(obstacles)
        for places in [parameters["obstacle_position"][:, n] + motion[n, :3]]
        if shape.closed
    ]
    ways += [(f"body {n}", solid, centers[:, n]) for n, solid in enumerate(solids) if solid]
    for number, (shape, turn) in enumerate(zip(bodies, initial_turns(scene), strict=True)):
        arms = Rotation.from_quat(turn).apply(np.concatenate([shape.samples.points[:, :3], np.zeros((1, 3))]))
        for world in range(len(centers)):
            points, allowed = centers[world, number] + arms, DEEP * shape.solid.reach
            found = [
                (way, _depth_in(solid, points, _row(at, world)[0]))
                for way, solid, at in ways
                if way != f"body {number}"
            ]
            if scene.ground is not None:
                height = float(_row(parameters["ground_height"], world)[0])
                found.append(("the ground", height - float((points @ up).min())))
            found = [(way, deep + shape.samples.points[:, 3].min()) for way, deep in found]
            for way, deep in found:
                _require_shallow(f"body.{number}.position: it", way, deep, allowed)
    for number, solid in enumerate(solids):
        if solid is None:
            continue
        for balloon, shape in enumerate(shapes):
            _require_outside(scene, balloon, shape, f"body {number}", solid, centers[:, number], parameters)
        for sphere in range(len(scene.sphere)):
            worlds = max(len(centers), len(parameters["initial_sphere_positions"]))
            for world in range(worlds):
                at = _row(parameters["initial_sphere_positions"], world)[0, sphere]
                radius = float(_row(parameters["sphere_radius"], world)[0, sphere])
                deep = _depth_in(solid, at[None], _row(centers[:, number], world)[0]) + radius
                if radius > 0.0:
                    _require_shallow(f"sphere.{sphere}.position: it", f"body {number}", deep, DEEP * radius)


def _depth_in(solid: Solid, points: NDArray[np.float64], center: NDArray[np.float64]) -> float:
    """Return the largest depth of points in a solid [m], negative outside; minus infinity far away."""
    seen = solid.seen(points[None], center[None])[0]
    near = np.linalg.norm(seen, axis=1) < 2.0 * solid.shape.reach
    return -float(solid.distances(seen[near]).min()) if near.any() else -np.inf


def _require_shallow(what: str, where: str, depth: float, allowed: float) -> None:
    if depth > allowed:
        raise InputError(f"{what} starts {depth:.3g} m deep inside {where}; expected it outside")


def _require_outside(
    scene: Scene,
    balloon: int,
    shape: BalloonShape,
    named: str,
    solid: Solid,
    centers: NDArray[np.float64],
    parameters: Parameters,
) -> None:
    """Look at the particles only in worlds where the boxes around balloon and obstacle overlap."""
    corners = solid.seen(start_of(scene, parameters, balloon, box_corners(shape.mesh)), centers)
    lowest, highest = solid.bounds
    near = ((corners.min(axis=1) < highest) & (corners.max(axis=1) > lowest)).all(axis=1)
    used = np.unique(shape.mesh.face_vertex_indices)
    moving = used[shape.mass_share[used] > 0.0]
    allowed = DEEP * min(float(np.ptp(shape.mesh.points[used], axis=0).max()), solid.shape.reach)
    for world in np.flatnonzero(near).tolist():
        alone = {name: _row(parameters[name], world) for name in ("initial_turns", "initial_shifts")}
        points = solid.seen(start_of(scene, alone, balloon, shape.mesh.points[moving]), _row(centers, world))[0]
        within = points[((points > lowest) & (points < highest)).all(axis=1)]
        depth = -float(solid.distances(within).min()) if len(within) else 0.0
        if depth > allowed:
            where = f" in world {world}" if len(near) > 1 else ""
            raise InputError(
                f"balloon.{balloon}.position: {shape.name} starts{where} {depth:.3g} m deep inside {named}; "
                "expected it outside"
            )


def _row(values: NDArray[np.float64], world: int) -> NDArray[np.float64]:
    """Return the values of one world, with the dimension of worlds."""
    return values[world : world + 1] if len(values) > 1 else values
