"""Parameters that follow from others: the largest stable step, and film soft enough for it.

The largest stable step of symplectic Euler follows from the laws' own bounds. Where only particles touch spheres, a
small sphere passes between them, and a fast one may jump over them: tunneling.

Real film hardly stretches, and its modulus makes short steps: a letter of foil takes thousands in a frame, by which
nothing changes that one sees. Ten times as soft in frequency it takes a tenth of them.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import ceil
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.membrane import SHEAR_MODULUS
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    corner_faces,
    face_vector_areas,
    mesh_edges,
    next_corners,
    signed_volume,
    total_area,
    vertex_areas,
)
from balloon_warp.model.materials import NAMES as MEMBRANE_NAMES
from balloon_warp.model.materials import Bound, Bounds, names_of_bounds, resolve_masses
from balloon_warp.model.obstacles import BodyShape, largest_inverse_mass, resolve_friction
from balloon_warp.model.parameters import KEYFRAME_VALUES, DueChange, Parameters
from balloon_warp.model.shape import BalloonShape, Surroundings, surroundings_of
from balloon_warp.model.spectrum import highest_squared_frequency
from balloon_warp.model.starts import step_while_crushed
from balloon_warp.model.touch import bound_of_touch, resolve_touch
from balloon_warp.scene import Scene


def update_dependents(scene: Scene, shapes: Sequence[BalloonShape], now: Parameters, then: Parameters) -> None:
    """Set in `then` the parameters that follow from values that differ from those in `now`.

    These are masses of rubber and film, the contact stiffness of balloons, and coefficients of friction. One that has
    been written over stays so while those that it follows from stay.
    """
    for settle in (
        lambda values: {"mass": resolve_masses(scene, shapes, values)},
        lambda values: resolve_touch(scene, shapes, values),
        resolve_friction,
    ):
        before, after = settle(now), settle(then)
        then.update({name: values for name, values in after.items() if not np.array_equal(values, before[name])})


MOST_STRETCH = 2.0
"""Stretch of faces that is allowed for: their size is known at rest, and not when inflated"""


def warnings_of(
    scene: Scene, shapes: Sequence[BalloonShape], radii: NDArray[np.floating], step_seconds: float
) -> list[str]:
    """Return warnings of the meshes and of `passing_spheres`, which are given before a run."""
    of_shapes = [warning for shape in shapes for warning in shape.warnings]
    return of_shapes + passing_spheres(scene, shapes, radii, step_seconds)


def passing_spheres(
    scene: Scene, shapes: Sequence[BalloonShape], radii: NDArray[np.floating], step_seconds: float
) -> list[str]:
    """Return a sentence for each sphere that may pass through the faces of a balloon, or jump over its particles.

    Args:
        radii: of the spheres at the start [m], shape (W, sphere_count); 0 before it appears.
        step_seconds: a substep [s].
    """
    if not scene.sphere or (scene.touch and scene.touch.spheres):
        return []
    sentences = []
    widest = max(shapes, key=lambda shape: widest_opening(shape.mesh))
    opening = widest_opening(widest.mesh)
    for number, sphere in enumerate(scene.sphere):
        there = radii[:, number][radii[:, number] > 0.0]
        radius = float(there.min()) if len(there) else sphere.radius
        if scene.touches_spheres and radius < held_within(scene) * opening:
            continue  # it meets them
        if radius < MOST_STRETCH * opening:
            sentences.append(_fits_through(number, radius, opening, widest))
        way = step_seconds * _highest_speed(scene, number, shapes)
        if scene.contact == "penalty" and way > radius:
            sentences.append(
                f"sphere {number}: may move {way:.2g} m in a substep, more than its radius of {radius:.2g} m, and so "
                'tunnel through a balloon; more substeps or contact = "impulse" help'
            )
    return sentences


def held_within(scene: Scene) -> float:
    """Return the multiple of faces' openings up to which spheres touch faces, not only particles.

    Openings are those at rest, or where the scene asks for it, stretched.
    """
    return 1.0 if scene.faces == "auto" and not scene.touch else MOST_STRETCH


def _fits_through(number: int, radius: float, opening: float, shape: BalloonShape) -> str:
    stretch = radius / opening
    where = "even at rest" if stretch <= 1.0 else f"at a stretch of {stretch:.2g}"
    return (
        f"sphere {number}: its radius of {radius:.2g} m fits through faces of {shape.name}, {where}, since only "
        f"particles touch it and the longest edge is {_longest_edge(shape.mesh):.2g} m at rest; faces = true, a larger "
        "sphere or a finer mesh helps"
    )


def widest_opening(mesh: PolygonMesh) -> float:
    """Return the radius of the largest sphere that passes between the corners of a face, through its center [m].

    It is 0.58 of the edge of a triangle, 0.71 of a square's.
    """
    faces, corners = corner_faces(mesh), mesh.points[mesh.face_vertex_indices]
    sums = np.stack([np.bincount(faces, corners[:, axis], mesh.face_count) for axis in range(3)], axis=1)
    distances = np.linalg.norm(corners - (sums / mesh.face_vertex_counts[:, None])[faces], axis=1)
    nearest = np.full(mesh.face_count, np.inf)
    np.minimum.at(nearest, faces, distances)
    return float(nearest.max())


def _longest_edge(mesh: PolygonMesh) -> float:
    corners = mesh.points[mesh.face_vertex_indices]
    return float(np.linalg.norm(corners[next_corners(mesh)] - corners, axis=1).max())


def _highest_speed(scene: Scene, number: int, shapes: Sequence[BalloonShape]) -> float:
    """Return the speed of a sphere after a fall from its start to the height of the lowest particle [m/s]."""
    sphere, up = scene.sphere[number], np.array(scene.up)
    lowest = min(float((shape.mesh.points @ up).min()) for shape in shapes)
    fall = max(float(np.dot(sphere.position, up)) - lowest, 0.0)
    return float(np.sqrt(np.dot(sphere.velocity, sphere.velocity) + 2.0 * max(scene.gravity, 0.0) * fall))


AUTO_MARGIN = 0.8
"""Fraction of the stable step that `substeps = "auto"` takes"""
TOUCH_MARGIN = 0.97
"""Fraction of the stable step that "auto" takes where balloons may touch but the scene has no [touch], or softly touch
themselves, if that is less: the bound of contacts counts the largest number that may ever press on a particle, each at
its stiffest"""
PROJECTIVE_STEP = 1.0 / 120.0
"""Step of "auto" where stability requires none [s]: at 1/60 s the bundled scenes lag twice as far behind the explicit
ones"""
PROJECTIVE_STEP_WITH_SPHERES = 1.0 / 240.0
"""Step of "auto" with spheres, where stability requires none [s]; with longer ones, a sphere is deep in a balloon
before it is pushed, and then flies off"""
MOST_SUBSTEPS = 100_000
"""Largest number of substeps in a frame; a scene with more is a mistake"""


@dataclass(frozen=True)
class Network:
    """Network of springs and masses, on which the stable step depends besides the parameters.

    An undamped network is stable for h < 2 / omega_max. By Gershgorin's theorem omega_max^2 is at most twice the
    largest sum, at a particle over its mass, of spring constants: of the laws' bounds by the place. It is also at most
    the largest eigenvalue of the springs' Laplacian, see `spectrum`, which is 1.4 to 1.75 times lower in meshes of
    quads; of worlds that differ, with the largest bound of each kind over all of them. The lower of both counts.

    Drag and viscosity at the rate g [1/s], taken at the velocity before the step, shrink the bound to the root of
    omega^2 h^2 + 2 g h = 4; g is twice the largest such sum of the bounds by the velocity. A balloon's damping and the
    drag in water, taken at that after it, do not: see `phases.motion.move` and `phases.motion.resist`.

    A string between a particle and a free body is a pair, too. The body's sum is of the strings' bounds times
    the largest speed that an impulse of 1 N s gives its point there; twice that bounds omega^2.

    Forward Euler's bound is what all damping makes up for, h < g / omega^2, if that is less: 0 without damping.
    """

    shapes: Sequence[BalloonShape]
    held: Sequence[int]
    """Particle that each string of the scene holds, numbered within its balloon"""
    laws: Sequence[Law]
    """Laws, including the scene's; those without bounds do not count"""
    bodies: Sequence[BodyShape] = ()
    """Free bodies, to which strings may be tied"""

    def stable_step(
        self, scene: Scene, parameters: Parameters, velocities: Sequence[NDArray[np.float64]] | None = None
    ) -> float:
        """Return a step [s] that is stable for every balloon in every world, and for bodies that are tied to them.

        Args:
            parameters: of all worlds.
            velocities: of each balloon's particles [m/s]; at rest, when missing.
        """
        steps = list(self._steps_of_ties(scene, parameters).values())
        for number in range(len(self.shapes)):
            bounds = self._bounds(scene, number, parameters)
            around = self._around(scene, number, bounds, None if velocities is None else velocities[number])
            different = around.different()
            masses = parameters["mass"][:, number]
            rates = 2.0 * bounds.largest("drag", different) / masses
            step = float(np.min(_steps(scene, masses, rates, parameters["damping"][:, number], bounds, different)))
            if scene.solver != "forward_euler":
                rate = float(np.max(rates))
                step = max(step, self._step_of_spectrum(self.shapes[number], masses, bounds, around, rate))
            steps.append(step)
        return min(steps)

    def auto_step(
        self,
        scene: Scene,
        parameters: Parameters,
        velocities: Sequence[NDArray[np.float64]] | None,
        stable: float,
    ) -> float:
        """Return the longest step that `substeps = "auto"` may take [s].

        Args:
            parameters: as of `stable_step`.
            velocities: as of `stable_step`.
            stable: the step that this returned [s].
        """
        pressed = step_while_crushed(scene, self.shapes, parameters)
        if (scene.touch and not scene.touches_softly) or not scene.touches:
            return min(AUTO_MARGIN * stable, pressed)
        apart = self.stable_step(scene.model_copy(update={"touch": False}), parameters, velocities)
        return min(AUTO_MARGIN * apart, TOUCH_MARGIN * stable, pressed)

    def _steps_of_ties(self, scene: Scene, parameters: Parameters) -> dict[int, float]:
        """Return the stable step of each free body to which strings are tied, by these [s]."""
        steps = {}
        for body in {string.body for string in scene.string if string.body is not None}:
            sums: dict[Bound, Any] = {"stiffness": 0.0, "drag": 0.0}
            for number in range(len(self.shapes)):
                held = [place for place, string in enumerate(scene.string) if string.balloon == number]
                tied = [at for at, place in enumerate(held) if scene.string[place].body == body]
                arms = parameters["string_anchor"][:, [held[at] for at in tied]] - self.bodies[body].center
                inverse_mass = largest_inverse_mass(self.bodies[body], arms) / parameters["body_mass"][:, body, None]
                for bound in sums:
                    each = Bounds(scene, self.laws, number, parameters).of_strings(bound)[:, tied]
                    sums[bound] = sums[bound] + 2.0 * (each * inverse_mass).sum(axis=1)
            steps[body] = float(np.min(_step(np.maximum(sums["stiffness"], 1.0e-12), sums["drag"])))
        return steps

    def _step_of_spectrum(
        self, shape: BalloonShape, masses: NDArray[np.float64], bounds: Bounds, around: Surroundings, rate: float
    ) -> float:
        """Return the stable step of one balloon in all its worlds [s].

        It follows from its highest frequency and the largest damping rate.
        """
        stiffest = bounds.stiffest(around, masses)
        of_kind = stiffest.springs[shape.springs.kind]
        held = np.zeros(len(shape.mass_share))
        held[shape.mass_share > 0.0] = stiffest.held
        pairs, between = shape.membrane.laplacian
        constants = of_kind[:, 0] + of_kind[:, 1] * shape.stiffness_scale, stiffest.membrane * between
        squared_frequency = highest_squared_frequency(
            np.concatenate([shape.springs.pairs, pairs]), np.concatenate(constants), held, shape.mass_share
        )
        return float(_step(max(squared_frequency, 1.0e-12), rate))

    def limiting_particle(self, scene: Scene, parameters: Parameters) -> tuple[int, int]:
        """Return the balloon with the shortest stable step in the first world, and its limiting particle.

        The particle, numbered within the balloon, is the one whose springs are the stiffest for its mass.
        """
        limits = []
        for number, shape in enumerate(self.shapes):
            bounds = self._bounds(scene, number, parameters)
            around = self._around(scene, number, bounds)
            if around.particle_count:
                masses = parameters["mass"][:, number]
                rates = 2.0 * bounds.largest("drag", around) / masses
                step = float(_steps(scene, masses, rates, parameters["damping"][:, number], bounds, around)[0])
                stiffest = (bounds.sums("stiffness", around, slice(1))[0] / around.mass_share).argmax()
                limits.append((step, number, int(np.flatnonzero(shape.mass_share)[stiffest])))
        return min(limits, default=(np.inf, 0, 0))[1:]

    def limiting_body(self, scene: Scene, parameters: Parameters) -> int | None:
        """Return the free body that needs the stable step by the strings that are tied to it, if one does."""
        stable = self.stable_step(scene, parameters)
        return next((body for body, step in self._steps_of_ties(scene, parameters).items() if step == stable), None)

    def _bounds(self, scene: Scene, number: int, parameters: Parameters) -> Bounds:
        touch = bound_of_touch(scene, self.shapes, number, parameters)
        return Bounds(scene, self.laws, number, parameters, touch)

    def _around(
        self, scene: Scene, number: int, bounds: Bounds, velocities: NDArray[np.float64] | None = None
    ) -> Surroundings:
        strings = zip(scene.string, self.held, strict=True)
        held = [particle for string, particle in strings if string.balloon == number]
        return surroundings_of(self.shapes[number], held, bounds.has_hinges, velocities)


