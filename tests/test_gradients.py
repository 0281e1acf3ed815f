"""Gradients against differences of a run in double precision, and what they must keep."""

import re
from typing import Any

import numpy as np
import pytest
import warp as wp
from float64_run import motion
from meshes import mesh_of, quad_sphere

import balloon_warp as bw
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model import plan_model
from balloon_warp.statics.volume import Volume
from balloon_warp.trajectories import Trajectories

BALL = quad_sphere(2)
TRIANGLES = mesh_of(BALL.points, triangles_of(BALL))
N = len(BALL.points)
RNG = np.random.default_rng(3)
WEIGHTS, TARGET = RNG.uniform(0.5, 1.5, (N, 1)), RNG.normal(size=(N, 3))
SPRINGS = ["balloon.stiffness.structural", "balloon.stiffness.shear", "balloon.stiffness.flexion"]
MOTION = [
    *("balloon.mass", "balloon.damping", "gravity", "balloon.position.1", "balloon.velocity.0", "balloon.velocity.1"),
    *("balloon.angular_velocity.2", "balloon.rotation.0"),
]
RUBBER = [f"balloon.material.{name}" for name in ("shear_modulus", "thickness", "mooney_ratio")]
GAS = [
    *("balloon.inflation.start_pressure", "balloon.inflation.added_mass", "balloon.inflation.molar_mass"),
    *("atmosphere.pressure", "atmosphere.temperature"),
]


def scene(
    kind: str = "pressure", frames: int = 1, substeps: int = 32, ground: bool = False, rate: float = 60.0, **more: Any
) -> bw.Scene:
    """A ball that flies and turns, low enough that its foot is in the ground, if there is one."""
    inflation: dict[str, Any] = {"kind": "gas", "start_pressure": 500.0}
    if kind == "pressure":
        inflation = {"kind": "pressure", "pressure": [[0.0, 20.0], [0.04, 60.0]]}
    balloon: dict[str, Any] = {
        "mesh": BALL, "position": (0.0, 0.93, 0.0), "mass": 0.05, "damping": 0.05, "velocity": (0.3, -1.0, 0.1),
        "angular_velocity": (0.5, 1.0, -2.0), "inflation": inflation,
        "stiffness": {"structural": 100.0, "shear": 50.0, "flexion": 20.0},
    }  # fmt: skip
    if "material" in more:
        del balloon["mass"], balloon["stiffness"]
    on = {"ground": {"height": 0.0, "friction": 0.3}} if ground else {}
    return bw.Scene(frames=frames, frames_per_second=rate, substeps=substeps, balloon=[balloon | more], **on)


def far(moved: Trajectories) -> tuple[np.ndarray, dict[str, Any]]:
    """How far it ends from somewhere, how large it was on the way, and how fast in the first frame."""
    points, velocities = ([np.zeros(each.shape)] for each in (moved.points[0], moved.velocities[0]))
    off, speeds = moved.points[0][..., -1, :, :] - TARGET, moved.velocities[0][..., 1, :, :].astype(float)
    points[0][..., -1, :, :], velocities[0][..., 1, :, :] = 2.0 * WEIGHTS * off, 0.2 * speeds
    volumes = np.zeros(moved.volumes.shape)
    volumes[..., 1:, :] = 2.0 * moved.volumes[..., 1:, :]
    loss = (WEIGHTS * off**2).sum(axis=(-1, -2)) + 0.1 * (speeds**2).sum(axis=(-1, -2))
    loss = loss + (moved.volumes[..., 1:, 0] ** 2).sum(axis=-1)
    return loss, {"points": points, "velocities": velocities, "volumes": volumes}


def far_in_float64(of: bw.Scene, values: dict[str, float]) -> float:
    points, velocities, _ = motion(of, values)
    volume = Volume(plan_model(of).shapes[0].mesh)
    sizes = [volume.of(each) ** 2 for each in points[1:]]
    return float((WEIGHTS * (points[-1] - TARGET) ** 2).sum() + 0.1 * (velocities[1] ** 2).sum() + sum(sizes))


def value_at(of: bw.Scene, path: str) -> float:
    value: Any = of.balloon[0] if path.startswith("balloon") else of
    for name in path.removeprefix("balloon.").removeprefix("0.").split("."):
        value = value[int(name)] if name.isdecimal() else getattr(value, name)
    return float(plan_model(of).parameters[name][0, 0] if value is None else value)


def differences(of: bw.Scene, paths: list[str]) -> dict[str, float]:
    """Central differences, on the ground so narrow that no particle meets it in another substep."""
    found = {}
    for path in paths:
        value = value_at(of, path)
        h = (1e-5 if of.ground is None else 3e-7) * (abs(value) or 1.0)
        more, less = (far_in_float64(of, {path: value + sign * h}) for sign in (1.0, -1.0))
        found[path] = (more - less) / (2.0 * h)
    return found


