"""Laws in the list, as functions: the force is the gradient of the energy, the bounds hold, and Warp can differentiate
it. The tests' own laws are included."""

import inspect
from typing import Any

import numpy as np
import pytest
import warp as wp
from law_functions import COUNT, adjoint, called, compile_together, difference, most_agree, size_of
from numpy.typing import NDArray
from own_laws import AT_THE_END, TESTED, drawn

from balloon_warp.kernels.laws import PARAMETERS, Law, contact, gas
from balloon_warp.kernels.laws.law import LAW_INPUTS, RESULT
from balloon_warp.kernels.laws.springs import angle_beyond
from balloon_warp.model.materials import ignoring_other_arguments

DENSITY = 0.7
"""of the air that laws are told of [kg/m^3]: less than the densities that their parameters may have"""
PLACES = {"particle": ("position",), "hinge": ("a", "b", "first", "second")}
"""by which the energy's slope is a force; of pairs it is the squared length"""


def samples_of(law: Law) -> dict[str, NDArray]:
    """Return sample inputs of a law, and its parameters about their usual values: of every sign that they may have."""
    random = np.random.default_rng(5)
    sizes = {"float": (), "vec3": (3,), "vec4": (4,)}
    samples: dict[str, NDArray] = {
        each.name: random.uniform(-1.0, 1.0, (COUNT, *sizes[each.type]))
        for each in LAW_INPUTS[law.kind]
        if each.type != "int"
    }
    lengths, rest_lengths, constants = random.uniform(0.5, 1.5, (3, COUNT))
    unit = random.normal(size=(COUNT, 3))
    told = {
        "squared_length": lengths**2,
        "rest_length": rest_lengths,
        "stiffness": 20.0 * constants,
        "stiffness_times_length": 20.0 * constants * rest_lengths,
        "mass": random.uniform(0.5, 1.5, COUNT),
        "mass_share": random.uniform(0.1, 0.3, COUNT),
        "step_seconds": random.uniform(1e-3, 2e-3, COUNT),
        "time": random.uniform(0.1, 0.9, COUNT),
        "up": unit / np.linalg.norm(unit, axis=1, keepdims=True),
        "role": np.arange(COUNT, dtype=np.int32) % 4,
        # a hinge that is folded by up to a right angle to either side
        "a": random.uniform(-0.1, 0.1, (COUNT, 3)),
        "b": (1.0, 0.0, 0.0) + random.uniform(-0.1, 0.1, (COUNT, 3)),
        "first": (0.5, 1.0, 0.0) + random.uniform(-0.5, 0.5, (COUNT, 3)) * (1.0, 0.2, 1.0),
        "second": (0.5, -1.0, 0.0) + random.uniform(-0.5, 0.5, (COUNT, 3)) * (1.0, 0.2, 1.0),
    }
    samples |= {name: values for name, values in told.items() if name in samples or name == "role"}
    if "bend" in samples:
        samples["rest_angle"] = samples["bend"]
        samples["bend"] = called(angle_beyond, {name: values.astype(np.float32) for name, values in samples.items()})
    if "water_load" in samples:
        samples["water_load"][:, 3] = np.abs(samples["water_load"][:, 3])
    rows = PARAMETERS | {row.name: row for row in law.parameters}
    for name in [*told_to(law), *(row.name for row in law.parameters)]:
        if name not in samples:
            samples[name] = drawn(rows[name], random, COUNT)
    if "air" in samples and "wind" in samples:
        samples["air"] = np.column_stack([samples["wind"], np.full(COUNT, DENSITY)])
    return {name: values if values.dtype.kind == "i" else values.astype(np.float32) for name, values in samples.items()}


def told_to(law: Law) -> list[str]:
    """Return the names of a force's arguments."""
    return list(inspect.signature(law.force.func).parameters)


def forces(law: Law, samples: dict[str, NDArray]) -> NDArray[np.float64]:
    return called(law.force, samples, RESULT[law.kind].replace("float", "float32"))


def with_role(samples: dict[str, NDArray], role: int) -> dict[str, NDArray]:
    return samples | {"role": np.full(COUNT, role, dtype=np.int32)}


def slope_of_energy(law: Law, samples: dict[str, NDArray], place: str, axis: int) -> NDArray[np.float64]:
    """Return the derivative of the energy by a component of a place; at a hinge by way of the angle."""
    if law.kind == "hinge":
        return difference(law.energy, samples, "bend") * difference(angle_beyond, samples, place, axis)
    return difference(law.energy, samples, place, axis)