def names_of_the_step(scene: Scene, laws: Sequence[Law]) -> set[str]:
    """Return the parameters that the stable step depends on, and those that the bounds of these laws ask for."""
    tied = any(string.body is not None for string in scene.string)
    return (
        {*(row.name for row in KINDS), "string_stiffness", "mass", "damping", "touch_stiffness", "water_level"}
        | ({"string_anchor", "body_mass"} if tied else set())
        | names_of_bounds(laws)
        | MEMBRANE_NAMES
    )


def _steps(
    scene: Scene,
    masses: NDArray[np.float64],
    rates: NDArray[np.float64],
    damping: NDArray[np.float64],
    bounds: Bounds,
    around: Surroundings,
) -> NDArray[np.float64]:
    """Return the stable step [s] of one balloon, shape (W,).

    Args:
        masses: [kg], shape (W,) or (1,).
        rates: of drag and viscosity [1/s], shape (W,) or (1,).
        damping: of the balloon [N s/m], shape (W,) or (1,).
    """
    squared_frequencies = np.maximum(2.0 * bounds.largest("stiffness", around) / masses, 1.0e-12)
    steps = _step(squared_frequencies, rates)
    if scene.solver != "forward_euler":
        return steps
    return np.minimum(steps, (rates + damping / masses) / squared_frequencies)


