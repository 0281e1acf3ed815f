"""Free rigid bodies that stand on each other, lie, lean and ride: bodies in equilibrium stay at rest."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from meshes import cube
from numpy.typing import NDArray
from rigid import SPACE, after, body_energy, body_state, kinetic, moved, started

from balloon_warp.scene import Body, Ground, Obstacle
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

MOST_WAY, MOST_TURN = 1.0e-3, 0.5
"""[m] and [degrees]: what nobody sees. They stay to some micrometers; `kernels.laws.grip` leaves overlaps of a
hundred-thousandth of their size"""
MOST_GAIN = 1.0e-4
"""of the energy, by where their velocities stop to agree"""


@dataclass
class Watched:
    """Simulator of bodies, with what was recorded on the way."""

    simulator: Simulator
    way: float
    turn: float
    gain: float
    """the most energy that they had beyond what they started with, over that"""


def watched(device: str, *bodies: Body, seconds: float = 10.0, **fields: Any) -> Watched:
    setting: dict[str, Any] = {"ground": Ground(), "gravity": 9.81, "substeps": "auto", "frames_per_second": 60.0}
    simulator, start = (started(device, *bodies, **setting | fields) for _ in range(2))
    energy, most = body_energy(start), -np.inf
    for _ in range(round(seconds * 60.0)):
        simulator.step()
        most = max(most, body_energy(simulator))
    return Watched(simulator, *moved(simulator, start), most / energy - 1.0)


def require_rest(found: Watched) -> None:
    assert found.way < MOST_WAY
    assert found.turn < MOST_TURN
    assert found.gain < MOST_GAIN


def box(x: float, y: float, size: tuple[float, float, float] = (0.3, 0.2, 0.3), **fields: Any) -> Body:
    return Body(size=size, position=(x, y, 0.0), **fields)


def stack(*masses: float, **fields: Any) -> list[Body]:
    """Return boxes of those masses on each other, the first at the bottom."""
    return [box(0.0, 0.1 + 0.2 * number, mass=mass, **fields) for number, mass in enumerate(masses)]


@pytest.mark.full
@pytest.mark.parametrize("count", [1, 2, 5, 8])
def test_a_stack_stands(count, device):
    require_rest(watched(device, *stack(*[1.0] * count)))


@pytest.mark.full
def test_a_stack_stands_for_a_minute(device):
    require_rest(watched(device, *stack(*[1.0] * 5), seconds=60.0))


@pytest.mark.parametrize("substeps", ["auto", 13])
@pytest.mark.parametrize("masses", [(1, 10), (1, 100), (1, 1000), (1, 1, 1, 1, 100), (10, 5, 2, 1, 0.5)])
def test_what_is_heavy_stands_on_what_is_light(masses, substeps, device):
    require_rest(watched(device, *stack(*masses), seconds=3.0, substeps=substeps))


@pytest.mark.parametrize("way", ["scatter", "block"])
def test_every_schedule_stacks_alike(way, device):
    """Schedules agree on a stack, also on one that comes down, but for how sums are rounded."""
    bodies = [box(0.004 * number, 0.11 + 0.21 * number, rotation=(0, 9.0 * number, 0)) for number in range(3)]
    found, expected = (
        after(started(device, *bodies, schedule=schedule, ground=Ground(), gravity=9.81), 60)
        for schedule in (way, "gather")
    )
    for name in ("positions", "turns", "velocities"):
        np.testing.assert_allclose(body_state(found, name), body_state(expected, name), atol=2e-4)


def test_a_stack_that_is_dropped_comes_to_rest_and_gains_no_energy(device):
    bodies = [box(0.005 * number, 0.12 + 0.23 * number, rotation=(0, 7.0 * number, 0)) for number in range(5)]
    found = watched(device, *bodies, seconds=4.0)
    assert found.gain <= 0.0
    heights = body_state(found.simulator, "positions")[:, 1]
    np.testing.assert_allclose(heights, 0.1 + 0.2 * np.arange(5), atol=1e-4)
    assert kinetic(found.simulator) < 1e-8


LYING = {"radius": 0.1, "length": 0.5, "rotation": (90, 0, 0), "friction": 0.6}
SCENES: dict[str, list[Body]] = {
    "pole": [box(0.0, 0.5, (0.1, 1.0, 0.1))],
    "thin pole": [box(0.0, 0.5, (0.02, 1.0, 0.02))],
    "wall": [box(0.3 * (i - 0.5 * row), 0.5 - 0.2 * row) for row in range(3) for i in range(row + 1)],
    "pipes": [
        Body(position=(0.2 * (i - 0.5 * row), 0.1 + (2 - row) * 0.1 * 3**0.5, 0.0), **LYING)
        for row in range(3)
        for i in range(row + 1)
    ],
    "meshes": [Body(mesh=cube(), scale=0.3, position=(0.0, 0.15 + 0.3 * number, 0.0)) for number in range(4)],
    "sizes": [box(0.0, 0.2, (0.5, 0.4, 0.4)), box(0.03, 0.45, (0.2, 0.1, 0.25)), box(0.0, 0.65, (0.4, 0.3, 0.3))],
    "shelf": [
        *(box(x, 0.15, (0.2, 0.3, 0.4)) for x in (-0.8, 0.8)),
        box(0.0, 0.35, (2.0, 0.1, 0.3)),
        box(0.0, 0.45, (0.2, 0.1, 0.2), mass=5.0),
    ],
}


@pytest.mark.full
@pytest.mark.parametrize("name", SCENES)
def test_what_stands_stays(name, device):
    found = watched(device, *SCENES[name], seconds=5.0)
    assert found.turn < MOST_TURN
    assert found.gain < MOST_GAIN
    assert found.way < MOST_WAY + (0.15 if name == "meshes" else 0.0)  # a mesh is put where its origin is


@pytest.mark.full
@pytest.mark.parametrize("width", [0.1, 0.2])
def test_a_plank_lies_on_supports_that_no_point_of_it_meets(width, device):
    """Edges of the supports carry a plank whose own contact points are half a meter apart."""
    supports = [Obstacle(size=(width, 0.3, width), position=(x, 0.15, 0)) for x in (-0.8, 0.8)]
    plank = [box(0.0, 0.35, (2.0, 0.1, 0.3)), box(0.0, 0.45, (0.2, 0.1, 0.2), mass=5.0)]
    require_rest(watched(device, *plank, seconds=3.0, obstacle=supports))


@pytest.mark.parametrize("degrees", [20.0, 25.0, 35.0])
def test_two_on_a_slope_stay_or_slide_together(degrees, device):
    """Friction of 0.5 holds two boxes below 26.6 degrees for 20 s; above, they slide with g (sin - friction cos), by
    0.4 m in a second or so."""
    slope = np.radians(degrees)
    out, along = np.array([-np.sin(slope), np.cos(slope), 0.0]), np.array([np.cos(slope), np.sin(slope), 0.0])
    ramp = Obstacle(shape="plane", rotation=(0, 0, degrees), friction=0.5, restitution=0.0)
    boxes = [
        Body(size=(0.4, 0.2, 0.4), position=tuple(height * out), rotation=(0, 0, degrees)) for height in (0.1, 0.3)
    ]
    stays = np.tan(slope) < 0.5
    found = watched(device, *boxes, seconds=20.0 if stays else 1.0, ground=None, obstacle=[ramp])
    if stays:
        require_rest(found)
        return
    expected = -0.5 * 9.81 * (np.sin(slope) - 0.5 * np.cos(slope))
    # a step adds g h T / 2
    np.testing.assert_allclose(body_state(found.simulator, "positions") @ along, expected, rtol=0.01)


@pytest.mark.full
def test_a_stack_rides_on_a_lift(device):
    """A stack stays on a lift that moves by half a meter in two seconds, with less than half of gravity."""
    times = np.arange(0.0, 4.01, 1.0 / 30.0)
    shifts = [(float(time), (0.0, float(0.25 - 0.25 * np.cos(np.pi * time)), 0.0)) for time in times]
    lift = Obstacle(size=(1, 0.2, 1), position=(0, 0.5, 0), motion=shifts)
    boxes = [box(0.0, 0.7 + 0.2 * number) for number in range(3)]
    simulator = started(
        device, *boxes, obstacle=[lift], gravity=9.81, substeps="auto", frames_per_second=60.0, frames=240
    )
    for frame in range(1, 241):
        simulator.step()
        positions: NDArray[np.float64] = body_state(simulator, "positions")
        shift = 0.25 - 0.25 * np.cos(np.pi * frame / 60.0)
        # between its keyframes it goes along lines, which are off by a tenth of a millimeter; as it becomes slower at a
        # keyframe they go on for half a step
        np.testing.assert_allclose(positions[:, 1], 0.7 + shift + 0.2 * np.arange(3), atol=1e-3)
        np.testing.assert_allclose(positions[:, [0, 2]], 0.0, atol=1e-4)


def test_an_overlap_is_shared_by_mass(device):
    """A millimeter of overlap vanishes within some steps, without speed; the common center of mass stays."""
    masses = np.array([1.0, 3.0])
    bodies = [Body(size=(0.3, 0.2, 0.3), position=(0, y, 0), mass=m) for y, m in zip((0.1, 0.299), masses, strict=True)]
    simulator = started(device, *bodies, **SPACE)
    start = body_state(simulator, "positions")
    ways = (body_state(after(simulator, 10), "positions") - start)[:, 1]
    np.testing.assert_allclose(ways, [-0.75e-3, 0.25e-3], atol=3e-6)  # but for what is no overlap, see above
    np.testing.assert_array_equal(body_state(simulator, "velocities"), 0.0)
    np.testing.assert_array_equal(body_state(simulator, "momenta"), 0.0)
