"""Laws defined by the tests, in a module that workers can import; and a batch in which each world has one law alone."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from meshes import mesh_of
from numpy.typing import NDArray

from balloon_warp import Parameter, face_law, particle_law, spring_law
from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.model import Model, lay_out, plan_model
from balloon_warp.model.plan import ModelPlan
from balloon_warp.model.stability import Network
from balloon_warp.scene import Balloon, Inflation, Scene, String, Water


@wp.func
def magnet(position: wp.vec3, mass: float, strength: float, pole: wp.vec3):
    """Return the force towards a pole, in proportion to mass and distance [N]."""
    return mass * strength * (pole - position)


@wp.func
def magnet_energy(position: wp.vec3, mass: float, strength: float, pole: wp.vec3):
    """Return the energy 1/2 mass strength distance^2 [J]."""
    return 0.5 * mass * strength * wp.length_sq(pole - position)


@wp.func
def hardening(squared_length: float, rest_length: float, stiffness: float, hardness: float):
    """Return the excess pull of a hardening spring over Hooke's [N/m]: its constant grows with the square of its strain
    e, up to (1 + hardness) times: F = k hardness L e^3 / (1 + e^2)."""
    length = wp.sqrt(squared_length)
    strain = length / rest_length - 1.0
    return stiffness * hardness * rest_length * strain * strain * strain / ((1.0 + strain * strain) * length)


@wp.func
def hardening_energy(squared_length: float, rest_length: float, stiffness: float, hardness: float):
    """Return the energy 1/2 k hardness L^2 (e^2 - log(1 + e^2)) [J]."""
    strain = wp.sqrt(squared_length) / rest_length - 1.0
    squared = strain * strain
    return 0.5 * stiffness * hardness * rest_length * rest_length * (squared - wp.log(1.0 + squared))


@wp.func
def gust(
    area_vector: wp.vec3, velocity: wp.vec3, time: float, gust_velocity: wp.vec3, gust_density: float,
    gust_seconds: float,
):  # fmt: skip
    """Return the force of a gust on a windward face [N]: 1/2 density u^2 of its area, u the approach speed."""
    strength = wp.sin(wp.pi * wp.min(time / gust_seconds, 1.0))
    flux = wp.min(wp.dot(strength * gust_velocity - velocity, area_vector), 0.0)
    return (-0.5 * gust_density * flux * flux / wp.max(wp.length_sq(area_vector), 1.0e-30)) * area_vector


def gust_bound(area: Any, velocity: Any, gust_velocity: Any, gust_density: Any) -> Any:
    """Return density A u [N s/m], the derivative of the force by u."""
    return gust_density * area * ((gust_velocity**2).sum(axis=-1) ** 0.5 + (velocity**2).sum(axis=-1) ** 0.5)


MAGNET = particle_law(
    magnet,
    (
        Parameter("strength", "1/s^2", 2.0, least=0.0, meaning="squared frequency about the pole"),
        Parameter("pole", "m", of="world", size=3),
    ),
    energy=magnet_energy,
    neutral={"strength": 0.0},
    stiffness=lambda mass, strength: mass * strength,
)
HARDENING = spring_law(
    hardening,
    (Parameter("hardness", "1", 0.0, least=0.0, most=10.0),),
    energy=hardening_energy,
    neutral={"hardness": 0.0},
    stiffness=lambda stiffness, hardness: 1.125 * stiffness * hardness,  # its steepest is at a strain of root 3
)
GUST = face_law(
    gust,
    (
        Parameter("gust_velocity", "m/s", of="world", size=3),
        Parameter("gust_density", "kg/m^3", 1.2, least=0.0, of="world", meaning="of the air"),
        Parameter("gust_seconds", "s", 1.0, least=1.0e-3, of="world", meaning="how long it lasts"),
    ),
    neutral={"gust_density": 0.0},
    drag=gust_bound,
)


@wp.func
def repelling(squared_length: float, rest_length: float, repulsion: float):
    """Return the repulsion of a spring's ends [N/m]: F = -c L^8 d / |d|^8, with a pole where they coincide."""
    ratio = rest_length * rest_length / squared_length
    squared = ratio * ratio
    return -repulsion * squared * squared


REPELLING = spring_law(
    repelling,
    (Parameter("repulsion", "N/m", 0.0, least=0.0),),
    neutral={"repulsion": 0.0},
    stiffness=lambda repulsion: 100.0 * repulsion,
)


OWN = (MAGNET, HARDENING, GUST)
TESTED: tuple[Law, ...] = (*LAWS, *OWN)
"""all laws that are listed, which are tested"""
NAMES = [law.name for law in TESTED]
AT_THE_END = ("damping", "water")
"""laws of whose drag a step takes the speed that it ends with, so that it needs no bound"""

BODY = {"structural": 0.0, "shear": 10.0, "flexion": 0.0, "string_stiffness": 20.0}
"""constants of the body's springs and strings, where a law is of such: each spring is the only one of its ends"""
LIQUID = {"water_level": 0.1 / 3.0, "water_density": 3.0}
"""in which a raft of 0.1 kg and 1 m^2 floats"""
OF_KIND = {"spring": ("structural", "shear", "flexion"), "string": ("string_stiffness",)}
"""constants of the body, without which laws of a kind do nothing"""


