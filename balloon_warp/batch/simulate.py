"""A scene in, arrays of all motion out: a simulation in one call."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.batch.recorder import BatchVary, Group, plan_groups
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import signed_volume, total_area
from balloon_warp.model import lay_out, worlds_of
from balloon_warp.model.state import require_memory
from balloon_warp.model.timeline import scene_to_vary
from balloon_warp.scene import Scene, SceneLike
from balloon_warp.scene.load import Override
from balloon_warp.simulator import Simulator
from balloon_warp.system.arguments import checked
from balloon_warp.system.shown import Shown, described
from balloon_warp.system.warp_threads import lock_of, pick_device


@described
@dataclass(frozen=True, repr=False)
class Trajectories(Shown):
    """Motion of everything in a scene, as arrays of NumPy.

    With several worlds, all but `times` and `worlds` have world_count as their first dimension, before those named
    here.
    """

    scene: Scene
    meshes: list[PolygonMesh]
    """Meshes of the balloons at the start: names, faces"""
    times: NDArray[np.float64]
    """Times of the frames [s], shape (frame_count,): the start, and then each recorded one"""
    points: list[NDArray[np.float32]]
    """Positions of each balloon's particles [m], shape (frame_count, particle_count, 3)"""
    velocities: list[NDArray[np.float32]]
    """Velocities of each balloon's particles [m/s], shape (frame_count, particle_count, 3)"""
    pressures: NDArray[np.float32]
    """Gauge pressures of balloons with pressure or gas [Pa], 0 for others, shape (frame_count, balloon_count)"""
    gas_amounts: NDArray[np.float64]
    """Amount of gas in each balloon [mol], shape (frame_count, balloon_count)"""
    sphere_positions: NDArray[np.float32]
    """Positions of spheres [m], shape (frame_count, sphere_count, 3)"""
    sphere_velocities: NDArray[np.float32]
    """Velocities of spheres [m/s], shape (frame_count, sphere_count, 3)"""
    worlds: NDArray[np.int64]
    """Numbers of the worlds, shape (world_count,): not all, where a loss is asked on one of several workers"""

    @cached_property
    def volumes(self) -> NDArray[np.float64]:
        """Volume of each balloon [m^3], shape (frame_count, balloon_count): the enclosed one, where it is closed."""
        return self._measured(signed_volume)

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """Area of each balloon [m^2], shape (frame_count, balloon_count)."""
        return self._measured(total_area)

    def _measured(self, measure: Callable[[PolygonMesh], float]) -> NDArray[np.float64]:
        columns = []
        for mesh, points in zip(self.meshes, self.points, strict=True):
            shapes = points.reshape(-1, *points.shape[-2:]).astype(np.float64)
            column = [measure(replace(mesh, points=shape)) for shape in shapes]
            columns.append(np.array(column).reshape(points.shape[:-2]))
        return np.stack(columns, axis=-1)

    def __repr__(self) -> str:
        *worlds, frames = self.pressures.shape[:-1]
        names = ", ".join(f"{mesh.name} of {mesh.vertex_count} particles" for mesh in self.meshes)
        many = f"{worlds[0]} worlds, " if worlds else ""
        return f"Trajectories({names}; {many}{frames} frames, {self.times[0]:g} to {self.times[-1]:g} s)"


@checked
def simulate(
    scene: SceneLike,
    overrides: Mapping[str, Any] | Iterable[Override] = (),
    *,
    world_count: int | None = None,
    vary: BatchVary | None = None,
    every: int = 1,
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    on_frame: Callable[[int], None] = lambda number: None,
) -> Trajectories:
    """Simulate a scene from start to end, and return the motion of everything.

    Args:
        scene: Scene, name of a bundled one, scene file, or mesh, as a file or in memory.
        overrides: Dotted paths and values, as in `load_scene`: {"frames": 60, "balloon.mass": 2.0}.
        world_count: Number of worlds, copies of the scene side by side; as many as `vary` has values, if not given.
        vary: Values that differ between worlds: dotted paths, and a value for each world.
        every: Interval of recorded frames: 2 records every second one.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`.
        on_frame: Called with the number of each simulated frame.

    Raises:
        InputError: the scene cannot be simulated, a varied value is wrong or makes other meshes, or the trajectories do
            not fit into the memory.
        BlowUpError: a world blew up.
    """
    scene = scene_to_vary(scene, vary, overrides)
    if every < 1:
        raise InputError(f"every: must be at least 1 (got {every})")
    world_count = worlds_of(world_count, vary)
    groups = plan_groups(scene, world_count, vary or {}, laws)
    meshes = [shape.mesh for shape in groups[0].plan.shapes]
    tracks, target = empty_tracks(groups, world_count, scene.frames // every + 1), pick_device(device)
    for group in groups:
        with lock_of(target):
            simulator = Simulator.of_model(lay_out(group.plan, target), schedule)
        for number in range(scene.frames + 1):
            if number:
                simulator.step_unread()
            if number % every == 0:
                record(tracks, simulator, group, number // every)
            on_frame(number)
    times = np.arange(0, scene.frames + 1, every) / scene.frames_per_second
    return Trajectories(scene, meshes, times, **by_balloon(tracks, meshes), worlds=np.arange(world_count))


def empty_tracks(groups: Sequence[Group], world_count: int, frames: int) -> dict[str, NDArray]:
    """Return the room for all that is recorded, by the names of the state's arrays, shape (world_count, frames, ...).

    Raises:
        InputError: it does not fit, or the groups are of other meshes.
    """
    plan = groups[0].plan
    if any(group.plan.particle_count != plan.particle_count for group in groups):
        raise InputError("vary: meshes of different sizes need separate trajectories; expected one mesh, or run_batch")
    particles, spheres, balloons = plan.particle_count, len(plan.scene.sphere), len(plan.shapes)
    require_memory(pick_device("cpu"), [world_count], [frames * 24 * (particles + spheres + balloons)])

    def room(*shape: int, dtype: Any = np.float32) -> NDArray:
        return np.zeros((world_count, frames, *shape), dtype=dtype)

    return {
        "points": room(particles, 3),
        "velocities": room(particles, 3),
        "pressures": room(balloons),
        "gas_amounts": room(balloons, dtype=np.float64),
        "sphere_positions": room(spheres, 3),
        "sphere_velocities": room(spheres, 3),
    }


def record(tracks: Mapping[str, NDArray], simulator: Simulator, group: Group, place: int, first: int = 0) -> None:
    """Write down where a group's worlds are; the number of the world that tracks begin with is `first`.

    Raises:
        BlowUpError: a world blew up.
    """
    rows = group.worlds - first
    for name, track in tracks.items():
        if track.size:
            with lock_of(simulator.model.device):
                track[rows, place] = getattr(simulator.state, name).numpy()
            finite = np.isfinite(track[rows, place]).reshape(len(rows), -1).all(axis=1)
            if not finite.all():
                raise BlowUpError(simulator.diagnose(int(finite.argmin()), simulator.frame_number))


def by_balloon(tracks: dict[str, NDArray], meshes: Sequence[PolygonMesh]) -> dict[str, Any]:
    """Split the tracks as `Trajectories` has them: particles by balloon, and a single world without its dimension."""
    ends = np.cumsum([mesh.vertex_count for mesh in meshes])[:-1]
    alone = len(tracks["pressures"]) == 1
    found: dict[str, Any] = {name: track[0] if alone else track for name, track in tracks.items()}
    return found | {name: np.split(found[name], ends, axis=-2) for name in ("points", "velocities")}
