"""Gradients against differences of the reference, in double precision; and of a world in a batch, to the bit."""

from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp
from block_layouts import held as held_layout
from gradient_losses import (
    ends,
    ends_along,
    far,
    loss_of,
    random_shifts,
    rounding,
    run,
    slope_by_start,
    slope_of,
    value_at,
)
from gradient_scenes import CASES, HELD, OF_MEETING, OF_RUBBING, PLANE, SLAB, TRIANGLES, meeting, scene

import balloon_warp as bw
from balloon_warp.kernels.schedules.block_names import Layout
from balloon_warp.model import Model
from balloon_warp.schedules import backward_one_launch
from balloon_warp.schedules.tables import model_features

BY_DEFAULT = "gas on the ground"
"""Case that runs by launches without `--full`"""


def cases(names: Any) -> list[Any]:
    """Return each case with each of its ways back."""
    return [
        pytest.param(name, way, marks=() if name == BY_DEFAULT and way == "launched" else pytest.mark.full)
        for name in names
        for way in CASES[name].ways
    ]


@pytest.fixture
def schedule_back(way: str, device: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the schedule of a way back, with its layouts."""
    if device != "cpu" and way in ("lanes", *HELD):
        pytest.skip("is for a CPU; a GPU takes these layouts by itself")
    for layout in HELD.get(way, ()):
        monkeypatch.setattr(backward_one_launch, layout, _layout_of_one_thread)
    return "block" if way in HELD else way


def _layout_of_one_thread(model: Model) -> Layout:
    layout = held_layout(model, model_features(model))
    return layout._replace(odd=False, registers=backward_one_launch.REGISTERS)


@pytest.mark.parametrize(("case", "way"), cases(CASES))
def test_gradients_are_the_slopes_of_the_reference(case: str, way: str, schedule_back: str, device: str):
    """Each derivative, and that by a random direction of all places and velocities at the start; where they are not as
    near as in other cases, as near as the rounding of float32 lets them be in this one."""
    of, paths, *_ = CASES[case]
    found = bw.gradient(of, of=paths, loss=far, device=device, schedule=schedule_back)
    loss, near = loss_of(case), CASES[case].near
    assert found.loss[0] == pytest.approx(loss, rel=1e-5)
    slopes, sizes = (
        {path: slope_of(case, path) for path in paths},
        {path: abs(value_at(of, path)) or 1.0 for path in paths},
    )
    most = max(abs(slopes[path]) * size for path, size in sizes.items())
    for path, size in sizes.items():
        off, allowed = abs(found.gradients[path][0] - slopes[path]), near * abs(slopes[path]) + 1e-5 * most / size
        assert off <= allowed or off <= rounding(case, slope_of, path), path
    if CASES[case].shifts:
        tracks = zip((found.by_points, found.by_velocities), random_shifts(of), strict=True)
        parts = [(np.concatenate(track) * shift).sum() for track, shift in tracks]
        off, allowed = abs(sum(parts) - slope_by_start(case)), CASES[case].dot * max(map(abs, parts))
        assert off <= allowed or off <= rounding(case, slope_by_start)


@pytest.mark.full
@pytest.mark.parametrize("case", [name for name, case in CASES.items() if any(case.small)])
def test_small_spheres_meet_faces(case: str):
    assert tuple(run(CASES[case].scene).reference.small_contacts) == CASES[case].small


IN_BATCHES = [
    *("frames", "gas", "Mooney and Rivlin's rubber", "Gent's rubber", "ground", "gas on the ground", "wind", "water"),
    *("pump, leak and jet", "two tubes", "gas among obstacles", "by obstacles", "ridges for a frame", "exchange"),
    *("gas beside spheres", "exchange with faces", "a fast small sphere", "a small sphere and faces as one"),
    "touch as said",
]


@pytest.mark.parametrize(("case", "way"), cases(IN_BATCHES))
def test_a_world_of_a_batch_has_the_gradients_that_it_has_alone_and_the_frames_of_a_run(
    case: str, way: str, schedule_back: str, device: str
):
    """Bits are the same: eight worlds, with one more, add up in the order of eight particles of one."""
    of, paths, *_ = CASES[case]
    worlds = 9 if way == "lanes" else 2
    vary = {path: value_at(of, path) * np.linspace(1.0, 1.02, worlds) for path in paths[:2]}
    asked: dict[str, Any] = {"of": paths, "loss": far, "device": device, "schedule": schedule_back}
    found = bw.gradient(of, world_count=worlds, vary=vary, **asked)
    for world in (0, worlds - 1):
        alone = bw.gradient(of, vary={path: values[world : world + 1] for path, values in vary.items()}, **asked)
        assert alone.loss[0] == found.loss[world]
        for path in paths:
            assert alone.gradients[path][0] == found.gradients[path][world], path
        for one, among in zip(alone.by_points, found.by_points, strict=True):
            np.testing.assert_array_equal(one, among[world])
    assert found.loss[0] != found.loss[-1]
    schedule = "gather" if way == "launched" else "octets" if device == "cpu" else "block"
    told = bw.simulate(of, device=device, schedule=schedule, world_count=worlds, vary=vary)
    for name in ("points", "velocities"):
        for ours, theirs in zip(getattr(found.trajectories, name), getattr(told, name), strict=True):
            np.testing.assert_array_equal(ours, theirs)
    for name in ("pressures", "sphere_positions"):
        np.testing.assert_array_equal(getattr(found.trajectories, name), getattr(told, name))


def test_eight_worlds_have_the_gradients_of_eight_particles_of_one():
    """Gas in triangles, whose rows of lanes a compiler mixed up in vectors of more than eight numbers."""
    of = scene("gas", substeps=12, mesh=TRIANGLES)
    alone, among = (
        bw.gradient(of, of=["gravity"], loss=far, world_count=worlds, device="cpu", schedule="lanes")
        for worlds in (1, 2)
    )
    np.testing.assert_array_equal(among.by_points[0][1], alone.by_points[0])


@pytest.mark.full
def test_slack_rubber_leaves_no_trace_in_worlds_beside_it():
    """Eight worlds of which some are slack are computed otherwise than taut ones alone, with the same bits."""
    of = scene(frames=6, substeps=24, material={"kind": "mooney_rivlin"})
    pressures = np.array([300.0, 20.0, 0.0])

    def points(values: np.ndarray) -> np.ndarray:
        vary = {f"balloon.0.inflation.pressure.{key}.1": values for key in (0, 1)}
        return bw.simulate(of, vary=vary, world_count=3, device="cpu", schedule="lanes").points[0]

    mixed = points(pressures)
    for world, pressure in enumerate(pressures):
        np.testing.assert_array_equal(mixed[world], points(np.full(3, pressure))[0])
    sizes = np.ptp(mixed[:, -1], axis=1).min(axis=-1) / np.ptp(mixed[:, 0], axis=1).min(axis=-1)
    assert sizes[0] > 1.5 > 1.02 > sizes[1]


@pytest.mark.full
@pytest.mark.parametrize("smooth", [False, True])
def test_spheres_that_push_bounce_and_slip_have_the_slopes_of_the_reference(smooth: bool, device: str):
    """Two spheres meet on the ground, a box, a plane that is a mesh's side, and a capsule; one presses the ball. Along
    directions in which each path makes as much of the loss, to 2e-4 of the part of one of them; of smooth ones, by
    friction and restitution, to 1e-4 of it."""
    of, told, paths = meeting(SLAB, smooth), meeting(PLANE, smooth), OF_RUBBING if smooth else OF_MEETING
    found = bw.gradient(of, of=paths, loss=ends, device=device).gradients
    signs = np.random.default_rng(6).choice([-1.0, 1.0], size=(2, len(paths)))
    for each in np.ones((1, len(paths))) if smooth else signs:
        steps = {path: 1e-7 * sign / found[path][0] for path, sign in zip(paths, each, strict=True)}
        near = 1e-4 if smooth else 2e-4 * np.sqrt(len(paths))
        assert ends_along(told, steps) / 1e-7 == pytest.approx(each.sum(), abs=near)


@pytest.mark.full
def test_a_sphere_that_has_yet_to_begin_changes_no_derivative(device: str):
    of, paths = scene(ground=True), ["gravity", "balloon.mass"]
    late = bw.Sphere(position=(0.0, 2.0, 0.0), radius=0.2, mass=0.5, velocity=(2.0, 0.0, 0.0), start=1.0)
    beside = of.model_copy(update={"sphere": [late], "contact": "impulse", "faces": False})
    asked: dict[str, Any] = {"of": paths, "loss": bw.losses.height(1.0), "device": device, "schedule": "launched"}
    alone, together = (bw.gradient(each, **asked).gradients for each in (of, beside))
    for path in paths:
        assert together[path][0] == pytest.approx(alone[path][0], rel=1e-6), path


@wp.func
def blow(velocity: wp.vec3, mass_share: float, blowing: float):
    """Return the force of a user's law: against the square of the speed."""
    return (-blowing * mass_share * wp.length(velocity)) * velocity


OWN = bw.Law("particle", blow, (bw.Parameter("blowing", "N s^2/m^2", default=0.2),))


@pytest.mark.full
def test_what_the_reference_does_not_have():
    """Gradients by a user's law and a velocity, above a mesh that moves and turns, agree with differences of float32
    runs to 1%, which is their rounding."""
    below = {"mesh": trimesh.creation.box((2.0, 0.5, 2.0)), "position": (0.0, -0.335, 0.0), "friction": 0.2}
    below["motion"] = [(0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.5, 1.0), (20.0, 0.0, 0.0))]
    of = scene(frames=2, obstacle=[below], faces=False)
    values = {"balloon.law.blow.blowing": 0.2, "balloon.velocity.1": -1.0}
    asked: dict[str, Any] = {"loss": far, "device": "cpu", "laws": (OWN,)}
    found = bw.gradient(of, of=list(values), **asked).gradients
    for path, value in values.items():
        vary = {path: [0.98 * value, 1.02 * value]}
        less, more = bw.gradient(of, of=[path], world_count=2, vary=vary, **asked).loss
        assert found[path][0] == pytest.approx((more - less) / (0.04 * value), rel=0.01), path
