"""Search for contact pairs, now and then; its result holds until particles have moved too far."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import cube, quad_sphere
from touching import SLACK, VACUUM, ball

from balloon_warp.benchmarks.overlap import distances
from balloon_warp.kernels.contact.boxes import ARE_NEAR, STILL_NEAR
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import build_model, initial_state
from balloon_warp.scene import Balloon, Scene, Touch
from balloon_warp.schedules import make_schedule
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.touch_table import depth_of, surface_of


def gathered(*balls: Balloon) -> GatherSchedule:
    """Return a schedule whose lists can be read, with searches every 8 of 32 substeps."""
    scene = Scene(balloon=list(balls), touch=Touch(thickness=0.04), substeps=32, **VACUUM)
    schedule = make_schedule(build_model(scene, wp.get_device("cpu"), 1), "gather")
    assert isinstance(schedule, GatherSchedule)
    return schedule


def pair(speed: float) -> list[Balloon]:
    """Return two balls in contact; one turns, and recedes from or approaches the other."""
    turning = {"velocity": (speed, 0.0, 0.0), "angular_velocity": (0.0, 0.0, 2.0 * speed)}
    return [ball(0.0, 0.0, 0.0, inflation=SLACK, **turning), ball(1.01, 0.1, 0.0, inflation=SLACK)]


@pytest.mark.parametrize(("speed", "does"), [(0.0, STILL_NEAR), (5.0, ARE_NEAR)])
def test_only_what_moves_is_looked_for_again(speed, does):
    schedule = gathered(*pair(speed))
    schedule.advance_frame(initial_state(schedule.model))
    assert schedule.launches.working.near_balloons.numpy()[0, -1] == int(does)


@pytest.mark.full
@pytest.mark.parametrize("speed", [0.3, 4.0])
def test_whatever_is_touched_is_on_the_list(speed):
    """Every particle nearer to another balloon than surfaces begin to push is on the list, in some substeps."""
    schedule = gathered(*pair(speed), ball(2.1, 0.0, 0.0, velocity=(-2.0 * speed, 0.0, 0.0), inflation=SLACK))
    model, working = schedule.model, schedule.launches.working
    corners = schedule.tables.touch.triangles.numpy()
    balloons = schedule.tables.particles.balloon.numpy()
    of_triangle, offsets = balloons[corners[:, 0]], model.particle_offsets
    state, touched = initial_state(model), 0
    for _frame in range(3):
        for substep in schedule.substeps(state):
            if substep % 7 != 3:  # between searches, too
                continue
            points = (
                (schedule.launches._second["point"] if substep % 2 == 0 else state.points).numpy()[0].astype(np.float64)
            )
            counts, candidates = working.candidate_counts.numpy()[0], working.candidates.numpy()[0].T
            listed = set(working.particle_lists.numpy()[0, 1, : working.list_lengths.numpy()[0, 1]].tolist())
            for particle, point in enumerate(points):
                own = balloons[particle]
                for other in range(model.balloon_count):
                    others = points[offsets[other] : offsets[other + 1]]
                    if other == own or np.linalg.norm(others - point, axis=1).min() > 0.14:
                        continue
                    triangles = np.flatnonzero(of_triangle == other)
                    away = distances(point, points[corners[triangles]])
                    if away.min() < 0.04:
                        known = set((candidates[: counts[particle], particle] // 4).tolist())
                        assert particle in listed
                        assert known & set(triangles[away < away.min() + 1e-6].tolist())
                        touched += 1
    assert touched > 20


@pytest.mark.parametrize("mesh", [cube(), quad_sphere(4)], ids=["cube", "ball"])
def test_surfaces_are_cut_alike_wherever_they_are(mesh: PolygonMesh):
    """The division of surfaces does not depend on their place: rounding does not break ties between axes and triangles
    of a symmetric mesh, and a cube of one quad a side, as large as an edge is long, is flat nowhere. A world of a batch
    would differ from the same alone."""
    for place in np.random.default_rng(1).uniform(-9.0, 9.0, (20, 3)):
        moved = replace(mesh, points=mesh.points + place)
        np.testing.assert_array_equal(surface_of(moved).triangles, surface_of(mesh).triangles)
        assert depth_of(moved) == pytest.approx(depth_of(mesh))
