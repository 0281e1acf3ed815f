"""Deep overlaps of balloons: from the start, or pressed in."""

from dataclasses import replace

import numpy as np
import pytest
from conserved import motion
from overlaps import deepest
from touching import RADIUS, SLACK, VACUUM, ball, centers, touching

from balloon_warp.benchmarks.overlap import surface, winding
from balloon_warp.scene import Inflation, Scene, Touch
from balloon_warp.schedules import SCHEDULES
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


@pytest.fixture(params=SCHEDULES)
def way(request: pytest.FixtureRequest, device: str) -> str:
    """Return each schedule."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return request.param


def test_what_overlaps_at_the_start_comes_apart_gently(way, device):
    """An initial overlap is resolved gently: ten times the overlap begins to push each second, on either side, so that
    no particle gets faster than twice ten times the deepest overlap."""
    balls = [ball(x, 0.15 * x, 0.0, inflation=SLACK) for x in (0.0, 0.7)]
    scene = Scene(balloon=balls, touch=Touch(), **VACUUM)
    simulator = Simulator(scene, device, schedule=way)
    deep, fastest = deepest(simulator), 0.0
    assert deep > 0.25
    for _ in range(60):
        simulator.step()
        fastest = max(fastest, float(np.linalg.norm(motion(simulator)[1], axis=1).max()))
    assert deepest(simulator) == 0.0
    assert fastest < 20.0 * deep


def test_what_starts_deep_is_not_forgotten(way, device):
    """Two soft balls that start a fifth into each other separate fully."""
    balls = [ball(x, 0.0, 0.0, inflation=Inflation(kind="pressure", pressure=5.0)) for x in (-0.4, 0.4)]
    simulator = Simulator(Scene(balloon=balls, touch=Touch(), **VACUUM), device, schedule=way)
    mesh, half = simulator.model.shapes[0].mesh, simulator.model.particle_count // 2
    seen = 0
    for _ in range(6):
        simulator.step()
        points = motion(simulator)[0]
        inside = winding(points[half:], surface(replace(mesh, points=points[:half]))) > 0.9
        assert (simulator.state.holds.numpy()[0, half:, 3][inside] != 0.0).all()
        seen += inside.sum()
    assert seen > 50


@pytest.mark.full
def test_what_is_pressed_in_deep_comes_out_where_it_came_in(way, device):
    """Two balls with a soft skin sink deeper than the search for neighbors reaches, and bounce back."""
    filled = Inflation(kind="pressure", pressure=20.0)
    balls = [ball(x, 0.0, 0.0, velocity=(-x / 0.3, 0.0, 0.0), inflation=filled) for x in (-0.6, 0.6)]
    simulator = Simulator(Scene(balloon=balls, touch=Touch(stiffness=1.0), **VACUUM), device, schedule=way)
    deep = 0.0
    for _ in range(60):
        simulator.step()
        deep = max(deep, deepest(simulator))
    assert deep > 0.2 * RADIUS
    first, second = centers(simulator)[:, 0]
    assert second - first > 1.0 + 2.0 * RADIUS
    assert touching(simulator) == 0
