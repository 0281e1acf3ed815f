"""Strings and their anchors, outer forces, and wind, as a simulation starts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model.obstacles import MOST_FRAMES, BodyShape, initial_poses, obstacle_motion
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape, particles_named
from balloon_warp.model.starts import start_of
from balloon_warp.scene import Scene, String

Values = NDArray[np.floating]
REST = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
"""No shift and no rotation"""


@dataclass(frozen=True)
class Carriers:
    """Carriers of the anchors of strings."""

    obstacles: NDArray[np.int32]
    """Obstacle that carries each anchor, or -1, shape (string_count,)"""
    bodies: NDArray[np.int32]
    """Free body that carries each, or -1, likewise"""
    centers: NDArray[np.float64]
    """Center of mass of that body, from its own origin [m], shape (string_count, 3)"""
    motion: NDArray[np.float64]
    """Motion of each anchor by itself, as from `anchor_motion`"""

    @classmethod
    def of(cls, scene: Scene, bodies: Sequence[BodyShape]) -> Self:
        """Return the carriers of a scene's strings.

        Raises:
            InputError: as `anchor_motion`.
        """
        named = [(string.obstacle, string.body) for string in scene.string]
        numbers = np.array([[-1 if each is None else each for each in pair] for pair in named], dtype=np.int32)
        obstacles, carrying = numbers.reshape(-1, 2).T
        centers = [np.zeros(3) if number < 0 else bodies[number].center for number in carrying.tolist()]
        return cls(obstacles, carrying, np.array(centers).reshape(-1, 3), anchor_motion(scene))

    def anchors_at(self, anchors: Values, positions: Values, poses: Values, frame: float) -> NDArray[np.float64]:
        """Return the anchors of strings at a frame, or between two [m], shape (..., string_count, 3).

        Args:
            anchors: by the scene or its worlds [m], shape (..., string_count, 3).
            positions: of obstacles [m], shape (..., obstacle_count, 3).
            poses: centers of mass [m] and turns of bodies then, as `Frame.body_poses`, shape (..., body_count, 7).
            frame: since the world began.
        """
        if len(self.motion) == 1:
            return np.asarray(anchors, dtype=np.float64)
        first, part = int(frame), frame - int(frame)
        begin, end = (
            _moved(self.motion[min(each, len(self.motion) - 1)], anchors - self.centers) for each in (first, first + 1)
        )
        moved = begin + part * (end - begin)
        if positions.shape[-2]:
            moved = moved + np.where((self.obstacles >= 0)[:, None], positions[..., self.obstacles.clip(min=0), :], 0.0)
        if poses.shape[-2]:
            on_bodies = _moved(poses[..., self.bodies.clip(min=0), :], anchors - self.centers)
            moved = np.where((self.bodies >= 0)[:, None], on_bodies, moved)
        return moved


def anchor_motion(scene: Scene) -> NDArray[np.float64]:
    """Return the motion of anchors until all rest, as `obstacle_motion`, shape (frames, string_count, 7).

    One frame where none moves; of one that an obstacle carries, the obstacle's; of one on a body, rest.

    Raises:
        InputError: one moves for longer than is kept, or as `obstacle_motion`.
    """
    if not any(string.moves for string in scene.string):
        return np.tile(REST, (1, len(scene.string), 1))
    rate, of_obstacles = scene.frames_per_second, obstacle_motion(scene)
    seconds = [string.motion[-1][0] if string.motion else 0.0 for string in scene.string]
    for number, longest in enumerate(seconds):
        if longest * rate > MOST_FRAMES:
            raise InputError(
                f"string.{number}.motion: ends after {longest:g} s; expected {MOST_FRAMES / rate:g} s at most"
            )
    frames = max(ceil(max(seconds) * rate) + 2, len(of_obstacles))
    motion, times = np.tile(REST, (frames, len(scene.string), 1)), np.arange(frames) / rate
    for number, string in enumerate(scene.string):
        if string.obstacle is not None:
            motion[:, number] = of_obstacles[np.minimum(np.arange(frames), len(of_obstacles) - 1), string.obstacle]
        elif string.motion:
            shifts = np.array([shift for _, shift in string.motion])
            told = [time for time, _ in string.motion]
            motion[:, number, :3] = np.stack([np.interp(times, told, shift) for shift in shifts.T], axis=1)
    return motion


def _moved(poses: Values, places: Values) -> NDArray[np.float64]:
    """Return places after shifts and turns, shape (..., n, 3), of shape (..., n, 7)."""
    axis, scalar = poses[..., 3:6], poses[..., 6:]
    across = 2.0 * np.cross(axis, places)
    return poses[..., :3] + places + scalar * across + np.cross(axis, across)


LEAST_STRETCH = 0.005
"""Initial strain of a string that is worth a warning: half a percent"""


def held_particle(number: int, string: String, scene: Scene, shapes: Sequence[BalloonShape]) -> int:
    """Return the particle that a string holds, numbered within its balloon.

    Raises:
        InputError: its balloon has no such particle.
    """
    mesh = shapes[string.balloon].mesh
    if isinstance(string.particle, str):
        used = np.unique(mesh.face_vertex_indices)
        heights = mesh.points[used] @ np.array(scene.up)
        return int(used[heights.argmax() if string.particle == "highest" else heights.argmin()])
    if string.particle >= mesh.vertex_count:
        raise InputError(
            f"string.{number}.particle: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {string.particle})"
        )
    return mesh.stand_in(string.particle)


def string_lengths(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    bodies: Sequence[BodyShape],
    held: Sequence[int],
    parameters: Parameters,
) -> NDArray[np.float64]:
    """Return the strings' lengths [m], shape (W, string_count).

    The default is the initial distance from anchor to particle.
    """
    lengths = parameters["string_length"]
    if not np.isnan(lengths).any():
        return lengths
    return np.where(np.isnan(lengths), _spans(scene, shapes, bodies, held, parameters), lengths)


def overstretched_strings(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    bodies: Sequence[BodyShape],
    held: Sequence[int],
    parameters: Parameters,
) -> list[str]:
    """Return a sentence for each string that exists from the start and is then longer than its length.

    It is on the world where that is worst.
    """
    if not scene.string:
        return []
    spans = _spans(scene, shapes, bodies, held, parameters)
    spans, lengths = np.broadcast_arrays(spans, parameters["string_length"])
    stretches = spans / lengths - 1.0
    sentences = []
    for number in np.flatnonzero(stretches.max(axis=0) > LEAST_STRETCH).tolist():
        world = int(stretches[:, number].argmax())
        where = f" in world {world}" if len(stretches) > 1 else ""
        if scene.string[number].start == 0.0:
            sentences.append(
                f"string {number} starts overstretched by {stretches[world, number]:.0%}{where}: it is "
                f"{lengths[world, number]:.4g} m long, and its ends are {spans[world, number]:.4g} m apart"
            )
    return sentences


ANCHORED = ("string_anchor", "obstacle_position", "initial_body_positions")
"""Names of the parameters that anchors follow from"""


def _spans(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    bodies: Sequence[BodyShape],
    held: Sequence[int],
    parameters: Parameters,
) -> NDArray[np.float64]:
    """Return the vector from each string's anchor to its particle at the start [m], shape (W, string_count)."""
    balloons = [string.balloon for string in scene.string]
    starts = np.concatenate(
        [
            start_of(scene, parameters, balloon, shapes[balloon].mesh.points[[particle]])
            for balloon, particle in zip(balloons, held, strict=True)
        ],
        axis=1,
    )
    return np.linalg.norm(starts - anchors_of(scene, bodies, parameters), axis=-1)


