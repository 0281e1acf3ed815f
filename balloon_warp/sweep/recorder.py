"""Recording of a batch after each frame: a row of measures for each world, and the shapes of exported ones."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.measure.contacts import note_contacts
from balloon_warp.kernels.measure.health import HEALTHY
from balloon_warp.kernels.measure.picking import pick_healthy_worlds, pick_torn_faces
from balloon_warp.kernels.measure.worlds import BalloonSums, measure_gas, measure_worlds, sum_balloons
from balloon_warp.launching import launch
from balloon_warp.model import ModelPlan
from balloon_warp.reading import HostBuffer
from balloon_warp.scene import Box, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.steering.views import rows_of_words
from balloon_warp.sweep.contacts import COLUMNS, contacts_shape
from balloon_warp.sweep.world_files.tracks import Tracker
from balloon_warp.warp_lock import lock_of, recording, replay

LANES, MANY_LANES, LARGE = 32, 128, 1024
"""Numbers of threads that sum a balloon, and number of particles above which the largest one takes many: that follows
from the scene alone, so that a world's sums do not depend on its batch"""
MEASURES = ("volume", "area", "pressure", "center_height", "largest_stretch", "kinetic_energy")
"""Names of the measures: [m^3], [m^2], [Pa], [m], length over rest length, [J]"""
OF_GAS = ("moles", "mean_stretch", "thrust")
"""Names of the measures of scenes with gas: [mol], root of the area over that at the start, [N]"""


def columns_of(scene: Scene) -> list[str]:
    """List the measures of each world.

    It is `MEASURES`, the heights of spheres and of free bodies [m], how many balloons are in the box, how many have
    burst, and `OF_GAS`.
    """
    heights = [f"sphere_{number}_height" for number in range(len(scene.sphere))]
    heights += [f"body_{number}_height" for number in range(len(scene.body))]
    may_burst = any(balloon.material.strength is not None for balloon in scene.balloon)
    gas = any(balloon.inflation.kind == "gas" for balloon in scene.balloon)
    now_and_then = [*(["in_box"] if scene.box else []), *(["burst"] if may_burst else []), *(OF_GAS if gas else ())]
    return [*MEASURES, *heights, *now_and_then]


@dataclass(frozen=True)
class Record:
    """Frame of a batch, on the host; a world that blew up has its last good frame."""

    number: int
    measures: NDArray[np.float32]
    """Measures in the order of `columns_of`, shape (world_count, columns)"""
    healthy: NDArray[np.int32]
    """1, or 0 from the frame on in which the world blew up, shape (world_count,)"""
    points: NDArray[np.float32]
    """Points of the exported worlds [m], shape (chosen, particle_count, 3)"""
    sphere_positions: NDArray[np.float32]
    """Positions of spheres in the exported worlds [m], shape (chosen, sphere_count, 3)"""
    body_poses: NDArray[np.float32]
    """Poses of bodies in the exported worlds, as `Frame.body_poses`, shape (chosen, body_count, 7)"""
    torn: NDArray[np.int8]
    """Mask of torn faces in the exported worlds, shape (chosen, face_count), or (chosen, 0) where none may tear"""
    contacts: NDArray[np.float32] | None = None
    """Contact measures of each pair over all frames, in the last frame alone, shape (world_count,
    *contacts_shape(plan), len(COLUMNS))"""
    tracks: dict[str, NDArray] | None = None
    """Arrays for the files of worlds, by the names of `TRACKS`, shape (world_count, ...); of worlds that blew up,
    whatever there is"""

    @property
    def shapes(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.int8]]:
        """Shapes of the chosen worlds, in the order of `SHAPES`."""
        return self.points, self.sphere_positions, self.body_poses, self.torn


SHAPES = ("points", "sphere_positions", "body_poses", "torn")
"""Fields of a record that only exported worlds have"""
READ = ("measures", "healthy", "points", "sphere_positions", "body_positions", "body_turns", "torn")
"""Arrays on the device from which a frame's record is made"""


