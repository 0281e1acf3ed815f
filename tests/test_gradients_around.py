"""Gradients by what is around a balloon: where obstacles are and go, their friction, and strings' own numbers."""

import re
from typing import Any

import numpy as np
import pytest
from gradient_scenes import CASES, far, far_in_float64, scene

import balloon_warp as bw

AMONG = CASES["gas among obstacles"][0]
OF_AMONG = [
    *("obstacle.0.position.0", "obstacle.0.position.1", "obstacle.0.friction"),
    *("obstacle.1.position.0", "obstacle.1.friction", "obstacle.2.position.2", "obstacle.2.friction"),
]
WAY = [(0.0, (0.0, 0.0, 0.0)), (0.01, (0.1, 0.02, 0.0)), (0.1, (0.5, 0.4, 0.3))]
"""A way whose second keyframe is within a frame"""
BELOW = {"size": (3.0, 0.5, 3.0), "position": (0.02, -0.335, 0.03), "friction": 0.3, "motion": WAY}
OF_WAY = [f"obstacle.0.motion.{key}.1.{axis}" for key in (0, 1, 2) for axis in (0, 1)][1:]
STRINGS = [{"anchor": (0.3, 3.0, 0.1), "length": 1.02, "stiffness": 30.0}]
OF_STRINGS = [*(f"string.0.anchor.{axis}" for axis in range(3)), "string.0.length", "string.0.stiffness"]


def value_of(of: bw.Scene, path: str) -> float:
    value: Any = of
    for name in path.split("."):
        value = value[int(name)] if name.isdecimal() else getattr(value, name)
    return float(value)


def with_value(of: bw.Scene, path: str, more: float) -> bw.Scene:
    """Return a scene with another value of an obstacle or a string, by its path."""
    table, number, *names = path.split(".")

    def shifted(value: Any, keys: list[str]) -> Any:
        if not keys:
            return value + more
        if isinstance(value, list | tuple):
            at = int(keys[0])
            return type(value)([*value[:at], shifted(value[at], keys[1:]), *value[at + 1 :]])
        return value.model_copy(update={keys[0]: shifted(getattr(value, keys[0]), keys[1:])})

    return of.model_copy(update={table: shifted(getattr(of, table), [number, *names])})


def slope(of: bw.Scene, path: str, h: float = 3e-7) -> float:
    """Return the central difference of the loss, so narrow that no particle meets anything in another substep."""
    more, less = (far_in_float64(with_value(of, path, sign * h), {}) for sign in (1.0, -1.0))
    return (more - less) / (2.0 * h)


def moving() -> bw.Scene:
    return scene(frames=2, substeps=16, obstacle=[BELOW], faces=False)


CASES_AROUND: dict[str, tuple[bw.Scene, list[str]]] = {
    "obstacles that rest": (AMONG, OF_AMONG),
    "a box that moves": (moving(), [*OF_WAY, "obstacle.0.position.1", "obstacle.0.friction"]),
    "strings": (scene(string=STRINGS, velocity=(0.3, -2.0, 0.1)), OF_STRINGS),
}


@pytest.mark.full
@pytest.mark.parametrize("case", CASES_AROUND)
def test_gradients_are_the_slopes_of_a_run_in_double_precision(case: str, device: str):
    """Gradients agree to 2e-4, as in `test_gradients`: states are float32."""
    of, paths = CASES_AROUND[case]
    found = bw.gradient(of, of=paths, loss=far, device=device)
    assert found.loss[0] == pytest.approx(far_in_float64(of, {}), rel=1e-5)
    for path in paths:
        assert found.gradients[path][0] == pytest.approx(slope(of, path), rel=2e-4, abs=1e-6), path


@pytest.mark.full
def test_a_world_in_a_batch_has_the_gradients_that_it_has_alone(device: str):
    of, paths = AMONG, OF_AMONG[:3]
    places = np.array([-0.02, -0.021])
    found = bw.gradient(of, of=paths, loss=far, world_count=2, vary={paths[0]: places}, device=device).gradients
    alone = bw.gradient(of, of=paths, loss=far, vary={paths[0]: places[1:]}, device=device).gradients
    for path in paths:
        assert found[path][1] == alone[path][0]
        assert found[path][0] != found[path][1]