def anchors_of(
    scene: Scene,
    bodies: Sequence[BodyShape],
    parameters: Mapping[str, Any],
    frame: float = 0,
    poses: NDArray[np.floating] | None = None,
) -> NDArray[np.float64]:
    """Return the anchors of strings at a frame in each world [m], shape (W, string_count, 3).

    Args:
        poses: of bodies then, shape (W, body_count, 7); those of the start, when missing.
    """
    anchors, positions, starts = (np.asarray(parameters[name]) for name in ANCHORED)
    if poses is None:
        poses = initial_poses(scene, bodies, starts)
    return Carriers.of(scene, bodies).anchors_at(anchors, positions, poses, frame)


class Driven(NamedTuple):
    """Particles that outer forces drive, force by force."""

    particles: NDArray[np.int64]
    """Numbers of the particles among those of all balloons, shape (n,)"""
    forces: NDArray[np.int64]
    """Index of the force in the scene, shape (n,)"""
    shares: NDArray[np.float64]
    """Share of the particle in the force, by its mass; the shares of a force add up to 1, shape (n,)"""


def driven_particles(scene: Scene, shapes: Sequence[BalloonShape]) -> Driven:
    """Return the particles that a scene's forces drive.

    Raises:
        InputError: a balloon has no such particle or group, or all particles of a force are fixed.
    """
    firsts = np.cumsum([0, *(shape.mesh.vertex_count for shape in shapes)])
    parts = [_driven_by(scene, number, shapes) for number in range(len(scene.force))]
    counts = [len(particles) for particles, _ in parts]
    balloons = [force.balloon for force in scene.force]
    return Driven(
        np.concatenate(
            [np.zeros(0, dtype=np.int64), *(p + firsts[b] for (p, _), b in zip(parts, balloons, strict=True))]
        ),
        np.repeat(np.arange(len(parts)), counts),
        np.concatenate([np.zeros(0), *(shares for _, shares in parts)]),
    )


def _driven_by(
    scene: Scene, number: int, shapes: Sequence[BalloonShape]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the particles of a force, numbered within its balloon, and their shares."""
    force = scene.force[number]
    shape = shapes[force.balloon]
    field = f"force.{number}.particles"
    particles = np.arange(shape.mesh.vertex_count)
    if force.particles is not None:
        named = particles_named(force.particles, shape.mesh, field)
        particles = np.unique([shape.mesh.stand_in(particle) for particle in named]).astype(np.int64)
    particles = particles[shape.mass_share[particles] > 0.0]
    if not len(particles):
        raise InputError(f"{field}: all its particles are fixed in {shape.name}; expected some that move")
    shares = shape.mass_share[particles]
    return particles, shares / shares.sum()


def require_profile(parameters: Parameters) -> None:
    """Make sure that the wind grows in one way, and from the ground's roughness length on up to where it is known.

    Raises:
        InputError: it does not.
    """
    names = ("wind_roughness", "wind_height", "wind_shear")
    roughness, height, shear = np.broadcast_arrays(*(parameters[name] for name in names))
    for world in np.flatnonzero((roughness > 0.0) & (shear > 0.0))[:1]:
        raise InputError(
            f"atmosphere.roughness: gives another wind profile than shear (got {roughness[world]:g}, and a shear of "
            f"{shear[world]:g}); expected only one of them"
        )
    for world in np.flatnonzero(roughness >= height)[:1]:
        raise InputError(
            f"atmosphere.roughness: must be less than wind_height, {height[world]:g} m (got {roughness[world]:g})"
        )