def _step(squared_frequency: Any, rate: Any) -> Any:
    """Return the root h of omega^2 h^2 + 2 g h = 4."""
    return 4.0 / (np.sqrt(rate**2 + 4.0 * squared_frequency) + rate)


def choose_substeps(scene: Scene, stable: float, auto_step: float) -> int:
    """Return the number of substeps in a frame: the scene's if stable, or as many as the step of "auto" requires [s].

    With forward Euler the scene may have any number, since its instability is the point; with projective, too, since it
    is always stable.

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
            "substeps: forward Euler without damping gains energy at every step, however small; expected damping, or a "
            "fixed number of substeps"
        )
    if not frame_seconds <= MOST_SUBSTEPS * auto_step:
        raise InputError(
            f"substeps: these springs, masses and damping are stable up to a step of {stable:.2e} s, which needs more "
            f"than {MOST_SUBSTEPS:,} in a frame; expected softer springs, more mass or more frames per second"
        )
    if scene.substeps == "auto":
        return max(ceil(frame_seconds / auto_step), 1)
    if frame_seconds / scene.substeps > stable:
        raise InputError(
            f"substeps: {scene.substeps} are too few for these springs and masses, which are stable up to a step of "
            f'{stable:.2e} s: at least {ceil(frame_seconds / stable)} are needed, or "auto"'
        )
    return scene.substeps


def _accurate_substeps(scene: Scene, frame_seconds: float) -> int:
    longest = PROJECTIVE_STEP_WITH_SPHERES if scene.sphere else PROJECTIVE_STEP
    return max(ceil(frame_seconds / longest - 1.0e-6), 1)


Values = NDArray[np.float64]
YOUNG = 3.0
"""Young's modulus of an incompressible material over its shear modulus"""
FLAT = 0.02
"""Volume over area^(3/2) below which a mesh counts as flat: 0.094 for a sphere"""
RIM = -0.7
"""Cosine between the normals of two faces at an edge below which a flat sheet is sewn, or folded, there"""
FILLED = 1.22
"""Volume of a flat sheet once it is inflated, over the integral of the distance from the rim over one of its sides:
within 5% of 4 / pi for a strip, which becomes a cylinder, and of 1.16 for a disc, the mylar balloon (Paulsen 1994)"""
CUT = 1.3
"""Part by which softer film is cut smaller, over the bound on its strain: without, volumes grow by 0.9 to 2.4 times
three bounds, those of an I and of an &"""
FILL_TO_PRESSURE = "fill_to_pressure"
"""Name of the pressure at which a gas is filled in no further"""
OVER = 1.05
"""Mean strain over its bound from which on a run says so"""


