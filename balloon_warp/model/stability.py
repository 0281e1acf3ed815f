"""The largest step at which symplectic Euler stays stable on a spring network."""

from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.corners import corner_faces
from balloon_warp.mesh.geometry import face_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.model.air import air_density
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

AUTO_MARGIN = 0.8
"""the part of the stable step that `substeps = "auto"` takes"""
PROJECTIVE_STEP = 1.0 / 120.0
"""the step [s] that "auto" takes where stability does not ask for any: at 1/60 s the bundled scenes lag twice as far
behind the explicit ones"""
PROJECTIVE_STEP_WITH_SPHERES = 1.0 / 240.0
"""as above [s]; with longer ones, a sphere is deep in a balloon before it is pushed, and then flies off"""
MOST_SUBSTEPS = 100_000
"""in a frame; a scene that asks for more is a mistake"""
_CHUNK = 10_000_000
"""loads looked at together, to bound the memory"""


def stable_step(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    held: Sequence[int],
    parameters: Parameters,
    air_speed: ArrayLike | None = None,
) -> float:
    """A step [s] that is stable for every balloon in every world.

    An undamped network is stable for h < 2 / omega_max, and by Gershgorin's theorem omega_max^2 is at most twice the
    largest sum of spring constants at a particle over its mass. Damping at the rate g [1/s], taken explicitly as the
    listing does, shrinks the bound to the root of omega^2 h^2 + 2 g h = 4. Water acts on each particle as a spring of
    the constant density gravity A, A its share of the balloon's area, which may grow: it is counted twice. Viscous
    springs, whose damping constants are t times their spring constants, add t omega^2 to the rate. Drag in air, a force
    1/2 density C_d A u^2, adds its derivative over the mass, density C_d A u / m, with the areas counted twice again.

    Forward Euler's bound is what the damping makes up for, h < g / omega^2, if that is less: 0 without damping.

    Args:
        held: the particle that each string of the scene holds, numbered within its balloon.
        parameters: of all worlds.
        air_speed: at which the fastest particle moves through the air [m/s]; the wind's, when missing, as at rest.
    """
    steps = []
    speed = _wind_speed(parameters) if air_speed is None else np.asarray(air_speed)
    for number, shape in enumerate(shapes):
        constants, particles = _constants(number, scene, held, parameters)
        peak = _peak_sums(constants, np.unique(_unit_sums(shape, particles, bool(parameters["torsion"].any())), axis=0))
        drag = _drag_rate(shape, number, speed, parameters)
        steps.append(float(np.min(_steps(peak, number, scene, parameters, drag))))
    return min(steps)


def limiting_particle(
    scene: Scene, shapes: Sequence[BalloonShape], held: Sequence[int], parameters: Parameters
) -> tuple[int, int]:
    """The balloon whose stable step is the shortest in the first world, and the particle of it, numbered within it,
    whose springs are the stiffest for its mass. Arguments as for `stable_step`."""
    limits = []
    for number, shape in enumerate(shapes):
        constants, particles = _constants(number, scene, held, parameters)
        sums = _unit_sums(shape, particles, bool(parameters["torsion"].any())) @ constants[0]
        if len(sums):
            drag = _drag_rate(shape, number, _wind_speed(parameters), parameters)
            step = float(_steps(sums.max(), number, scene, parameters, drag)[0])
            limits.append((step, number, int(np.flatnonzero(shape.mass_share)[sums.argmax()])))
    return min(limits, default=(np.inf, 0, 0))[1:]


def choose_substeps(scene: Scene, stable: float) -> int:
    """Substeps in a frame: as the scene says, or as many as the stable step [s] asks. With forward Euler the scene may
    say what it likes, since what it shows is its instability; with projective, too, since it is always stable.

    Raises:
        InputError: the scene asks for fewer than are stable.
    """
    frame_seconds = 1.0 / scene.frames_per_second
    if scene.solver == "projective":
        return _accurate_substeps(scene, frame_seconds) if scene.substeps == "auto" else scene.substeps
    if scene.solver == "forward_euler" and scene.substeps != "auto":
        return scene.substeps  # to see how it gains energy
    if scene.solver == "forward_euler" and stable == 0.0:
        raise InputError(
            "substeps: forward Euler without damping gains energy at every step, however small; expected a number of "
            "substeps to watch it, or damping"
        )
    if not frame_seconds <= MOST_SUBSTEPS * AUTO_MARGIN * stable:
        raise InputError(
            f"substeps: these springs, masses and damping are stable up to a step of {stable:.2e} s, which makes more "
            f"than {MOST_SUBSTEPS:,} in a frame; expected softer springs, more mass or more frames per second"
        )
    if scene.substeps == "auto":
        return max(ceil(frame_seconds / (AUTO_MARGIN * stable)), 1)
    if frame_seconds / scene.substeps > stable:
        raise InputError(
            f"substeps: {scene.substeps} are too few for these springs and masses, which are stable up to a step of "
            f'{stable:.2e} s: at least {ceil(frame_seconds / stable)} are needed, or "auto"'
        )
    return scene.substeps