def value_of(row: Parameter) -> Any:
    """Return a value with which a parameter acts, by its row: its default, or the middle of its domain."""
    if row.name in LIQUID:
        return LIQUID[row.name]
    if row.domain:
        return np.full(row.size, np.mean(row.domain)) if row.size > 1 else float(np.mean(row.domain))
    if row.default:
        return row.default
    return np.array([0.7, 0.3, -0.5])[: row.size] if row.size > 1 else np.clip(0.4, row.least, row.most)


def drawn(row: Parameter, random: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Draw values from a parameter's domain, or from near `value_of`, shape (count,) or (count, size)."""
    shape = (count, row.size) if row.size > 1 else (count,)
    if row.domain:
        return random.uniform(*row.domain, shape)
    value = value_of(row)
    least, most = np.minimum(row.least, value), np.maximum(row.most, value)  # a default may stand for a missing value
    return np.clip(random.uniform(0.8, 1.2, shape) * value, least, most)


def values_of(law: Law) -> dict[str, Any]:
    """Return values by name of all that a law may ask for, with which it acts."""
    constants = {name: BODY[name] for name in OF_KIND.get(law.kind, ())}
    return {row.name: value_of(row) for row in law.parameters} | constants


def values_without(laws: Sequence[Law]) -> dict[str, float]:
    """Return values by name of all that laws may ask for, with which none acts: neutral ones, or else zero."""
    zero = [row.name for law in laws if not law.neutral for row in law.parameters]
    neutral = {name: value for law in laws for name, value in law.neutral.items()}
    return dict.fromkeys([*BODY, *zero], 0.0) | neutral


def tent() -> Any:
    """Return two triangles that share an edge, at an angle."""
    return mesh_of([(0, 0, 0), (1, 0, 0), (0.5, 0.8, 0.4), (0.5, -0.8, 0.4)], [[0, 1, 2], [1, 0, 3]])


def square() -> Any:
    """Return a raft, face down, whose diagonals are its only shear springs."""
    return mesh_of([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)], [[0, 1, 2, 3]])


def body_of(law: Law) -> Scene:
    """Return a square and a tent without inflation, a particle between two taut strings, and the things of the law."""
    still = Inflation(kind="pressure", pressure=0.0)
    scene = Scene(
        balloon=[
            Balloon(mesh=square(), inflation=still),
            Balloon(mesh=tent(), inflation=still, position=(0.1, 3.0, 0.2)),
        ],
        string=[
            String(anchor=(-2.0, 0.0, 0.0), particle=0, length=1.0),
            String(anchor=(2.0, 0.0, 0.0), particle=0, length=1.0),
        ],
        water=Water(),
        touch=False,
    )
    if law.wants is None or law.wants(scene):
        return scene
    return scene.model_copy(update={"correction": "tarantino"})


def plan_of_each(laws: Sequence[Law]) -> ModelPlan:
    """Return a plan with a world for each of the laws, which must want the same scene, with that law alone."""
    plan = plan_model(body_of(laws[0]), len(laws), laws=OWN)
    parameters = {name: np.repeat(values, len(laws) // len(values), axis=0) for name, values in plan.parameters.items()}
    for name, value in values_without(TESTED).items():
        parameters[name][:] = value
    for world, law in enumerate(laws):
        for name, value in values_of(law).items():
            parameters[name][world] = value
    parameters["helium"][:, 1] = parameters["gravity"]  # the tent weighs nothing, and stays out of the water
    return replace(plan, parameters=parameters)


def plan_of_all(law: Law) -> tuple[ModelPlan, int]:
    """Return the plan that the law is in, and its world."""
    same = [other for other in TESTED if body_of(other).correction == body_of(law).correction]
    return plan_of_each(same), same.index(law)


def model_of_all(law: Law, device: str, step_seconds: float | None = None, substeps: int = 1) -> tuple[Model, int]:
    """Return the model, with a frame of so many substeps, and the law's world."""
    plan, world = plan_of_all(law)
    model = lay_out(plan, device)
    if step_seconds is None:
        return model, world
    return replace(model, substeps=substeps, frame_seconds=substeps * step_seconds), world


def stable_step(law: Law) -> float:
    """Return the step that the bounds allow [s]."""
    plan, world = plan_of_all(law)
    alone = plan.of_worlds(np.array([world]))
    return Network(alone.shapes, alone.held, alone.laws).stable_step(alone.scene, alone.parameters)


def particle_masses(model: Model) -> NDArray[np.float64]:
    """Return the mass of each particle [kg]."""
    balloons = zip(model.scene.balloon, model.shapes, strict=True)
    return np.concatenate([balloon.mass * shape.mass_share for balloon, shape in balloons])


def shake(state: Any, points: float = 0.0, velocities: float = 0.0, seed: int = 0) -> None:
    """Displace all particles and give them velocities, at random by so much, alike in all worlds."""
    random = np.random.default_rng(seed)
    for array, size in ((state.points, points), (state.velocities, velocities)):
        aside = random.uniform(-size, size, (*array.shape[1:], 3))
        wp.copy(array, wp.array(array.numpy() + aside, dtype=wp.vec3, device=array.device))