@dataclass(frozen=True)
class BoundedFilm:
    """Film of a balloon whose modulus is lower than the material's, in the first world."""

    number: int
    """Index of the balloon in the scene"""
    balloon: str
    """Name of the balloon"""
    material: str
    """Name of the preset; "film" without one"""
    strain_bound: float
    """Mean strain at the planned pressure [1]"""
    pressure: float
    """Largest pressure that the scene plans [Pa]"""
    modulus: float
    """Young's modulus [Pa]"""
    exact_modulus: float
    """Young's modulus of the material [Pa]"""


@dataclass(frozen=True)
class StrainBound:
    """Films with a modulus of a bound on their strain, and the substeps with and without it."""

    films: tuple[BoundedFilm, ...]
    substeps: int
    """Number of substeps of a frame"""
    exact_substeps: int | None
    """Number of substeps that the materials' own moduli need; None where the scene says how many there are"""

    def __str__(self) -> str:
        most = max(self.films, key=lambda film: film.modulus)
        others = len(self.films) - 1
        alike = f" (and {others} more like it)" if others else ""
        moduli = f"modulus {_in_units(most.modulus)} instead of {_in_units(most.exact_modulus)}"
        spared = f", {self.substeps:,} substeps instead of {self.exact_substeps:,}" if self.exact_substeps else ""
        stretch = f"stretches by at most {100.0 * most.strain_bound:.2g}% on average at {most.pressure:.4g} Pa"
        return f"{most.material}{alike}: {stretch}: {moduli}{spared}"