CASES = {
    "pressure": (scene(), [*SPRINGS, *MOTION, "balloon.0.inflation.pressure.0.1", "balloon.0.inflation.pressure.1.1"]),
    "a substep": (scene(rate=1200.0, substeps=1), [*SPRINGS, *MOTION]),
    "frames": (scene(frames=4), [*SPRINGS, *MOTION]),
    "triangles": (scene(mesh=TRIANGLES), [*SPRINGS[::2], *MOTION]),
    "rubber": (scene(frames=6, material={"kind": "mooney_rivlin"}), [*RUBBER, *MOTION[1:]]),
    "gas": (scene("gas", frames=2), [*SPRINGS, *MOTION, *GAS]),
    "ground": (scene(ground=True, frames=2), [*SPRINGS, *MOTION, "ground.height"]),
    "gas on the ground": (scene("gas", ground=True, frames=2), [*SPRINGS, *MOTION, *GAS, "ground.height"]),
}


@pytest.mark.parametrize("case", CASES)
def test_gradients_are_the_slopes_of_a_run_in_double_precision(case: str):
    """To 2e-4: states are float32, and forces cancel. Springs at rest pull nothing in a single substep."""
    of, paths = CASES[case]
    found = bw.gradient(of, of=paths, loss=far, device="cpu")
    assert found.loss[0] == pytest.approx(far_in_float64(of, {}), rel=1e-5)
    told = differences(of, paths)
    for path in paths:
        assert found.gradients[path][0] == pytest.approx(told[path], rel=2e-4, abs=1e-6), path
    ahead = np.random.default_rng(5).normal(size=len(paths)) * [max(abs(value_at(of, path)), 1.0) for path in paths]
    along, told_along = (sum(a * each[path] for a, path in zip(ahead, paths, strict=True)) for each in (
        {path: values[0] for path, values in found.gradients.items()}, told,
    ))  # fmt: skip
    assert along == pytest.approx(told_along, rel=1e-4)


