"""Phases from outside the package, and those without any physics, lists of them, and their NumPy references."""
# pyright: reportGeneralTypeIssues=false

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import warp as wp

from balloon_warp.kernels import substep
from balloon_warp.kernels.algebra import dot_product
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws import Parameter
from balloon_warp.kernels.laws.gas import VOLUME, Swelling
from balloon_warp.kernels.loops.gas import gas_in, put_gas
from balloon_warp.kernels.loops.springs import constant_of_kind
from balloon_warp.kernels.memory import int_at, pair_at
from balloon_warp.kernels.phase import Access, Phase, phase
from balloon_warp.kernels.tables import SLICE, Tables, WorldState, first_entry, sphere_number
from balloon_warp.kernels.warps import add_quanta, total_newtons
from balloon_warp.kernels.working import Working

Values = dict[str, np.ndarray]


@phase("particle", {"seen": wp.vec3})
def look_aside(features: Features, access: Access) -> Any:
    at = access.at

    @wp.func
    def look_aside(t: Tables, points: Any, particle: wp.int32):
        return at(points, (particle + 5) % t.particles.balloon.shape[0])

    return look_aside


@phase("particle", {"point": wp.vec3})
@wp.func
def follow(point: Any, seen: Any):
    return 0.75 * point + 0.25 * seen


@phase("particle", {"velocity": wp.vec3, "point": wp.vec3})
@wp.func
def trade(point: wp.vec3, velocity: wp.vec3):
    return point, velocity


@phase("particle", {"total": wp.vec3}, sums=True)
@wp.func
def add(point: wp.vec3):
    return point


@phase("balloon", {"half": wp.vec3})
@wp.func
def halve(total: wp.vec3):
    return 0.5 * total


@phase("particle", {"twice": wp.vec3}, light=True)
@wp.func
def double(half: wp.vec3):
    return 2.0 * half


@phase("particle", {"velocity": wp.vec3})
@wp.func
def heed(velocity: Any, twice: Any):
    return 0.5 * velocity + 0.125 * twice


@phase("particle", {"trace": float}, keeps={"trace": 1.0})
@wp.func
def remember(trace: Any, point: Any, velocity: Any):
    return 0.5 * trace + dot_product(point, velocity)


@phase("particle", {"seen": wp.vec3})
@wp.func
def look_at_traces(t: Tables, traces: Any, particle: wp.int32):
    return wp.vec3(traces[(particle + 5) % t.particles.balloon.shape[0]], 0.0, 1.0)


@phase("face", {"height": float}, keeps={"height": 2.0})
def rise(features: Features, access: Access) -> Any:
    at = access.at

    @wp.func
    def rise(t: Tables, points: Any, face: wp.int32, height: float):
        return 0.5 * height + at(points, t.faces.particles[t.faces.offsets[face]])[1]

    return rise


KEEPING: tuple[Phase, ...] = (remember, rise)