class Recorder:
    """Reads a simulator's frames.

    Args:
        simulator: of the worlds.
        chosen: the worlds whose shape is wanted.
        every: step between frames that go into files of worlds; 0 for none.
    """

    def __init__(self, simulator: Simulator, chosen: NDArray[np.integer], every: int = 0):
        self.simulator = simulator
        self._tracker = Tracker(simulator, every) if every else None
        with lock_of(simulator.model.device):
            self._allocate(chosen)

    def _allocate(self, chosen: NDArray[np.integer]) -> None:
        model, worlds, state = self.simulator.model, self.simulator.model.world_count, self.simulator.state

        def zeros(shape: Any, dtype: Any) -> wp.array:
            return wp.zeros(shape, dtype=dtype, device=model.device)

        def offsets(counts: list[int]) -> wp.array:
            return wp.array(np.cumsum([0, *counts]), dtype=wp.int32, device=model.device)

        self._balloon_particles = offsets([shape.mesh.vertex_count for shape in model.shapes])
        self._balloon_faces = offsets([shape.mesh.face_count for shape in model.shapes])
        self._balloon_springs = offsets([shape.springs.count for shape in model.shapes])
        self._triangle_faces = wp.array(model.triangle_faces, dtype=wp.int32, device=model.device)
        self._balloon_triangles = offsets([shape.membrane.count for shape in model.shapes])
        lanes = _lanes_of(shape.mesh.vertex_count for shape in model.shapes)
        self._sums = zeros((worlds, model.balloon_count, lanes), BalloonSums)
        columns = columns_of(model.scene)
        self._measures = zeros((worlds, len(columns)), float)
        self._box_column, self._burst_column, self._gas_column = (
            columns.index(name) if name in columns else -1 for name in ("in_box", "burst", OF_GAS[0])
        )
        self._first_area = sum(shape.area for shape in model.shapes)
        self._box = model.scene.box or Box(lower=(-1.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))
        self._healthy = wp.full(worlds, 1, dtype=wp.int32, device=model.device)
        self._chosen = wp.array(chosen, dtype=wp.int32, device=model.device)
        self._points = zeros((len(chosen), model.particle_count), wp.vec3)
        self._sphere_positions = zeros((len(chosen), model.sphere_count), wp.vec3)
        self._body_positions = zeros((len(chosen), model.body_count), wp.vec3)
        self._body_turns = zeros((len(chosen), model.body_count), wp.quat)
        self._torn = zeros((len(chosen), state.torn.shape[1]), wp.int8)
        self._contact_means = zeros(state.contact_forces.shape, wp.vec4)
        self._contact_peaks = zeros(state.contact_forces.shape, wp.vec4)
        stream = wp.get_stream(model.device) if model.device.is_cuda else None
        read = {name: array for name in READ if (array := getattr(self, f"_{name}")).size}
        self._buffers = [HostBuffer(read, partial(_copy_all, read), stream) for _ in range(2)]

    def read(self) -> Record:
        """Read the frame that the simulator is at."""
        return self._begin()()

    def run(self) -> Iterator[Record]:
        """Simulate from the start to the last frame; yield the record of each, while a GPU simulates the next."""
        end = self._begin()
        for _ in range(self.simulator.model.scene.frames):
            self.simulator.advance()
            before, end = end, self._begin()
            yield before()
        yield end()

    def _begin(self) -> Callable[[], Record]:
        """Start to copy the simulator's frame to the host; return a function that awaits it. Two may be under way."""
        number = self.simulator.frame_number
        with lock_of(self.simulator.model.device):
            replay(self._graph)
            buffer = self._buffers[number % len(self._buffers)]
            buffer.fill()
            tracks = self._tracker.read() if self._tracker else None
            contacts = self._contacts() if number == self.simulator.model.scene.frames else None
        return partial(self._end, number, buffer, tracks, contacts)

    def _end(
        self, number: int, buffer: HostBuffer, tracks: dict[str, NDArray] | None, contacts: NDArray[np.float32] | None
    ) -> Record:
        buffer.wait()

        def copy(name: str) -> NDArray:
            return buffer.copy(name) if name in buffer.arrays else _no(getattr(self, f"_{name}"))

        return Record(
            number=number,
            measures=copy("measures"),
            healthy=copy("healthy"),
            points=copy("points"),
            sphere_positions=copy("sphere_positions"),
            body_poses=np.concatenate([copy("body_positions"), copy("body_turns")], axis=2),
            torn=copy("torn"),
            tracks=tracks,
            contacts=contacts,
        )

    def _contacts(self) -> NDArray[np.float32]:
        both = self._contact_means, self._contact_peaks
        return np.concatenate([each.numpy() if each.size else _no(each) for each in both], axis=3)

    def save(self) -> Iterator[tuple[str, NDArray]]:
        """Iterate over all that a frame depends on of those before it, by name; one array at a time is on the host."""
        for name, array in {**self.simulator.state.arrays, **self._last_good}.items():
            with lock_of(array.device):
                values = array.numpy()
            yield name, values

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go on, with the simulator, from where another recorder of the same worlds was saved."""
        self.simulator.restore(saved)
        with lock_of(self.simulator.model.device):
            for name, array in self._last_good.items():
                array.assign(saved[name])

    @property
    def _last_good(self) -> dict[str, wp.array]:
        """Arrays of the last good frame, by names that the simulator does not use."""
        kept = (*READ, "contact_means", "contact_peaks")
        return {f"recorded_{name}": getattr(self, f"_{name}") for name in kept}

    @cached_property
    def _graph(self) -> Any:
        with recording(self.simulator.model.device) as capture:
            self._measure()
            self._pick()
        return capture.graph

    def _measure(self) -> None:
        model, state = self.simulator.model, self.simulator.state
        launch(
            sum_balloons,
            self._sums.shape,
            inputs=[
                *(self._balloon_particles, self._balloon_faces, self._balloon_springs, self._balloon_triangles),
                *(model.particle_mass_share, model.parameters["mass"], model.face_offsets, model.face_particles),
                *(model.spring_particles, model.spring_rest_length, model.membrane_corners, model.membrane_rests),
                *(self._triangle_faces, state.points, state.velocities, state.torn),
            ],
            outputs=[self._sums],
            device=model.device,
        )
        launch(
            measure_worlds,
            model.world_count,
            inputs=[
                *(self._balloon_faces, model.face_offsets, model.face_particles, model.parameters["mass"]),
                *(model.inflation_kind, model.keyframe_times, model.parameters["keyframe_values"]),
                *(model.frame_seconds, model.up, wp.vec3(*self._box.lower), wp.vec3(*self._box.upper)),
                *(state.frame, state.pressures, state.points, state.sphere_positions),
                *(state.body_positions, self._sums),
                *(state.first_bad, HEALTHY, self._box_column, self._burst_column, state.bursts),
            ],
            outputs=[self._measures, self._healthy],
            device=model.device,
        )
        if self._gas_column >= 0:
            given = [self._first_area, self._gas_column, state.gas_amounts, state.thrusts, self._healthy]
            launch(measure_gas, model.world_count, inputs=given, outputs=[self._measures], device=model.device)
        if self._contact_means.size:
            told = [state.contact_forces, state.contact_torques, state.contact_areas, state.contact_pressures]
            launch(
                note_contacts,
                self._contact_means.shape,
                inputs=[state.frame, self._healthy, *told],
                outputs=[self._contact_means, self._contact_peaks],
                device=model.device,
            )

    def _pick(self) -> None:
        model, state = self.simulator.model, self.simulator.state
        for every, picked in (
            (state.points, self._points),
            (state.sphere_positions, self._sphere_positions),
            (state.body_positions, self._body_positions),
            (state.body_turns, self._body_turns),
        ):
            if picked.size:
                words, target = rows_of_words(every), rows_of_words(picked)
                given = [words, self._healthy, self._chosen]
                launch(pick_healthy_worlds, target.shape, inputs=given, outputs=[target], device=model.device)
        if self._torn.size:
            given = [state.torn, self._healthy, self._chosen]
            launch(pick_torn_faces, self._torn.shape, inputs=given, outputs=[self._torn], device=model.device)


def record_bytes(plan: ModelPlan) -> int:
    """Return the device memory that a world takes for its measures."""
    lanes = _lanes_of(shape.mesh.vertex_count for shape in plan.shapes)
    return 40 * lanes * len(plan.shapes) + 4 * len(columns_of(plan.scene)) + contact_bytes(plan)


def _lanes_of(particle_counts: Iterable[int]) -> int:
    """Return the number of threads that sum each balloon of a scene."""
    return MANY_LANES if max(particle_counts) > LARGE else LANES


def contact_bytes(plan: ModelPlan) -> int:
    """Return the memory of a world's contact measures, on the device and on the host."""
    balloons, things = contacts_shape(plan)
    return 4 * len(COLUMNS) * balloons * things


def picked_bytes(plan: ModelPlan) -> int:
    """Return the device memory that a chosen world takes."""
    may_tear = any(balloon.material.strength is not None for balloon in plan.scene.balloon)
    faces = sum(shape.mesh.face_count for shape in plan.shapes) if may_tear else 0
    particles = sum(shape.mesh.vertex_count for shape in plan.shapes)
    return 12 * (particles + len(plan.scene.sphere)) + 28 * len(plan.bodies) + faces


def _copy_all(sources: Mapping[str, wp.array], targets: Mapping[str, wp.array]) -> None:
    for name, target in targets.items():
        wp.copy(target, sources[name])


def _no(array: wp.array) -> NDArray[np.float32]:
    """Return an array without elements as NumPy's."""
    width = {wp.vec3: (3,), wp.vec4: (4,), wp.quat: (4,)}.get(array.dtype, ())
    return np.zeros((*array.shape, *width), dtype=np.float32)
