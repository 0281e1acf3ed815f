"""Balloons, strings, outer forces and wind as a simulation starts. Host side, float64.

Initial placement and velocity of each balloon in each world. Host side, float64.

The scene places a balloon's mesh; a world may turn it about its origin, and shift it.

Balloons that are pressed from outside harder than from within: by water, or in a vacuum. Host side.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.gas import NO_INSIDE
from balloon_warp.kernels.laws.outer import EVENED
from balloon_warp.mesh.load import rotation_matrix
from balloon_warp.mesh.topology import box_corners, require_reach, signed_volume
from balloon_warp.model.obstacles import MOST_FRAMES, BodyShape, initial_poses, obstacle_motion
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape, particles_named
from balloon_warp.scene import Balloon, Scene, String

ALIKE = 1e-6
"""Difference of heights, over a balloon's size, below which either may count as the extreme one"""


def resolve_starts(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Parameters:
    """Convert places and rotations to the transforms by which the device makes the start.

    Returns:
        `initial_shifts` [m] and `initial_centers`, of mass [m], of shape (W, balloon_count, 3), and `initial_turns`,
        shape (W, balloon_count, 3, 3): the matrix of the rotation from where the scene has the balloon, less 1. So it
        is exactly 0 where no world turns it.

    Raises:
        InputError: a balloon is too far away for float32, or turns where its springs' constants hang on how it stands.
    """
    placed = np.array([balloon.position for balloon in scene.balloon])
    settled = {
        "initial_shifts": parameters["initial_balloon_positions"] - placed,
        "initial_turns": _turns(scene, parameters["initial_rotations"]),
    }
    settled["initial_centers"] = np.stack(
        np.broadcast_arrays(
            *(
                start_of(scene, settled, number, (shape.mass_share @ shape.mesh.points)[None])[:, 0]
                for number, shape in enumerate(shapes)
            )
        ),
        axis=1,
    )
    for number, shape in enumerate(shapes):
        require_reach(shape.mesh, shape.name, start_of(scene, settled, number, box_corners(shape.mesh)))
        if scene.balloon[number].stiffness.gradient != (1.0, 1.0) and settled["initial_turns"][:, number].any():
            raise InputError(
                f"balloon.{number}.rotation: cannot differ between worlds while stiffness.gradient changes springs "
                "along an axis of the scene"
            )
    return settled


def start_of(scene: Scene, parameters: Parameters, number: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points of a balloon, where the scene has them, as they are at the start of each world.

    Args:
        parameters: with those that `resolve_starts` makes.
        points: [m], shape (n, 3).

    Returns:
        [m], shape (W, n, 3).
    """
    arms = points - np.array(scene.balloon[number].position)
    turned = np.einsum("wij,nj->wni", parameters["initial_turns"][:, number], arms)
    return points + turned + parameters["initial_shifts"][:, number, None]


def start_velocities(shapes: Sequence[BalloonShape], parameters: Parameters) -> list[NDArray[np.float64]] | None:
    """Return bounds on the initial velocities of each balloon's particles [m/s], shape (particle_count, 3).

    They are those of the fastest world; None where all are at rest.
    """
    names = ("initial_velocities", "initial_spins")
    if not any(parameters[name].any() for name in names):
        return None
    fastest = []
    for number, shape in enumerate(shapes):
        velocity, spin = (np.linalg.norm(parameters[name][:, number], axis=-1).max() for name in names)
        reach = np.linalg.norm(shape.mesh.points - shape.mass_share @ shape.mesh.points, axis=1)
        along = np.zeros((len(reach), 3))
        along[:, 0] = velocity + spin * reach
        fastest.append(along)
    return fastest


def require_same_extreme(scene: Scene, parameters: Parameters, string: int, shape: BalloonShape, held: int) -> None:
    """Make sure that the particle which a string holds because it is the highest or lowest is that in every world.

    Raises:
        InputError: names a world where it is not.
    """
    tied = scene.string[string]
    turns = parameters["initial_turns"][:, tied.balloon]
    if not isinstance(tied.particle, str) or not turns.any():
        return
    sign = 1.0 if tied.particle == "highest" else -1.0
    used = shape.mesh.points[np.unique(shape.mesh.face_vertex_indices)] - shape.mesh.points[held]
    slack = ALIKE * float(np.ptp(used, axis=0).max())
    for world, turn in enumerate(turns):
        if (used @ ((turn + np.eye(3)).T @ np.array(scene.up)) * sign).max() > slack:
            raise InputError(
                f"balloon.{tied.balloon}.rotation: in world {world} string {string} would hold another particle, which "
                f"is the {tied.particle} there; expected string.{string}.particle as a number, {held} for the scene's "
                "own"
            )


def _turns(scene: Scene, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """See `resolve_starts`; rotations about x, y and z [degrees], shape (W, balloon_count, 3)."""
    turns = np.zeros((*rotations.shape[:2], 3, 3))
    for number, balloon in enumerate(scene.balloon):
        own = rotation_matrix(balloon.rotation)
        for world in np.flatnonzero((rotations[:, number] != balloon.rotation).any(axis=1)).tolist():
            turns[world, number] = rotation_matrix(rotations[world, number]) @ own.T - np.eye(3)
    return turns


LEAST = 1.0
"""Pressure of water that is worth a sentence [Pa]"""
PERCENT = 0.01
"""Part of it, beyond what a skin bears, that is worth a sentence"""
ROUNDING = 1.0e-6
"""Volume over the cube of the size that may be rounding's, as that of flat foil"""


def inside_volume(shape: BalloonShape) -> float:
    """Return a mesh's volume that may be used up [m^3]; `NO_INSIDE` if it is open, or has its inner side outside."""
    volume = signed_volume(shape.skin) if shape.encloses else NO_INSIDE
    size = float(np.ptp(shape.mesh.points, axis=0).max())
    return max(volume, 0.0) if volume > -ROUNDING * size**3 else NO_INSIDE


def may_be_crushed(scene: Scene, shapes: Sequence[BalloonShape], pressures: Sequence[NDArray[np.floating]]) -> bool:
    """Return whether a balloon of a given pressure may lose its volume: in water, or by a pressure below the air's.

    Args:
        pressures: at keyframes [Pa]: at the start, shape (W, balloon_count, keyframe_count), and what they change to.
    """
    if scene.solver == "projective":
        return False
    of_pressure = [number for number, balloon in enumerate(scene.balloon) if balloon.inflation.kind == "pressure"]
    start, *changed = pressures
    if scene.water is None and not any((values < 0.0).any() for values in (start[:, of_pressure], *changed)):
        return False
    return any(inside_volume(shapes[number]) != NO_INSIDE for number in of_pressure)


def starts_pressed(balloon: Balloon, shape: BalloonShape, scene: Scene) -> bool:
    """Return whether a balloon is pressed inward as it starts: under water, or by a pressure below the air's."""
    if balloon.inflation.kind == "normal_force" or not shape.encloses:
        return False
    if scene.water is not None and float((shape.mesh.points @ np.array(scene.up)).mean()) < scene.water.level:
        return True
    given = balloon.inflation.kind == "pressure" and not balloon.inflation.is_automatic
    return given and any(value < 0.0 for _, value in balloon.inflation.keyframes)


def water_pressures(
    scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters, number: int
) -> NDArray[np.float64]:
    """Return the pressure of the water on a balloon as it starts [Pa], shape (W, 3): on top, in the middle and below.

    0 above the water, and without any.
    """
    if scene.water is None:
        return np.zeros((1, 3))
    heights = start_of(scene, parameters, number, shapes[number].mesh.points) @ np.array(scene.up)
    places = np.stack([heights.max(axis=1), heights.mean(axis=1), heights.min(axis=1)], axis=1)
    level, density, gravity = (parameters[name][:, None] for name in ("water_level", "water_density", "gravity"))
    return np.maximum(density * gravity * (level - places), 0.0)


def step_while_crushed(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> float:
    """Return the longest step [s] in which the turning of skins is stable under inward pressures at the start.

    It is that of the bound of a gas's pressure, see `model.max_pressure`. Of a gas, what water presses harder below
    than above counts alone: the rest makes it smaller, which is stable at any step.
    """
    steps = [np.inf]
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        if balloon.inflation.kind == "normal_force" or not shape.encloses:
            continue
        top, _, below = water_pressures(scene, shapes, parameters, number).T
        inward = below - top
        if balloon.inflation.kind == "pressure":
            inward = below - parameters["keyframe_values"][:, number].min(axis=1)
        hardest = float(np.max(np.maximum(inward, 0.0) / parameters["mass"][:, number]))
        if hardest > 0.0:
            steps.append(float(np.sqrt(shape.pressure_bound / hardest)))
    return min(steps)


def crushed_starts(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[str]:
    """Return a sentence for each balloon that water presses harder at the start than it presses back, in any world."""
    found = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        kind = balloon.inflation.kind
        if scene.water is None or kind == "normal_force" or not shape.encloses:
            continue
        outside = water_pressures(scene, shapes, parameters, number)[:, 1]
        inside = parameters["initial_pressures"][:, number]
        if kind == "pressure":
            inside = parameters["keyframe_values"][:, number].max(axis=1)
        outside, inside, evened = np.broadcast_arrays(outside, inside, parameters[EVENED.name][:, number])
        world = int(np.argmax(outside - inside))
        if outside[world] > max(inside[world], LEAST):
            follows = "its gas shrinks until it presses as hard" if kind == "gas" else "it is crushed flat"
            if evened[world] >= PERCENT:
                percent = 100.0 * (1.0 - evened[world])
                follows += (
                    f"; its skin bears {percent:.0f} % of how much harder water presses below than above, and the rest "
                    "lifts it as a whole (inflation.water_evened)"
                )
            found.append(
                f"{shape.name}: water presses on it with {_told(outside[world])} where it starts, and it presses back "
                f"with {_told(inside[world])}: {follows}"
            )
    return found


def _told(pressure: float) -> str:
    """Return a pressure [Pa] in words."""
    return f"{pressure / 1000.0:.3g} kPa" if abs(pressure) >= 1000.0 else f"{pressure:.3g} Pa"


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
