"""Gradients on workers: each derives the loss of some of the worlds, and together they give those of one process."""

import re
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from clusters import start_workers
from meshes import quad_sphere

from balloon_warp import Balloon, BlowUpError, Cluster, Inflation, InputError, Scene, Trajectories, gradient

pytest.importorskip("distributed", reason="needs the extra `cluster`")

SCENE = Scene(
    balloon=[Balloon(mesh=quad_sphere(3, 0.2), mass=0.2, inflation=Inflation(pressure=40.0))], frames=3, substeps=8
)
STIFFNESS, MASS = "balloon.stiffness.structural", "balloon.mass"
WORLDS = 5
VARY = {STIFFNESS: np.linspace(40.0, 60.0, WORLDS), MASS: np.linspace(0.1, 0.3, WORLDS)}
HEIGHTS = np.linspace(0.0, 0.4, WORLDS)
"""Targets of all worlds [m], of which a worker has some"""


def far(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return how far particles end from the height of the world's target, squared, and the derivatives."""
    points = moved.points[0].reshape(len(moved.worlds), *moved.points[0].shape[-3:])
    off = points[:, -1, :, 1] - HEIGHTS[moved.worlds, None]
    slopes = np.zeros(points.shape)
    slopes[:, -1, :, 1] = 2.0 * off
    return (off**2).sum(axis=1), {"points": [slopes.reshape(moved.points[0].shape)]}


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    """Two workers on this machine."""
    with start_workers(2) as workers:
        yield Cluster(address=str(workers.scheduler_address))


@pytest.mark.parametrize("world_count", [1, WORLDS])
def test_workers_give_the_bits_of_one_process(cluster: Cluster, world_count: int) -> None:
    """Two workers take three worlds and two, with the targets of their own; of a single world one takes all."""
    vary = {path: values[:world_count] for path, values in VARY.items()}
    asked: dict[str, Any] = {"of": [STIFFNESS, MASS], "loss": far, "world_count": world_count, "device": "cpu"}
    alone = gradient(SCENE, **asked, vary=vary)
    frames: list[int] = []
    together = gradient(SCENE, **asked, vary=vary, cluster=cluster, on_frame=frames.append)
    np.testing.assert_array_equal(together.loss, alone.loss)
    for path, values in alone.gradients.items():
        np.testing.assert_array_equal(together.gradients[path], values)
        assert values.all()
    for name in ("by_points", "by_velocities"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))
    for name in ("points", "velocities", "pressures", "gas_amounts", "sphere_positions", "worlds"):
        np.testing.assert_array_equal(getattr(together.trajectories, name), getattr(alone.trajectories, name))
    assert frames == sorted(frames)
    assert frames[-1] == 2 * SCENE.frames + 1


def test_a_world_that_blows_up_on_a_worker_has_its_own_number(cluster: Cluster) -> None:
    vary = {"balloon.inflation.pressure": [40.0, 40.0, 40.0, 1e11]}
    with pytest.raises(BlowUpError) as alone:
        gradient(SCENE, of=[MASS], loss=far, world_count=4, vary=vary, device="cpu")
    with pytest.raises(BlowUpError, match=re.escape(str(alone.value))):
        gradient(SCENE, of=[MASS], loss=far, world_count=4, vary=vary, device="cpu", cluster=cluster)
    assert "world 3" in str(alone.value)


def test_a_loss_that_cannot_be_sent_is_refused() -> None:
    lock = threading.Lock()

    def locked(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
        with lock:
            return far(moved)

    with pytest.raises(InputError, match=r"^loss: cannot be sent to other processes \(workers 2\): "):
        gradient(SCENE, of=[MASS], loss=locked, world_count=2, cluster=Cluster(workers=2))