def center(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """How far along x a ball is in the end."""
    slopes = np.zeros(moved.points[0].shape)
    slopes[..., -1, :, 0] = 1.0 / N
    return moved.points[0][..., -1, :, 0].mean(axis=-1), {"points": [slopes]}


def test_the_center_of_what_flies_goes_on_as_it_began():
    """Forces within a balloon have no sum: whatever they are, only damping slows its center."""
    of = ["balloon.velocity.0", "balloon.position.0"]
    found = bw.gradient(CASES["frames"][0], of=of, loss=center, device="cpu").gradients
    step, kept = 1.0 / 60.0 / 32.0, 1.0 - 0.05 / 0.05 / 60.0 / 32.0
    way = step * sum(kept**number for number in range(1, 4 * 32 + 1))
    assert found["balloon.velocity.0"][0] == pytest.approx(way, rel=1e-5)
    assert found["balloon.position.0"][0] == pytest.approx(1.0, rel=1e-5)


VARIED = {"balloon.mass": np.array([0.05, 0.06, 0.08]), "balloon.velocity.1": np.array([-1.0, 0.5, -2.0])}


@pytest.mark.parametrize("kind", ["pressure", "gas"])
def test_a_world_in_a_batch_has_the_gradients_that_it_has_alone(kind: str):
    together, paths = CASES["ground" if kind == "pressure" else "gas on the ground"]
    found = bw.gradient(together, of=paths, loss=far, world_count=3, vary=VARIED, device="cpu")
    for world in range(3):
        alone = {path: values[world : world + 1] for path, values in VARIED.items()}
        single = bw.gradient(together, of=paths, loss=far, vary=alone, device="cpu")
        assert single.loss[0] == found.loss[world]
        for path in paths:
            assert single.gradients[path][0] == found.gradients[path][world], path


def test_frames_are_those_without_gradients():
    of, paths = CASES["gas on the ground"]
    found = bw.gradient(of, of=paths, loss=far, device="cpu").trajectories
    told = bw.simulate(of, device="cpu", schedule="gather")
    for name in ("points", "velocities"):
        np.testing.assert_array_equal(getattr(found, name)[0], getattr(told, name)[0])
    np.testing.assert_array_equal(found.pressures, told.pressures)


@wp.func
def blow(velocity: wp.vec3, mass_share: float, blowing: float):
    """A law of one's own: against the square of the speed."""
    return (-blowing * mass_share * wp.length(velocity)) * velocity


OWN = bw.Law("particle", blow, (bw.Parameter("blowing", "N s^2/m^2", default=0.2),))


def float32_slope(of: bw.Scene, path: str, value: float, laws: tuple = ()) -> float:
    """Difference of two float32 runs, of each coordinate by itself."""
    h = 0.02 * value
    moved = bw.simulate(
        of, world_count=3, vary={path: [value - h, value, value + h]}, device="cpu", schedule="gather", laws=laws
    )
    slopes = far(moved)[1]
    total = 0.0
    for name in ("points", "velocities"):
        track = getattr(moved, name)[0].astype(float)
        total += ((track[2] - track[0]) * slopes[name][0][1]).sum()
    total += ((moved.volumes[2] - moved.volumes[0]) * slopes["volumes"][1]).sum()
    return float(total / (2.0 * h))


def test_laws_that_the_run_in_double_precision_does_not_know():
    """To 1%, which is what rounding leaves of these differences: viscosity, drag, and a law of one's own."""
    of = scene(frames=2, drag_coefficient=0.5, stiffness={"structural": 100.0, "viscosity": 0.003})
    values = {"balloon.stiffness.viscosity": 0.003, "balloon.drag_coefficient": 0.5, "balloon.law.blow.blowing": 0.2}
    found = bw.gradient(of, of=list(values), loss=far, device="cpu", laws=(OWN,)).gradients
    for path, value in values.items():
        assert found[path][0] == pytest.approx(float32_slope(of, path, value, (OWN,)), rel=0.01), path


def nothing(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    return 0.0, {}


REFUSED: dict[str, tuple[dict[str, Any], list[str], Any, str]] = {
    "normal forces": ({"inflation": {"kind": "normal_force"}}, SPRINGS, far, "gradients: `measure` has no adjoint yet"),
    "torsion": ({"stiffness": {"torsion": 0.1}}, SPRINGS, far, "`pull` of the law `torsion` has no adjoint yet"),
    "unknown": ({}, ["balloon.mas"], far, "balloon.0.mas: unknown field; did you mean mass?"),
    "a text": ({}, ["balloon.name"], far, "balloon.name: cannot be derived by; expected the path of a number"),
    "no list": ({}, "balloon.mass", far, "of: expected a list of paths"),
    "no number a world": ({}, SPRINGS, lambda moved: ([1.0, 2.0], {}), "loss: expected a number for each of 1 worlds"),
    "a number alone": ({}, SPRINGS, lambda moved: 1.0, "loss: expected two things"),
    "unknown slopes": ({}, SPRINGS, lambda moved: (1.0, {"areas": 0.0}), "loss: has no derivatives by areas"),
    "a wrong shape": ({}, SPRINGS, lambda moved: (1.0, {"points": [np.zeros(3)]}), "must have the shape"),
    "no list by balloon": ({}, SPRINGS, lambda moved: (1.0, {"points": 1.0}), "must be a list of 1"),
    "not finite": ({}, SPRINGS, lambda moved: (np.nan, {}), "loss: is not finite in world 0"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_derived_is_refused_in_a_sentence(case: str):
    more, paths, loss, sentence = REFUSED[case]
    with pytest.raises(bw.InputError, match=re.escape(sentence)):
        bw.gradient(scene(**more), of=paths, loss=loss, device="cpu")


def test_a_scene_with_spheres_is_refused_by_the_phase():
    of = scene().model_copy(update={"sphere": [bw.Sphere(position=(0.0, 3.0, 0.0))]})
    with pytest.raises(bw.InputError, match="gradients: `roll` has no adjoint yet"):
        bw.gradient(of, of=SPRINGS, loss=far, device="cpu")


def test_balloons_that_touch_by_default_are_refused_with_a_way_out():
    alone = scene()
    pair = alone.model_copy(
        update={"balloon": [*alone.balloon, bw.Balloon(mesh=quad_sphere(3), position=(3.0, 0.0, 0.0))]}
    )
    with pytest.raises(bw.InputError, match="balloons that touch have no adjoint yet; expected touch = false"):
        bw.gradient(pair, of=SPRINGS, loss=far, device="cpu")


def test_what_has_no_effect_is_refused():
    """Far above the ground."""
    with pytest.raises(bw.InputError, match=r"ground\.height: no path leads from it to the loss"):
        bw.gradient(scene(ground=True, position=(0.0, 9.0, 0.0)), of=CASES["ground"][1], loss=far, device="cpu")


def test_a_loss_without_slopes_has_gradients_of_zero():
    found = bw.gradient(scene(), of=CASES["pressure"][1], loss=nothing, device="cpu")
    assert all((values == 0.0).all() for values in found.gradients.values())
