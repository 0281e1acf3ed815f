"""Saved simulators whose worlds begin anew: what they draw next."""

import numpy as np
import warp as wp
from meshes import quad_sphere

from balloon_warp import Simulator
from balloon_warp.scene import Balloon, Inflation, Scene

ALONE = Scene(balloon=[Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(pressure=5.0))], substeps=24)


def test_a_saved_simulator_draws_next_what_it_would_have_drawn():
    """Values of the next episodes follow from the saved seed and episodes, in another simulator and in itself."""

    def drawn(simulator: Simulator) -> wp.array:
        simulator.starts.draw("balloon.damping", 0.1, 0.9)
        return simulator.starts.value("goal", 0.0, 1.0)

    simulator, other = (Simulator(ALONE, "cpu", 2) for _ in range(2))
    goals = {id(each): drawn(each) for each in (simulator, other)}
    simulator.starts.seed = 7
    for mask in ([1, 1], [0, 1], [0, 1]):
        simulator.step_unread()
        simulator.reset(mask)
    saved = simulator.save()
    kept = goals[id(simulator)].numpy().copy()

    def next_of(each: Simulator) -> tuple[np.ndarray, np.ndarray]:
        each.step_unread()
        each.reset([1, 1])
        return each.controls["balloon.damping"].numpy().copy(), goals[id(each)].numpy().copy()

    told = next_of(simulator)
    for each in (other, simulator):
        each.restore(saved)
        np.testing.assert_array_equal(goals[id(each)].numpy(), kept)
        np.testing.assert_array_equal(next_of(each), told)
    assert len(np.unique([*kept, *told[1]])) == 4