def bounded_moduli(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    parameters: Parameters,
    changes: Sequence[DueChange],
    varied: Collection[str] = (),
    films: Mapping[int, float] | None = None,
) -> Values:
    """Return shear moduli of all balloons [Pa], shape (W, balloon_count), of film no higher than its bound asks for.

    By the virial theorem the sum of both principal stresses is 3 p V over the volume of the film itself, on average
    over the film, whatever its shape and its wrinkles. No principal strain exceeds that sum over E. So it is the bound
    on average where E = 3 p V / (A h bound), or p R / (2 h bound) with a radius R = 6 V / A: twice that of a sphere.
    The stress by which a film bears its own weight, hung by an end, is added.

    Args:
        varied: paths of values that differ between worlds: a modulus among them stays, unless a bound is asked for.
        films: Moduli of film that was planned already [Pa], by number of the balloon.

    Raises:
        InputError: a bound is asked for where no pressure is planned, or the balloon has no inside.
    """
    moduli = parameters[SHEAR_MODULUS.name]
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        bound = balloon.material.bound_on_strain
        told = balloon.material.strain_bound is None and any(path.endswith(SHEAR_MODULUS.path) for path in varied)
        if films and number in films:
            moduli = moduli.copy()
            moduli[:, number] = films[number]
            continue
        if bound is None or told or not _has_plan(scene, shape, parameters, number):
            continue
        pressure = _planned_pressure(scene, parameters, changes, number)
        film = parameters["thickness"][:, number] * shape.membrane.areas.sum()
        stress = 3.0 * pressure * inflated_volume(shape) / film + _stress_of_weight(scene, shape, parameters, number)
        least = stress / (YOUNG * bound)
        own = np.where(pressure > 0.0, np.minimum(moduli[:, number], least), moduli[:, number])
        moduli = np.broadcast_to(moduli, (max(len(moduli), len(own)), moduli.shape[1])).copy()
        moduli[:, number] = own
    return moduli


