"""Rest: motion without drift, and no larger than rounding."""

from types import SimpleNamespace

import numpy as np
import pytest

from balloon_warp.errors import InputError
from balloon_warp.resting import relax

pytestmark = pytest.mark.physics

RATE, SUBSTEPS = 60, 1000
PLACE = float(np.spacing(np.float32(0.2)))


class Trembling:
    """Particle 0.2 m from the origin that drifts from frame to frame, and trembles within it."""

    def __init__(self, drift: float, trembles: float):
        self.model = SimpleNamespace(scene=SimpleNamespace(frames_per_second=RATE), substeps=SUBSTEPS)
        self._point, self._drift, self._trembles, self.frames = 0.2, drift, trembles, 0

    @property
    def state(self) -> SimpleNamespace:
        point = np.array([[[self._point, 0.0, 0.0]]])
        velocity = np.array([[[0.0, self._trembles, 0.0]]])
        return SimpleNamespace(
            points=SimpleNamespace(numpy=lambda: point), velocities=SimpleNamespace(numpy=lambda: velocity)
        )

    def step_unread(self) -> None:
        self._point += self._drift / RATE
        self.frames += 1


def test_rounding_of_short_steps_does_not_count_as_motion():
    """A jitter of one unit in the last place, 1.5e-8 m * 60,000 / s or 0.9 mm/s, is at rest."""
    one_place = PLACE * RATE * SUBSTEPS
    assert one_place > 8e-4
    rests = Trembling(drift=0.0, trembles=10.0 * one_place)
    relax(rests, 1e-4, 1.0)
    assert rests.frames < 10


@pytest.mark.parametrize(("drift", "places"), [(2e-4, 0.0), (0.0, 100.0)], ids=["drifts", "trembles"])
def test_what_drifts_or_really_trembles_is_not_at_rest(drift: float, places: float):
    moves = Trembling(drift, places * PLACE * RATE * SUBSTEPS)
    with pytest.raises(InputError, match="the fastest particle still moves at"):
        relax(moves, 1e-4, 0.5)