def _constants(
    number: int, scene: Scene, held: Sequence[int], parameters: Parameters
) -> tuple[NDArray[np.float64], list[int]]:
    """One balloon's constants of each kind of spring and of each of its strings [N/m], of torsion springs [N m/rad] and
    of the water [N/m^3], its weight, shape (W, 3 + strings + 2); and the particles that the strings hold."""
    strings = [n for n, string in enumerate(scene.string) if string.balloon == number]
    constants = _beside(
        parameters["stiffness"][:, number],
        parameters["string_stiffness"][:, strings],
        parameters["torsion"][:, number, None],
        (parameters["water_density"] * np.abs(parameters["gravity"]))[:, None],
    )
    return constants, [held[string] for string in strings]


def _wind_speed(parameters: Parameters) -> NDArray[np.float64]:
    """[m/s], shape (W,)."""
    return np.linalg.norm(parameters["wind"], axis=-1)


def _drag_rate(
    shape: BalloonShape, number: int, speed: NDArray[np.float64], parameters: Parameters
) -> NDArray[np.float64]:
    """By how much of itself drag lowers the speed [m/s] of one balloon's lightest particle for its area [1/s], shape
    (W,)."""
    moves = shape.mass_share > 0.0
    areas = _areas_around_particles(shape.mesh)[moves] / shape.mass_share[moves]
    pull = air_density(parameters) * parameters["drag_coefficient"][:, number]
    return 2.0 * areas.max(initial=0.0) * pull * speed / parameters["mass"][:, number]


def _steps(
    peak: ArrayLike, number: int, scene: Scene, parameters: Parameters, drag: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The stable step [s] of one balloon, shape (W,), from the largest sum of spring constants at a particle over its
    part of the mass, and the rate at which the air slows it down [1/s]."""
    mass, viscosity = parameters["mass"][:, number], parameters["viscosity"][:, number]
    squared_frequency = np.maximum(2.0 * np.asarray(peak) / mass, 1.0e-12)
    rate = parameters["damping"][:, number] / mass + viscosity * squared_frequency + drag
    steps = 4.0 / (np.sqrt(rate**2 + 4.0 * squared_frequency) + rate)
    return np.minimum(steps, rate / squared_frequency) if scene.solver == "forward_euler" else steps


def _accurate_substeps(scene: Scene, frame_seconds: float) -> int:
    longest = PROJECTIVE_STEP_WITH_SPHERES if scene.sphere else PROJECTIVE_STEP
    return max(ceil(frame_seconds / longest - 1.0e-6), 1)


def _unit_sums(shape: BalloonShape, held: Sequence[int], with_torsion: bool) -> NDArray[np.float64]:
    """The sum of spring constants at each particle that moves, over its part of the mass, for a constant of 1 of one
    kind of spring, of one string, of torsion springs, or of the water's weight: shape (moving particles, 3 + strings +
    2)."""
    particles, pairs = shape.mesh.vertex_count, shape.springs.pairs
    columns = []
    for kind in range(3):
        scale = np.where(shape.springs.kind == kind, shape.stiffness_scale, 0.0)
        columns.append(np.bincount(pairs[:, 0], scale, particles) + np.bincount(pairs[:, 1], scale, particles))
    for particle in held:
        columns.append(np.where(np.arange(particles) == particle, 0.5, 0.0))  # its other end is fixed
    columns.append(_torsion_around_particles(shape) if with_torsion else np.zeros(particles))
    columns.append(_areas_around_particles(shape.mesh))  # half of twice the area: the water's end is fixed, too
    moves = shape.mass_share > 0.0
    return np.stack(columns, axis=1)[moves] / shape.mass_share[moves, None]


def _torsion_around_particles(shape: BalloonShape) -> NDArray[np.float64]:
    """Half the row sums of the torsion springs' stiffness matrix at rest, for a constant of 1 N m/rad [N/m], shape
    (particle_count,): a hinge has k g_p g_q for particles p and q, where g is the gradient of its angle."""
    hinges = shape.hinges
    sizes = hinges.wing_sizes
    gradients = hinges.gradients(shape.mesh.points)
    rows = 0.5 * gradients * gradients.sum(axis=1, keepdims=True)
    sums = np.zeros(shape.mesh.vertex_count)
    np.add.at(sums, hinges.ends, rows[:, :2])
    np.add.at(sums, hinges.wing_particles, np.repeat((rows[:, 2:] / sizes).ravel(), sizes.ravel()))
    return sums


def _peak_sums(constants: NDArray[np.float64], unit_sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest sum over the particles, shape (worlds,)."""
    worlds_at_once = max(_CHUNK // max(len(unit_sums), 1), 1)
    chunks = np.split(constants, range(worlds_at_once, len(constants), worlds_at_once))
    return np.concatenate([np.max(chunk @ unit_sums.T, axis=1, initial=0.0) for chunk in chunks])


def _areas_around_particles(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Each particle's share of the areas of its faces [m^2], shape (particle_count,)."""
    shares = (face_areas(mesh) / mesh.face_vertex_counts)[corner_faces(mesh)]
    areas = np.zeros(mesh.vertex_count)
    np.add.at(areas, mesh.face_vertex_indices, shares)
    return areas


def _beside(*parts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Columns of all; one row in a part stands for all worlds."""
    worlds = max(len(part) for part in parts)
    return np.concatenate([np.broadcast_to(part, (worlds, part.shape[1])) for part in parts], axis=1)