@pytest.mark.parametrize("law", [law for law in TESTED if law.energy], ids=lambda law: law.name)
def test_the_force_is_the_slope_of_the_energy(law: Law):
    samples = samples_of(law)
    if law.kind in ("spring", "string"):  # F = c d, and the slope of E(d . d) by the other end's place is 2 E' d
        expected = 2.0 * difference(law.energy, samples, "squared_length")
        assert size_of(expected) > 1e-3
        most_agree(forces(law, samples), expected, size_of(expected))
        return
    for role, place in enumerate(PLACES[law.kind]):
        expected = -np.stack([slope_of_energy(law, samples, place, axis) for axis in range(3)], axis=1)
        assert size_of(expected) > 1e-3
        most_agree(forces(law, with_role(samples, role)), expected, size_of(expected))


@pytest.mark.parametrize("gamma", [1.0, 1.4])
def test_the_pressure_is_the_slope_of_a_gas_s_energy(gamma: float):
    random = np.random.default_rng(2)
    samples = {
        "air_pressure": random.uniform(0.9e5, 1.1e5, COUNT),
        "free_volume": random.uniform(0.5, 2.0, COUNT),
        "volume": random.uniform(0.5, 2.0, COUNT),
        "gamma": np.full(COUNT, gamma),
    }
    samples = {name: values.astype(np.float32) for name, values in samples.items()}
    pressure = called(gas.gas_pressure, samples)
    most_agree(pressure, -difference(gas.gas_energy, samples, "volume"), size_of(pressure))
    balance = (gas.STANDARD_PRESSURE / samples["air_pressure"]) ** (1.0 / gamma)
    balanced = samples | {"volume": (samples["free_volume"] * balance).astype(np.float32)}
    np.testing.assert_allclose(called(gas.gas_energy, balanced), 0.0, atol=0.05)  # 1e-7 of 1e5 J, twice over
    np.testing.assert_allclose(called(gas.gas_pressure, balanced), 0.0, atol=0.05)


def bound_of(law: Law, which: str, samples: dict[str, NDArray], **told: Any) -> NDArray[np.float64]:
    """Return a law's bound for each sample; 0 when missing."""
    bound = getattr(law, which)
    return np.broadcast_to(ignoring_other_arguments(bound)(**{**samples, **told}), COUNT) if bound else np.zeros(COUNT)


@pytest.mark.parametrize("law", [law for law in TESTED if law.kind in ("spring", "string")], ids=lambda law: law.name)
def test_a_pair_is_no_stiffer_than_its_bound(law: Law):
    """The stiffness of a pair along itself, d(c |d|)/d|d| = c + 2 c' d . d at rest, is within the bound."""
    samples = samples_of(law) | {"opening": np.zeros(COUNT, dtype=np.float32)}
    squared = samples["squared_length"].astype(np.float64)
    pull, slope = forces(law, samples), difference(law.force, samples, "squared_length")
    stiffness = pull + 2.0 * slope * squared
    kept = 1e-3 * size_of(samples["stiffness"])  # see `most_agree`
    within = stiffness <= bound_of(law, "stiffness", samples) + kept
    assert within.mean() >= 0.9
    if "opening" in told_to(law):
        opened = samples | {"opening": np.full(COUNT, 0.1, dtype=np.float32)}
        drag = (forces(law, opened) - pull) / 0.1 * squared
        assert (drag <= bound_of(law, "drag", samples) + kept).mean() >= 0.9


@pytest.mark.parametrize(
    ("law", "which", "by"),
    [
        pytest.param(law, which, by, id=f"{law.name} {which}")
        for law in TESTED
        for which, by in (("stiffness", "position"), ("drag", "velocity"))
        if law.kind in ("particle", "face") and by in told_to(law)
        if by == "position" or law.name not in AT_THE_END
    ],
)
def test_a_force_gives_way_no_faster_than_its_bound(law: Law, which: str, by: str):
    """The stiffness and drag of a force, the largest eigenvalue of minus its derivative by place or velocity, are
    within the bound, but for those that a step takes at its end."""
    samples = samples_of(law)
    columns = [-difference(law.force, samples, by, axis, "vec3") for axis in range(3)]
    slope = np.stack(columns, axis=2)
    steepest = np.linalg.eigvalsh(0.5 * (slope + slope.swapaxes(1, 2)))[:, -1]
    area = np.linalg.norm(samples["area_vector"], axis=1)
    told = {name: values.astype(np.float64) for name, values in samples.items() if values.dtype.kind == "f"}
    bound = bound_of(law, which, told, area=area)
    assert (steepest <= bound + 1e-3 * max(size_of(bound), size_of(slope))).mean() >= 0.9