def cut_to_size(
    scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters, exact: Values
) -> list[BalloonShape]:
    """Return shapes in which softer film is smaller, so that at the planned pressure it has the size of its own.

    Film that hardly stretches has a volume that grows by twice its energy over its pressure and volume, as it gets
    softer: by 3 strains, if all of it bears the same stress one way, and by more where stress gathers in lines.

    Args:
        exact: shear moduli as the scene says them [Pa].
    """
    cut = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        softer = 1.0 - float((parameters[SHEAR_MODULUS.name][:, number] / exact[:, number]).max())
        part, already = CUT * softer * (balloon.material.bound_on_strain or 0.0), shape.membrane.cut
        if part != already:
            center, scale = shape.mesh.points.mean(axis=0), (1.0 - part) / (1.0 - already)
            mesh = replace(shape.mesh, points=center + scale * (shape.mesh.points - center))
            shape = replace(shape, mesh=mesh, membrane=shape.membrane.cut_by(part))
        cut.append(shape)
    return cut


def bounded_films(
    scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters, exact: Values, changes: Sequence[DueChange]
) -> tuple[BoundedFilm, ...]:
    """Return the films of the first world that have less than their own modulus.

    Args:
        exact: shear moduli as the scene says them [Pa].
    """
    films = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        modulus, own = float(parameters[SHEAR_MODULUS.name][0, number]), float(exact[0, number])
        bound = balloon.material.bound_on_strain
        if bound is not None and modulus < own:
            pressure = float(_planned_pressure(scene, parameters, changes, number)[0])
            material = balloon.material.preset or "film"
            films.append(BoundedFilm(number, shape.name, material, bound, pressure, YOUNG * modulus, YOUNG * own))
    return tuple(films)


def inflated_volume(shape: BalloonShape) -> float:
    """Return about the volume of a balloon of film once it is inflated [m^3].

    That of its mesh; or, of a flat sheet sewn at its rim, by how far its inside is from there; or of a sheet that is
    folded up the most that its area can enclose, that of a sphere.
    """
    mesh, own = shape.mesh, (1.0 - shape.membrane.cut) ** -3  # the size that it has before it is cut
    area, volume = total_area(mesh), abs(signed_volume(mesh))
    if volume > FLAT * area**1.5:
        return own * volume
    rim = _rim(mesh)
    from balloon_warp.model.touch import is_stacked  # both load SciPy

    if not len(rim) or is_stacked(mesh):
        return float(shape.membrane.areas.sum() ** 1.5 / (6.0 * np.sqrt(np.pi)))
    from scipy.spatial import KDTree

    distances, _ = KDTree(mesh.points[rim]).query(mesh.points)
    return own * max(volume, FILLED * 0.5 * float(distances @ vertex_areas(mesh)))


def mean_strain(shape: BalloonShape, points: Values) -> float:
    """Return how much a film is stretched, the more stretched way, on average over it; slack film not at all [1].

    Args:
        points: of the balloon's particles [m], shape (particle_count, 3).
    """
    corners = points[shape.membrane.corners]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    inverse = shape.membrane.rests
    a, b, c = (np.einsum("ij,ij->i", *pair) for pair in ((first, first), (first, second), (second, second)))
    trace = inverse[:, 0] * a + 2.0 * inverse[:, 1] * b + inverse[:, 2] * c
    determinant = (a * c - b * b) * (inverse[:, 0] * inverse[:, 2] - inverse[:, 1] ** 2)
    half = 0.5 * trace
    larger = np.sqrt(half + np.sqrt(np.maximum(half * half - determinant, 0.0)))
    return float(np.average(np.maximum(larger - 1.0, 0.0), weights=shape.membrane.areas))


class HasFilm(Protocol):
    """A plan, or a model, whose film may have a bound."""

    @property
    def strain_bound(self) -> StrainBound | None:
        """Films that have less than their own modulus, if there are any."""
        ...

    @property
    def shapes(self) -> list[BalloonShape]:
        """Shapes of the balloons."""
        ...


def strain_bound_sentence(plan: HasFilm) -> str | None:
    """Return a sentence on film that is softer than its material; None without such film."""
    return str(plan.strain_bound) if plan.strain_bound else None


