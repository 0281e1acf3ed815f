"""Runs of a scene in two schedules, and how far apart they may be."""

import numpy as np
import warp as wp

from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator

ROUNDING = 1e-5
"""Difference allowed after a short run [m], of bodies some meters large: a float32 there is rounded by up to 2e-7, a
run adds some ten of those, and springs and contacts pass them on. Longer runs differ by more, since colliding bodies
are chaotic: a difference doubles every few frames."""


def after_frames(scene: Scene, schedule: str, device: str, frames: int = 3, worlds: int = 1) -> Simulator:
    simulator = Simulator(scene, device, worlds, schedule=schedule)
    for _ in range(frames):
        simulator.step()
    return simulator


def arrays(simulator: Simulator) -> dict[str, np.ndarray]:
    return {name: array.numpy() for name, array in vars(simulator.state).items()}


def advance_both(scene: Scene, schedule: str, device: str, settled: int, frames: int) -> list[dict[str, np.ndarray]]:
    """The states that `schedule` and `scatter` reach from what `scatter` reached after `settled` frames, and that."""
    start = after_frames(scene, "scatter", device, settled)
    states = []
    for name in (schedule, "scatter"):
        simulator = Simulator(scene, device, schedule=name)
        for field, array in vars(start.state).items():
            wp.copy(getattr(simulator.state, field), array)
        for _ in range(frames):
            simulator.step()
        states.append(arrays(simulator))
    return [*states, arrays(start)]


def tolerance_of(scene: Scene) -> float:
    """With fresh normals a particle between two faces may take the area of either, by which normal forces go; and
    whether a spring is corrected, and pulls, hangs on the rounding of its length, and c / h on that of c: differences
    grow fourfold each frame."""
    pushed = any(balloon.inflation.kind == "normal_force" for balloon in scene.balloon)
    steady = scene.normals == "cached" or not pushed
    return ROUNDING if steady and scene.correction == "none" else 10 * ROUNDING


def assert_close(
    found: dict[str, np.ndarray], expected: dict[str, np.ndarray], tolerance: float, outliers: float = 0.0
) -> None:
    """All but some of the particles; where so many are outliers, those are not far off."""
    for name in ("points", "sphere_positions"):
        apart = np.abs(found[name] - expected[name]).max(axis=-1, initial=0.0)
        assert (apart > tolerance).sum() <= outliers * apart.size, (name, apart.max())
        assert apart.max(initial=0.0) <= 10 * tolerance, (name, apart.max())
    np.testing.assert_allclose(found["gas_amounts"], expected["gas_amounts"], rtol=1e-7)
    # a float32 volume is rounded by up to 1e-7 of itself, and so the pressure by that of the air's, over some frames,
    # in which forward Euler does not damp it
    np.testing.assert_allclose(found["pressures"], expected["pressures"], rtol=0, atol=0.5)
    np.testing.assert_array_equal(found["frame"], expected["frame"])
