"""Every schedule against the reference, in every feature set: over a substep, a frame and three frames."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from feature_sets import SETS, feature_set, varied
from scipy.spatial.transform import Rotation

from balloon_warp import Scene, Simulator, load_scene
from balloon_warp.lab.reference import Reference
from balloon_warp.model import build_model
from balloon_warp.schedules.tables import model_features

MOVE = 1e-6
"""Offset of all places at the start [m], of balloons of a meter, which shows how a scene amplifies the rounding of
float32: a place there is rounded by 6e-8, a force has several such errors, and each substep adds its own"""
ULP = 6e-8
"""Rounding of a float32 over its value"""
LENGTHS = {"substep": ("substep", 1), "frame": ("frames", 1), "three frames": ("frames", 3)}
"""Lengths of runs: of frames that are as long as a substep, or of the set's own, and how many"""
MOST = 3
VARIED: dict[str, Any] = {
    "touch at speed": ("touch", {"balloon.0.position": (0.1, 1.2, 0.05), "balloon.0.velocity": (0.0, -60.0, 0.2)}),
    "hinges of both": ("springs", {"balloon.1.stiffness.torsion": 0.05}),
}
"""Sets with other values: balloons that meet between two searches, in crowds that the step does not allow for; and
hinges whose particles have numbers after those of another balloon"""
USUAL = {"scatter": (), "gather": ("bursting", "all"), "block": ("all",), "lanes": ("all",)}
"""Sets by schedule that have what it does in a way of its own; others run with --full. Octets, the CPU's own, stand
above; no device takes scatter by itself, but for forces"""
WAVES = np.array([[9.0, 4.0, -3.0], [-5.0, 8.0, 4.0], [3.0, -6.0, 9.0]])
"""Wave vectors of the bent start [1/m]: at some vertex of a balloon every spring, hinge and triangle is deformed"""
BENT, STIRRED = 0.015, 0.4
"""Amplitudes of offsets of places [m] and velocities [m/s] of the bent start"""
FOLDED = 0.25
"""Part of these bends where a balloon touches itself: pressed layers take many sweeps over their contacts, which end
within a hundredth of the distance that is kept, after one more or less by rounding"""


def bend(scene: Scene, kind: str) -> tuple[Any, Any]:
    """Return offsets of places and velocities at the start: of a substep, in which a scene at rest would do nothing.

    They are smooth, so that layers that lie on each other stay so."""
    if kind == "frames":
        return 0.0, 0.0
    points, part = Reference(scene).x, FOLDED if scene.touch and scene.touch.itself else 1.0
    return part * BENT * np.sin(points @ WAVES), STIRRED * np.cos(points @ WAVES[::-1])


def scene_of(name: str, kind: str) -> Scene:
    """Return the scene of a set, of frames that are as long as a substep, or of its own."""
    scene = varied(*VARIED[name]) if name in VARIED else feature_set(name)
    if kind == "frames":
        return scene
    return scene.model_copy(update={"frames_per_second": scene.frames_per_second * scene.substeps, "substeps": 1})


def state_of(reference: Reference) -> dict[str, np.ndarray]:
    """Return the state of a frame, by the names of `Simulator.state`."""
    m, balls, bodies = reference.m, reference.things.spheres, reference.things.bodies
    momenta = [np.linalg.solve(m.turning[body], m.spin[body]) for body in bodies]
    return {
        "points": np.concatenate(reference.points), "velocities": np.concatenate(reference.velocities),
        "pressures": reference.pressures, "gas_amounts": reference.gas_amounts,
        "free_volumes": np.array([b.free_volume for b in reference.balloons]), "sphere_positions": m.x[balls],
        "sphere_velocities": m.v[balls], "sphere_spins": m.spin[balls], "body_positions": m.x[bodies],
        "body_velocities": m.v[bodies], "body_turns": m.turn[bodies], "body_momenta": np.reshape(momenta, (-1, 3)),
    }  # fmt: skip


def course(scene: Scene, frames: int, shifts: tuple[Any, Any]) -> list[dict[str, np.ndarray]]:
    """Return the states of the reference at the start and after each frame, from shifted places and velocities."""
    reference = Reference(scene, shifts=shifts)
    found = [state_of(reference)]
    for _ in range(frames):
        reference.frame()
        found.append(state_of(reference))
    return found


@cache
def told(name: str, kind: str) -> list[tuple[dict[str, np.ndarray], dict[str, float]]]:
    """Return the states at the start and after each frame, and the tolerance of each array."""
    scene, frames, rng = scene_of(name, kind), MOST if kind == "frames" else 1, np.random.default_rng(1)
    shift, gain = bend(scene, kind)
    ways = course(scene, frames, (shift, gain))
    shape = ways[0]["points"].shape
    others = [course(scene, frames, (shift + MOVE * rng.uniform(-1.0, 1.0, shape), gain)) for _ in range(2)]
    both = enumerate(zip(ways, *others, strict=True))
    return [(way, tolerances(scene, ways[0], way, aside, frame)) for frame, (way, *aside) in both]