REFUSED = {
    "no obstacle": ("obstacle.3.motion.0.1.0", "the scene has 1 obstacles; expected obstacle.NUMBER, from 0"),
    "no keyframe": (
        "obstacle.0.motion.7.1.0",
        "obstacle 0 has 3 keyframes; expected obstacle.0.motion.KEYFRAME.1.AXIS",
    ),
    "a time": ("obstacle.0.motion.1.0", "obstacle 0 has 3 keyframes; expected"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_ways_without_such_a_keyframe_are_refused(case: str):
    path, sentence = REFUSED[case]
    with pytest.raises(bw.InputError, match=re.escape(sentence)):
        bw.gradient(moving(), of=[path], loss=far, device="cpu")


def test_blocks_are_refused():
    with pytest.raises(bw.InputError, match=r"string.0.length: is derived by launches; expected the schedule launched"):
        bw.gradient(CASES_AROUND["strings"][0], of=["string.0.length"], loss=far, device="cpu", schedule="block")


@pytest.mark.parametrize("path", ["obstacle.0.position.1", "obstacle.0.friction", "obstacle.0.motion.1.1.0"])
def test_obstacles_that_more_than_particles_meet_are_refused(path: str):
    """Derivatives by obstacles that spheres meet are refused, but by friction; that, too, where faces meet them."""
    ball = {"position": (0.0, 3.0, 0.0), "radius": 0.6}
    of = scene(obstacle=[BELOW], faces=False, sphere=[ball], contact="impulse")
    if not path.endswith("friction"):
        with pytest.raises(bw.InputError, match=f"{path}: cannot be derived by yet, for it acts by"):
            bw.gradient(of, of=[path], loss=far, device="cpu")
    with pytest.raises(bw.InputError, match=r"cannot be derived by yet|`meet_ridges` has no adjoint"):
        bw.gradient(of.model_copy(update={"sphere": [], "faces": True}), of=[path], loss=far, device="cpu")


@pytest.mark.full
def test_the_friction_of_an_obstacle_on_which_a_ball_rolls_is_derived():
    """A sphere goes less far by the friction of a plane, by as much as runs in single precision say.

    To a fiftieth, which is what these leave of a difference.
    """

    def rolling(friction: float) -> bw.Scene:
        ball = {"position": (3.0, -0.3, 0.0), "velocity": (1.5, 0.0, 0.0), "radius": 0.2, "mass": 0.3, "friction": 0.3}
        plane = {"shape": "plane", "friction": friction, "position": (0.0, -0.5, 0.0)}
        return scene(obstacle=[plane], faces=False, sphere=[ball], contact="impulse", frames=4, substeps=16)

    def along(moved: bw.Trajectories) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        slopes = np.zeros(moved.sphere_positions.shape)
        slopes[-1, 0, 0] = 1.0
        return np.array([moved.sphere_positions[-1, 0, 0]]), {"sphere_positions": slopes}

    path = "obstacle.0.friction"
    less, found, more = (bw.gradient(rolling(mu), of=[path], loss=along, device="cpu") for mu in (0.08, 0.1, 0.12))
    slope = (more.loss[0] - less.loss[0]) / 0.04
    assert slope < -0.01
    assert found.gradients[path][0] == pytest.approx(slope, rel=0.02)


@pytest.mark.full
def test_particles_that_are_fixed_leave_derivatives_numbers(device: str):
    """The derivative by the mass, by which others' forces are divided, is the difference of runs, to their rounding."""
    low, of, high = (scene("gas", fixed=[0, 5], mass=mass) for mass in (0.045, 0.05, 0.055))
    less, found, more = (bw.gradient(each, of=["balloon.mass"], loss=far, device=device) for each in (low, of, high))
    slope = (more.loss[0] - less.loss[0]) / 1e-2  # of a loss of 170, to 1e-5: 2e-3 of it
    assert found.gradients["balloon.mass"][0] == pytest.approx(slope, rel=4e-3)
    assert all(np.isfinite(array).all() for array in (*found.by_points, *found.by_velocities))


@pytest.mark.full
def test_a_sphere_that_has_yet_to_begin_changes_no_derivative(device: str):
    of = scene(ground=True)
    late = bw.Sphere(position=(0.0, 2.0, 0.0), radius=0.2, mass=0.5, velocity=(2.0, 0.0, 0.0), start=1.0)
    paths = ["gravity", "balloon.mass"]
    alone, beside = (
        bw.gradient(each, of=paths, loss=far, device=device, schedule="launched")
        for each in (of, of.model_copy(update={"sphere": [late], "contact": "impulse", "faces": False}))
    )
    for path in paths:
        assert beside.gradients[path][0] == pytest.approx(alone.gradients[path][0], rel=1e-6), path