def test_a_hinge_s_moment_is_its_constant_times_the_angle():
    (law,) = [law for law in TESTED if law.kind == "hinge"]
    samples = samples_of(law)
    angle = called(angle_beyond, samples)
    energy = called(law.energy, samples)
    bound = bound_of(law, "stiffness", samples)
    np.testing.assert_allclose(energy, 0.5 * bound * angle**2, rtol=1e-5)


@pytest.mark.parametrize("law", [law for law in TESTED if law.neutral], ids=lambda law: law.name)
def test_a_law_that_is_neutral_neither_acts_nor_asks_for_a_step(law: Law):
    samples = samples_of(law)
    active = forces(law, samples)
    for name, value in law.neutral.items():
        samples[name] = np.full_like(samples[name], value)
    assert np.abs(forces(law, samples)).max() <= 1e-6 * np.abs(active).max()
    told = {"area": np.ones(COUNT)}
    for which in ("stiffness", "drag"):
        assert np.abs(bound_of(law, which, samples, **told)).max() == 0.0


@pytest.mark.parametrize("law", TESTED, ids=lambda law: law.name)
def test_warp_differentiates_a_law(law: Law):
    samples = samples_of(law)
    result = RESULT[law.kind].replace("float", "float32")
    for function, kind in ((law.force, result), (law.energy, "float32")):
        if function is None:
            continue
        weights = np.random.default_rng(7).normal(size=(COUNT, 3) if kind == "vec3" else COUNT).astype(np.float32)
        values = called(function, samples, kind)
        found = adjoint(function, samples, weights, kind)
        assert found
        for name, gradient in found.items():
            axes = [None] if gradient.ndim == 1 else range(gradient.shape[1])
            expected = []
            for axis in axes:
                slope = difference(function, samples, name, axis, kind)
                expected.append((slope * weights).reshape(COUNT, -1).sum(axis=1))
            scale = max(size_of(values) / size_of(samples[name]), size_of(np.array(expected)))
            most_agree(gradient.reshape(COUNT, -1), np.stack(expected, axis=1), scale)


@wp.func
def excess_at_sphere(start: wp.vec3, way: wp.vec3, radius: float, step_seconds: float):
    _outward, excess, _out = contact.meet_sphere(start, way, radius, wp.vec3(0.0, 1.0, 0.0), step_seconds)
    return excess


def test_a_particle_comes_near_a_sphere_where_twice_its_way_does():
    """The nearest of many places on twice the way is within 65/64 of the radius; then its excess speed is the approach
    beyond what closes the gap in a step, and otherwise less than any."""
    rng = np.random.default_rng(7)
    radius = rng.uniform(0.05, 5.0, COUNT)
    start, way = rng.uniform(-2.0, 2.0, (2, COUNT, 3)) * radius[:, None]
    places = start[:, None] + np.linspace(0.0, 2.0, 20001)[:, None] * way[:, None]
    near = np.linalg.norm(places, axis=2).min(axis=1) < float(contact.NEAR_BODY) * radius
    assert 5 < near.sum() < COUNT - 5
    told = {"start": start, "way": way, "radius": radius, "step_seconds": np.full(COUNT, 0.25)}
    found, away = called(excess_at_sphere, told), np.linalg.norm(start, axis=1)
    expected = -4.0 * ((way * start).sum(axis=1) / away + np.maximum(away - radius, 0.0))
    np.testing.assert_allclose(found[near], expected[near], rtol=1e-5, atol=1e-5)
    assert (found[~near] < -1e9).all()


OTHERS = (gas.gas_pressure, gas.gas_energy, angle_beyond, excess_at_sphere)
compile_together(
    {law.force: RESULT[law.kind].replace("float", "float32") for law in TESTED}
    | {law.energy: "float32" for law in TESTED if law.energy}
    | dict.fromkeys(OTHERS, "float32")
)
