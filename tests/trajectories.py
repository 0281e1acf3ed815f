"""Runs of a scene in two schedules, and the tolerance of their difference; bundled scenes, simulated once for all."""

from dataclasses import replace
from functools import cache

import numpy as np

from balloon_warp import Frame, PolygonMesh, load_scene
from balloon_warp.model import Model
from balloon_warp.scene import Scene
from balloon_warp.scene.load import Override
from balloon_warp.simulator import Simulator

ROUNDING = 1e-5
"""Difference allowed after a short run [m], of bodies some meters large: a float32 there is rounded by up to 2e-7, a
run adds some ten of those, and springs and contacts pass them on. Longer runs differ by more, since colliding bodies
are chaotic: a difference doubles every few frames."""


def stepped(simulator: Simulator, frames: int) -> Simulator:
    for _ in range(frames):
        simulator.step_unread()
    return simulator


def after_frames(scene: Scene, schedule: str, device: str, frames: int = 3, worlds: int = 1) -> Simulator:
    return stepped(Simulator(scene, device, worlds, schedule=schedule), frames)


def arrays(simulator: Simulator) -> dict[str, np.ndarray]:
    return {name: array.numpy().copy() for name, array in simulator.state.arrays.items()}


def advance_both(
    scene: Scene, schedule: str, device: str, settled: int, frames: int, settled_by: str = "scatter"
) -> list[dict[str, np.ndarray]]:
    """Return the states that `schedule` and `scatter` reach from one that `settled_by` reached after `settled` frames,
    and the latter."""
    start, expected = _scatters_way(_Same(scene), device, settled, frames, settled_by)
    return [arrays(_from(start, scene, schedule, device, frames)), expected, start]


class _Same:
    """Key of a scene by identity."""

    def __init__(self, scene: Scene):
        self.scene = scene

    def __hash__(self) -> int:
        return id(self.scene)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.scene is other.scene


@cache
def _scatters_way(
    same: _Same, device: str, settled: int, frames: int, settled_by: str
) -> tuple[dict[str, np.ndarray], ...]:
    """Return the start and the result of `scatter`, once for all the schedules that are compared with it."""
    start = arrays(after_frames(same.scene, settled_by, device, settled))
    return start, arrays(_from(start, same.scene, "scatter", device, frames))


def _from(start: dict[str, np.ndarray], scene: Scene, schedule: str, device: str, frames: int) -> Simulator:
    simulator = Simulator(scene, device, schedule=schedule)
    for name, array in start.items():
        simulator.state.arrays[name].assign(array)
    return stepped(simulator, frames)


def tolerance_of(scene: Scene) -> float:
    """Return the tolerance of a scene by its features: with fresh normals a particle between two faces may take the
    area of either, by which normal forces go; and whether a spring is corrected, and pulls, hangs on the rounding of
    its length, and c / h on that of c, and which of two triangles a particle touches on that of its distances:
    differences grow fourfold each frame."""
    pushed = any(balloon.inflation.kind == "normal_force" for balloon in scene.balloon)
    steady = scene.normals == "cached" or not pushed
    return ROUNDING if steady and scene.correction == "none" and not scene.touches else 10 * ROUNDING


def assert_close(
    found: dict[str, np.ndarray], expected: dict[str, np.ndarray], tolerance: float, outliers: float = 0.0
) -> None:
    """Require that all but some of the particles are close, and that these outliers are not far off."""
    for name in ("points", "sphere_positions"):
        apart = np.abs(found[name] - expected[name]).max(axis=-1, initial=0.0)
        assert (apart > tolerance).sum() <= outliers * apart.size, (name, apart.max())
        assert apart.max(initial=0.0) <= 10 * tolerance, (name, apart.max())
    # The flow through a tear goes by the square root of a pressure that is rounded, see below, and changes with points.
    np.testing.assert_allclose(found["gas_amounts"], expected["gas_amounts"], rtol=1e-6 * tolerance / ROUNDING)
    # A float32 volume is rounded by up to 1e-7 of itself, and so the pressure by that of the air's, over some frames,
    # in which forward Euler does not damp it. Where a point may be off by 1e-4 m, it alone changes the volume of a
    # balloon of 100 particles by 1e-5 of itself: by 1 Pa more.
    of_points = 1e4 * (tolerance - ROUNDING)
    np.testing.assert_allclose(found["pressures"], expected["pressures"], rtol=0, atol=0.5 + of_points)
    np.testing.assert_array_equal(found["frame"], expected["frame"])


BRISKLY: dict[str, tuple[Override, ...]] = {
    "balloon_pit": (("frames", 160),),
    "pop": (("balloon.0.mesh", "ball.obj"), ("balloon.1.mesh", "ball.obj"), ("frames", 520)),
}
"""values that make scenes that take a minute shorter: frames in which all lies still; and a coarser mesh, whose pieces
lie as well (test_burst_outputs.py bursts the fine one)"""


@cache
def played(name: str, overrides: tuple[Override, ...] = ()) -> tuple[Model, list[Frame]]:
    simulator, frames, _ = _simulated(name, overrides)
    return simulator.model, frames


def most_held(name: str) -> int:
    """Return the largest number of particles in any frame that a sharp edge holds."""
    return max(_simulated(name, ())[2])


@cache
def _simulated(name: str, overrides: tuple[Override, ...]) -> tuple[Simulator, list[Frame], list[int]]:
    """Return the simulator, its frames, and how many particles are held in each."""
    simulator, frames, held = Simulator(load_scene(name, (*BRISKLY.get(name, ()), *overrides)), "cpu"), [], []
    for frame in simulator.run():
        frames.append(frame)
        held.append(int((simulator.state.holds.numpy()[0, :, 3] != 0.0).sum()))
    return simulator, frames, held


def shape_at(model: Model, frame: Frame, balloon: int = 0) -> PolygonMesh:
    return replace(model.shapes[balloon].mesh, points=frame.points[balloon].astype(np.float64))


def stretches(model: Model, frame: Frame) -> np.ndarray:
    """Return length over rest length of the springs."""
    springs = model.shapes[0].springs
    first, second = frame.points[0].astype(np.float64)[springs.pairs].swapaxes(0, 1)
    return np.linalg.norm(second - first, axis=1) / springs.rest_lengths
