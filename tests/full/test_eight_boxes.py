"""Search for triangles by eight boxes at a time, as on a CPU, and one by one, as on a GPU: the same to the bit."""

import numpy as np
import pytest
import warp as wp

from balloon_warp.mesh.quad_sphere import quad_sphere
from balloon_warp.scene import Balloon, Inflation, Scene, Touch
from balloon_warp.scene.load import load_scene
from balloon_warp.schedules import balloon_contact
from balloon_warp.simulator import Simulator


def heap() -> Scene:
    """Eleven balloons of two sizes that fly together: each is near more than eight others, some have 120 leaves."""
    draw = np.random.default_rng(5)
    balloons = []
    for number in range(11):
        place = draw.normal(size=3)
        place *= (0.0 if number == 0 else 0.62) / np.linalg.norm(place)
        balloons.append(
            Balloon(
                mesh=quad_sphere(8 if number % 2 else 3, 0.3 if number % 2 else 0.2),
                position=tuple(place.tolist()),
                velocity=tuple((-3.0 * place).tolist()),
                inflation=Inflation(kind="pressure", pressure=10.0),
            )
        )
    return Scene(balloon=balloons, touch=Touch(), gravity=0.0)


@pytest.mark.parametrize("name", ["heap", "press"])
def test_eight_boxes_at_a_time_find_what_one_by_one_find(name: str, monkeypatch):
    """Particles find the same triangles in the same order, and move the same, of others' skin and of their own."""
    scene, ends = heap() if name == "heap" else load_scene(name), []
    for eight in (True, False):
        monkeypatch.setattr(balloon_contact, "compares_eight", lambda device, eight=eight: eight)
        simulator = Simulator(scene, wp.get_device("cpu"), schedule="gather")
        for _ in range(6 if name == "heap" else 2):
            simulator.step()
        working = simulator.schedule.launches.working
        assert (working.eight_boxes.shape[1] > 0) == eight
        counts, lists = working.candidate_counts.numpy()[0], working.candidates.numpy()[0]
        listed = [lists[particle, :count] for particle, count in enumerate(counts.tolist())]
        ends.append((counts, np.concatenate(listed), simulator.state.points.numpy(), working.neighbor_counts.numpy()))
    assert ends[0][0].max() > 8 or name == "press"  # in more than one row of eight
    assert ends[0][3].max() > 8 or name == "press"
    for found, expected in zip(*ends, strict=True):
        np.testing.assert_array_equal(found, expected)