def strain_bound_described(plan: HasFilm) -> dict[str, dict[str, Any]]:
    """Return a table for each film that is softer than its material, by its balloon, as JSON and stages have them."""
    films = plan.strain_bound.films if plan.strain_bound else ()
    return {
        f"balloon.{film.number}": {name: value for name, value in asdict(film).items() if name != "number"}
        for film in films
    }


def overstretched_films(plan: HasFilm, points: Sequence[NDArray[np.floating]]) -> list[str]:
    """Return a sentence for each film that is stretched beyond its bound, and by how much.

    Args:
        points: of each balloon's particles [m], shape (particle_count, 3).
    """
    said = []
    for film in plan.strain_bound.films if plan.strain_bound else ():
        strain = mean_strain(plan.shapes[film.number], points[film.number].astype(np.float64))
        if strain > OVER * film.strain_bound:
            said.append(
                f"{film.balloon}: is stretched by {100.0 * strain:.2g}% on average, and not at most by "
                f"{100.0 * film.strain_bound:.2g}%, since more than the planned {film.pressure:.4g} Pa pulls it; "
                "material.exact = true, or a smaller strain_bound, helps"
            )
    return said


def _has_plan(scene: Scene, shape: BalloonShape, parameters: Parameters, number: int) -> bool:
    """Return whether a scene plans the pressure within a balloon.

    Raises:
        InputError: it does not, and asks for a bound.
    """
    balloon = scene.balloon[number]
    kind = balloon.inflation.kind
    lacks = ""
    if kind == "gas" and not (_ends_filling(scene, parameters, number) > 0.0).all():
        lacks = 'a planned pressure (got inflation.kind = "gas" without fill_to_pressure and pump_curve)'
    elif kind == "normal_force":
        lacks = f'a planned pressure (got inflation.kind = "{kind}")'
    if not shape.encloses:
        lacks = "a closed balloon (got an open mesh)"
    if lacks and balloon.material.strain_bound is not None:
        raise InputError(f"balloon.{number}.material.strain_bound: needs {lacks}; expected none, or exact = true")
    return not lacks


def _stress_of_weight(scene: Scene, shape: BalloonShape, parameters: Parameters, number: int) -> Values:
    """Return the stress of a film that hangs by its highest end [Pa], shape (W,)."""
    height = float(np.ptp(shape.mesh.points @ np.asarray(scene.up))) / (1.0 - shape.membrane.cut)
    return parameters["initial_density"][:, number] * abs(scene.gravity) * height


def _planned_pressure(scene: Scene, parameters: Parameters, changes: Sequence[DueChange], number: int) -> Values:
    """Return the largest pressure at any keyframe, or up to which gas is filled in, at any time [Pa], shape (W,)."""
    of_gas = scene.balloon[number].inflation.kind == "gas"
    name = FILL_TO_PRESSURE if of_gas else KEYFRAME_VALUES.name
    most = _ends_filling(scene, parameters, number) if of_gas else parameters[name][:, number].max(axis=-1)
    for change in changes:
        if name in change.values:
            which, values = change.values[name]
            most = np.maximum(most, np.where(which[number], values[number], -np.inf).max())
    return most


def _ends_filling(scene: Scene, parameters: Parameters, number: int) -> Values:
    """Return the pressure at which no more gas is filled in, 0 where there is none [Pa], shape (W,)."""
    curve = scene.balloon[number].inflation.pump_curve
    said = parameters[FILL_TO_PRESSURE][:, number]
    return np.where(said > 0.0, said, curve[-1][0] if curve else 0.0)


def _rim(mesh: PolygonMesh) -> NDArray[np.integer]:
    """Return the vertices at edges where two faces lie on each other."""
    edges = mesh_edges(mesh)
    first = edges.starts[edges.face_counts == 2]
    faces = corner_faces(mesh)[edges.corners]
    areas = face_vector_areas(mesh)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), np.finfo(float).tiny)
    folded = np.einsum("ij,ij->i", normals[faces[first]], normals[faces[first + 1]]) < RIM
    return np.unique(edges.ends[edges.face_counts == 2][folded])


def _in_units(pascals: float) -> str:
    """Return a modulus in two digits, with its unit."""
    for unit, size in (("GPa", 1.0e9), ("MPa", 1.0e6), ("kPa", 1.0e3)):
        if pascals >= size:
            return f"{float(f'{pascals / size:.2g}'):g} {unit}"
    return f"{pascals:.2g} Pa"