def tolerances(scene: Scene, start: Any, way: Any, others: list[Any], frames: int) -> dict[str, float]:
    """Return four times the difference that moved starts make, and some roundings, which add up as a random walk."""
    assert isinstance(scene.substeps, int)
    steps, rate = frames * scene.substeps, scene.frames_per_second
    most, roundings = {}, ULP * (8.0 + 4.0 * np.sqrt(steps))
    for field, values in way.items():
        amplified = max(np.abs(other[field] - values).max(initial=0.0) for other in others)
        most[field] = 4.0 * amplified + roundings * np.abs(values).max(initial=0.0)
    for thing in ("sphere", "body"):
        most[f"{thing}_positions"] += most[f"{thing}_velocities"] * frames / rate  # which they follow
    if scene.correction != "none":  # a velocity changes by the correction of a place, over the substep
        most["velocities"] += roundings * np.abs(way["points"]).max() * rate * scene.substeps
    if scene.obstacle:  # which stop an approach by the depth over the substep; rounding decides what passes an edge
        most["velocities"] += most["points"] * rate * scene.substeps
        most["body_velocities"] += ULP * np.abs(way["body_positions"]).max(initial=0.0) * rate * scene.substeps
    if any(balloon.inflation.kind == "gas" for balloon in scene.balloon):
        most["pressures"] += 8.0 * ULP * scene.atmosphere.pressure  # which is subtracted
        shifts, gains = (
            [np.abs(other[field] - way[field]).max() for other in others] for field in ("pressures", "gas_amounts")
        )
        flowed = np.abs(way["gas_amounts"] - start["gas_amounts"]).max()
        by_pressure = max((gain / shift for gain, shift in zip(gains, shifts, strict=True) if shift > 0.0), default=0.0)
        # kept in float64; flows are roots of pressures, which have a steep slope where these pass 0
        most["gas_amounts"] = 1e-4 * flowed + by_pressure * most["pressures"]
    return most


def require_same(name: str, length: str, schedule: str, device: str) -> None:
    """Require that a schedule comes to where the reference does."""
    kind, frames = LENGTHS[length]
    scene = scene_of(name, kind)
    lacks = [what for what in Reference.lacks(scene) if kind == "frames" or what != "tears"]
    if lacks:  # nothing tears in the first substep
        pytest.skip(f"the reference has no {', '.join(lacks)}")
    (start, _), (expected, most) = told(name, kind)[0], told(name, kind)[frames]
    simulator = Simulator(scene, device, schedule=schedule)
    simulator.state.points.assign(start["points"][None])
    simulator.state.velocities.assign(start["velocities"][None])
    for _ in range(frames):
        simulator.step_unread()
    for field, values in expected.items():
        found = getattr(simulator.state, field).numpy()[0].astype(float)
        if field == "body_turns":
            found = Rotation.from_quat(found.reshape(-1, 4)).as_matrix() if len(found) else values
        off = np.abs(found - values).max(initial=0.0)
        assert off <= most[field], (field, off, most[field])


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("name", SETS)
def test_the_schedule_of_a_device_does_what_the_reference_does(name: str, length: str, device: str):
    require_same(name, length, "auto", device)


@pytest.mark.parametrize(
    ("by", "name"),
    [
        pytest.param(by, name, marks=() if name in USUAL[by] else pytest.mark.full)
        for by in USUAL
        for name in SETS
        if name != "bursting" or by in ("scatter", "gather")  # others do not let balloons burst
    ],
)
def test_a_substep_is_the_reference_s_in_every_schedule(name: str, by: str, device: str):
    if device != "cpu" and by == "lanes":
        pytest.skip("lanes are for the CPU")
    require_same(name, "substep", by, device)


@pytest.mark.parametrize("name", VARIED)
@pytest.mark.parametrize("by", ["auto", "gather"])
def test_a_set_of_other_values_does_what_the_reference_does(name: str, by: str, device: str):
    require_same(name, "frame", by, device)


NOTHING: dict[str, dict[str, Any]] = {
    "springs": {f"balloon.0.{name}": 0.0 for name in ("damping", "stiffness.torsion", "stiffness.viscosity")},
    "gas": {
        "balloon.0.inflation.leak": 0.0,
        "balloon.0.neck.diameter": 0.0,
        "balloon.0.inflation.breathing_damping": 1.0,
    },
    "air and water": {"balloon.0.drag_coefficient": 0.0, "balloon.0.face_drag": 0.0, "atmosphere.gusts": 0.0},
}
"""Values by which laws do nothing"""


@pytest.mark.parametrize("name", NOTHING)
def test_values_that_do_nothing_need_no_other_kernel(name: str):
    """The features are those of the set, from which kernels follow; without the set's own values they are others."""
    scenes = feature_set(name), varied(name, NOTHING[name]), load_scene(feature_set(name), NOTHING[name])
    own, kept, lost = (model_features(build_model(scene, "cpu")) for scene in scenes)
    assert own == kept != lost


@pytest.mark.full
@pytest.mark.parametrize("length", ["frame", "three frames"])
@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("schedule", ["scatter", "gather", "block", "lanes", "octets"])
def test_every_schedule_does_what_the_reference_does(name: str, length: str, schedule: str, device: str):
    if device != "cpu" and schedule in ("lanes", "octets"):
        pytest.skip(f"{schedule} is for the CPU")
    require_same(name, length, schedule, device)
