"""Stack of balloons that stands."""

import numpy as np
import pytest
from conserved import motion
from touching import centers

from balloon_warp.benchmarks.standing import stack
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


@pytest.mark.full
def test_a_stack_of_five_stands_still(schedule, device):
    """Boxes of soft rubber, dropped on each other a little askew, stand two seconds later; none has slipped off, and
    the highest moves by an invisible thousandth of its size a second."""
    simulator = Simulator(stack(), device, schedule=schedule)
    start = centers(simulator)
    for _ in range(150):
        simulator.step()
    before = centers(simulator)
    for _ in range(60):
        simulator.step()
    after = centers(simulator)
    assert np.abs(after - start).max() < 0.05  # as they were put, but for the weight
    assert np.linalg.norm(after - before, axis=1).max() < 1e-3
    assert np.linalg.norm(motion(simulator)[1], axis=1).max() < 0.05
    assert (np.diff(after[:, 1]) > 0.98).all()