def sums_of(points: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return the sums of each balloon, shape (worlds, balloons, 3)."""
    return np.stack([points[:, a:b].sum(axis=1) for a, b in pairwise(offsets)], axis=1)


def by_numpy(name: str, have: Values, offsets: np.ndarray, first: np.ndarray) -> None:
    """Return the result of a phase for all items at once."""

    def seen_traces() -> np.ndarray:
        trace = np.roll(have["trace"], -5, axis=1)
        return np.stack([trace, np.zeros_like(trace), np.ones_like(trace)], axis=-1)

    each: dict[str, Callable[[], Values]] = {
        "look_aside": lambda: {"seen": np.roll(have["point"], -5, axis=1)},
        "follow": lambda: {"point": 0.75 * have["point"] + 0.25 * have["seen"]},
        "trade": lambda: {"velocity": have["point"], "point": have["velocity"]},
        "remember": lambda: {"trace": 0.5 * have["trace"] + (have["point"] * have["velocity"]).sum(axis=-1)},
        "look_at_traces": lambda: {"seen": seen_traces()},
        "rise": lambda: {"height": 0.5 * have["height"] + have["point"][:, first, 1]},
        "add": lambda: {"total": sums_of(have["point"], offsets)},
        "halve": lambda: {"half": 0.5 * have["total"]},
        "heed": lambda: {"velocity": 0.5 * have["velocity"] + 0.25 * np.repeat(have["half"], np.diff(offsets), axis=1)},
    }
    have |= each[name]()


LISTS: tuple[tuple[Phase, ...], ...] = (
    (look_aside, follow),
    (look_aside, trade, follow),
    (trade, look_aside, follow, look_aside, follow),
    (add, halve, double, heed, trade),
    (look_aside, follow, add, halve, double, heed, look_aside, trade, follow),
    (look_aside, add, halve, follow, double, heed, add, halve, trade, heed, follow),
    (remember, look_at_traces, follow, trade),
    (look_at_traces, remember, follow, rise, look_aside, follow),
)


START = 300.0
"""of temperatures [K]"""


@phase(
    "particle",
    {"velocity": wp.vec3},
    rows=(
        Parameter("slow_radius", "m", least=0.0, of="sphere"),
        Parameter("slowing", "1/s", least=0.0, of="sphere", meaning="how fast what is within loses its speed"),
    ),
    neutral={"slowing": 0.0},
)
def slow(features: Features, access: Access) -> Any:
    """Slow a particle that is near a sphere."""
    sphere_at, places = access.sphere_at, features.columns.places_of_spheres
    radius, slowing = places["slow_radius"], places["slowing"]

    @wp.func
    def slow(t: Tables, spheres: Any, params: Any, point: wp.vec3, velocity: wp.vec3):
        slowed = velocity
        for sphere in range(t.spheres.numbers.shape[1]):
            center, _motion, _radius = sphere_at(t, spheres, params.world, sphere)
            if wp.length(point - center) < sphere_number(t.spheres, params.world, sphere, radius):
                slowed = slowed / (1.0 + t.step_seconds * sphere_number(t.spheres, params.world, sphere, slowing))
        return slowed

    return slow


@phase(
    "particle",
    {"temperature": float},
    rows=(
        Parameter("warming_seconds", "s", 1.0, least=1.0e-6),
        Parameter("weakening", "1/K", meaning="part of a particle's forces that a kelvin takes"),
    ),
    neutral={"weakening": 0.0},
    keeps={"temperature": START},
)
@wp.func
def warm(t: Tables, temperature: float, air_temperature: float, warming_seconds: float):
    """Let a particle's temperature follow the air's [K]."""
    part = t.step_seconds / (warming_seconds + t.step_seconds)
    return temperature + part * (air_temperature - temperature)


@phase("particle", {"force": wp.vec3}, neutral={"weakening": 0.0})
@wp.func
def weaken(force: wp.vec3, temperature: float, weakening: float):
    """Weaken the pull on a particle that is warm."""
    return (1.0 - weakening * (temperature - START)) * force


def list_after(patch: pytest.MonkeyPatch, line: str, *more: Phase) -> None:
    """Insert phases into the list of the step, after the one of a name."""
    names = [each.name for each in substep.STEP]
    place = names.index(line) + 1
    patch.setattr(substep, "STEP", (*substep.STEP[:place], *more, *substep.STEP[place:]))


CLOCK = {"skin_limit": 0.0}


@phase(
    "particle",
    {"skin_age": float},
    rows=(Parameter("skin_limit", "s", least=0.0, meaning="stretch times time at which springs weaken; 0 never"),),
    neutral=CLOCK,
    keeps={"skin_age": 0.0},
)
def age(features: Features, access: Access) -> Any:
    """Let a particle's age grow with the mean stretch of its springs over time [s]."""
    at = access.at

    @wp.func
    def age(t: Tables, points: Any, params: Any, point: wp.vec3, skin_age: float):
        begin = first_entry(t.springs.slice_offsets, params.number)
        total = float(0.0)  # noqa: UP018 - a variable of Warp
        springs = int_at(t.springs.valences, params.number)
        for slot in range(springs):
            spring = pair_at(t.springs.entries, begin + SLICE * slot)
            total += wp.length(at(points, wp.cast(spring[0], wp.int32) >> 2) - point) / spring[1] - 1.0
        return skin_age + t.step_seconds * wp.max(total / float(springs), 0.0)

    return age


@phase("particle", {"force": wp.vec3}, neutral=CLOCK)
def slacken(features: Features, access: Access) -> Any:
    """Take half of a spring's force where either of its ends is too old."""
    at = access.at

    @wp.func
    def slacken(
        t: Tables, points: Any, skin_ages: Any, params: Any, point: wp.vec3, force: wp.vec3, skin_limit: float
    ):  # fmt: skip
        total = force
        begin = first_entry(t.springs.slice_offsets, params.number)
        for slot in range(int_at(t.springs.valences, params.number)):
            spring = pair_at(t.springs.entries, begin + SLICE * slot)
            kind_and_end = wp.cast(spring[0], wp.int32)
            end = kind_and_end >> 2
            if wp.max(skin_ages[params.number], skin_ages[end]) > skin_limit:
                way = at(points, end) - point
                stiffness = constant_of_kind(params.n, kind_and_end & 3)
                total -= 0.5 * stiffness * (wp.length(way) - spring[1]) * wp.normalize(way)
        return total

    return slacken


VALVE = {"valve_rate": 0.0}
ROWS_OF_VALVE = (
    Parameter("valve_volume", "m^3", 1.0e6, least=0.0, domain=(0.1, 1.0)),
    Parameter("valve_rate", "1/s", least=0.0, domain=(0.1, 2.0), meaning="part of the gas that leaves in a second"),
)


@phase("balloon", {"opened": float}, rows=ROWS_OF_VALVE, neutral=VALVE, keeps={"opened": 0.0})
def switch(features: Features, access: Access) -> Any:
    """Open a balloon's valve while it is larger than a volume, and shut it again 5 % below."""
    bound = features.columns.places["valve_volume"]

    @wp.func
    def switch(swelling: Swelling, opened: float, numbers: Any):
        now = opened
        if swelling[VOLUME] > numbers[bound]:
            now = 1.0
        elif swelling[VOLUME] < 0.95 * numbers[bound]:
            now = 0.0
        return now

    return switch


@phase("balloon", neutral=VALVE)
def release(features: Features, access: Access) -> Any:
    """Let gas out of a balloon whose valve is open."""
    rate = features.columns.places["valve_rate"]

    @wp.func
    def release(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, opened: float, numbers: Any):
        if opened > 0.5:
            left = wp.float64(1.0 / (1.0 + t.step_seconds * numbers[rate]))
            put_gas(state, world, balloon, left * gas_in(state, world, balloon))

    return release


@phase(
    "particle",
    {"force": wp.vec3},
    rows=(
        Parameter("magnet", "m^3/s^2", of="sphere", domain=(0.0, 1.0)),
        Parameter("magnet_core", "m", 0.1, least=1.0e-3, of="sphere"),
    ),
    neutral={"magnet": 0.0},
)
def attract(features: Features, access: Access) -> Any:
    """Pull a particle of mass m towards each sphere by s m / (r^2 + e^2), and the sphere towards it [N]."""
    sphere_at, columns = access.sphere_at, features.columns.places_of_spheres
    magnet, core = columns["magnet"], columns["magnet_core"]

    @wp.func
    def attract(t: Tables, spheres: Any, params: Any, point: wp.vec3, force: wp.vec3):
        total = force
        for sphere in range(t.spheres.numbers.shape[1]):
            center, _motion, _radius = sphere_at(t, spheres, params.world, sphere)
            way = center - point
            softening = sphere_number(t.spheres, params.world, sphere, core)
            strength = sphere_number(t.spheres, params.world, sphere, magnet) * params.mass
            pull = strength / (wp.length_sq(way) + softening * softening) * wp.normalize(way)
            add_quanta(spheres.sphere_quanta, params.world, sphere, -pull)
            total += pull
        return total

    return attract


@phase("particle", {"force": wp.vec3}, neutral={"magnet": 0.0})
@wp.func
def weigh_spheres(spheres: Any, params: Any, force: wp.vec3):
    """Add the sum of the forces on the first sphere to that on a particle [N]."""
    return force + total_newtons(spheres.sphere_quanta, params.world, 0)


@phase("particle", {"force": wp.vec3}, rows=(Parameter("leash", "N/m"),), neutral={"leash": 0.0})
@wp.func
def lead(t: Tables, state: WorldState, working: Working, params: Any, point: wp.vec3, force: wp.vec3, leash: float):
    """Pull a particle towards the first body's center, and that towards it: by its mass share of k d [N]."""
    way = state.body_positions[params.world, 0] - point
    pull = leash * params.share * way
    add_quanta(working.body_quanta, params.world, 0, -pull)
    add_quanta(working.body_turning_quanta, params.world, 0, wp.cross(way, pull))
    return force + pull


@phase("sphere", {"traveled": float}, rows=(Parameter("odometer", "1", of="sphere"),), neutral={"odometer": 0.0},
       keeps={"traveled": 0.0})  # fmt: skip
@wp.func
def travel(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32, traveled: float, odometer: float):
    """Add up a sphere's way [m]."""
    return traveled + odometer * t.step_seconds * wp.length(spheres.sphere_velocities[world, sphere])


@phase("world", {"passed": float}, keeps={"passed": 0.0}, wants=lambda scene: bool(scene.sphere))
@wp.func
def count_substeps(passed: float):
    """Count substeps."""
    return passed + 1.0


@phase("particle", {"force": wp.vec3}, wants=lambda scene: scene.gravity == 0.0)
@wp.func
def scribble(t: Tables, params: Any, force: wp.vec3):
    """Write into a table, which no phase may."""
    t.springs.valences[params.number] = 0
    return force
