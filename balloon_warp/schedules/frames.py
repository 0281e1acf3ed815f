"""A frame of launches: recorded once and replayed, and checked at its end.

Rounds of substeps: a frame of launches in which a few substeps are recorded, and replayed as often as needed.

A recorded launch takes time and memory, so that a graph of every substep would grow with their number. A graph has the
first substeps instead, a round whose turns a device counts, and what is left over.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from balloon_warp.kernels.compose import Clock
from balloon_warp.kernels.frame import begin_round, end_frame, end_turn, hold_spheres
from balloon_warp.kernels.measure.observed import FaceTable, sum_contacts
from balloon_warp.kernels.measure.worlds import note_overstretched, note_pressed
from balloon_warp.kernels.steering import count_ages
from balloon_warp.kernels.tables import HealthTable
from balloon_warp.model import Model, State
from balloon_warp.model.pressure import pressure_bounds
from balloon_warp.model.spectrum import ALL
from balloon_warp.model.state import frames_of
from balloon_warp.scene.load import frame_at
from balloon_warp.schedules.slices import particle_table
from balloon_warp.schedules.touch_table import ContactLists
from balloon_warp.system.warp_threads import launch, recording, replay

MOST_SPAN = 1.0e5
"""Largest distance between two particles of a balloon over its initial size: float32 then resolves a hundredth of the
size, and no spring's length any more"""
FARTHEST = 1.0e7
"""Largest distance from the origin over the size of the largest thing in the world, which is then float32's resolution.
From rest, a meter-sized thing gets there by falling freely for 24 minutes."""
LEAST_SIZE = 1.0
"""Least size of that largest thing [m]: small balloons may fall or rise as long as large ones"""
LARGEST_ROOT = 1.0e19
"""Largest number whose square is a float32"""


class HealthCheck:
    """Finds the worlds that left the finite numbers, or whose particles or spheres are where they cannot be.

    It reads the points that the frame has just written, once, and nothing else that grows with the number of worlds: no
    spring's length, no velocity. A velocity that is not finite makes a place that is not, a substep later; so do gas
    and pressure. The host checks outputs once more: see `Frame.is_finite`.

    Args:
        model: the simulated model.
        threads: that share a world; as many as suit the device, when missing.
        particles: whether it looks at particles, or others have.
    """

    def __init__(self, model: Model, threads: int | None = None, particles: bool = True):
        if threads is None:
            threads = 1 if model.device.is_cpu or not particles else model.particle_count
        self._shape = (model.world_count, threads)
        self._device = model.device
        count = model.particle_count if particles else 0
        self._inputs = [particle_table(model), health_table(model), threads, count]
        self._model, self._locking = model, _locking_triangles(model)
        self._pressure_bounds = _pressure_bounds(model)

    def look(self, state: State) -> None:
        """Lower `state.first_bad` of each world to its first bad particle or sphere."""
        self._launch(state, 0)

    def end_frame(self, state: State) -> None:
        """Count the frame, and look at its results."""
        self._launch(state, 1)
        model, parameters = self._model, self._model.parameters
        if model.ages is not None:
            launch(count_ages, model.world_count, [], [model.ages], device=self._device)
        if self._pressure_bounds is not None:
            launch(
                note_pressed,
                (model.world_count, model.balloon_count),
                inputs=[
                    *(self._pressure_bounds, model.step_seconds, parameters["mass"]),
                    *(state.frame, state.pressures),
                ],
                outputs=[state.pressed],
                device=self._device,
            )
        if self._locking:
            launch(
                note_overstretched,
                (model.world_count, len(self._locking[0])),
                inputs=[
                    *(*self._locking, model.membrane_corners, model.membrane_rests, model.particle_balloon),
                    *(parameters["gent_limit"], parameters["most_stretch"], parameters["wrinkling"]),
                    *(state.frame, state.points, state.torn),
                ],
                outputs=[state.overstretched],
                device=self._device,
            )

    def _launch(self, state: State, frames: int) -> None:
        launch(
            end_frame,
            self._shape,
            inputs=[*self._inputs, frames, state.points, state.sphere_positions],
            outputs=[state.frame, state.first_bad],
            device=self._device,
        )


def _pressure_bounds(model: Model) -> wp.array | None:
    """Return the bounds of the pressures of gas; None where nothing has any."""
    bounds = pressure_bounds(model.scene, model.shapes)
    return wp.array(bounds, dtype=float, device=model.device) if min(bounds) < ALL else None


def _locking_triangles(model: Model) -> tuple[wp.array, wp.array] | None:
    """Return the triangles of rubber that locks, and the face of every triangle; None where there are none."""
    locks = np.array([balloon.material.law == "gent" for balloon in model.scene.balloon])
    if not locks.any():
        return None
    firsts = np.asarray(model.membrane_corners.numpy(), dtype=np.int64).reshape(-1, 3)[:, 0]
    balloons = np.asarray(model.particle_balloon.numpy(), dtype=np.int64)[firsts]
    triangles = wp.array(np.flatnonzero(locks[balloons]), dtype=wp.int32, device=model.device)
    return triangles, wp.array(model.triangle_faces, dtype=wp.int32, device=model.device)


def health_table(model: Model) -> Any:
    """Return the limits on positions of particles and spheres."""
    origins, partners, sizes, farthest = [], [], [LEAST_SIZE], [0.0]
    for shape, first in zip(model.shapes, model.particle_offsets, strict=False):
        corners = shape.mesh.face_vertex_indices
        origins.append(first + int(corners[0]))
        partners.append(first + int(corners[np.argmax(corners != corners[0])]))
        used = shape.mesh.points[corners]
        sizes.append(float(np.ptp(used, axis=0).max()))
        farthest.append(float(np.abs(used).max()))
    spheres = model.parameters["initial_sphere_positions"].numpy()
    reach = min(FARTHEST * max(sizes) + max([*farthest, float(np.abs(spheres).max(initial=0.0))]), LARGEST_ROOT)
    spans = MOST_SPAN * np.array(sizes[1:])

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(values, dtype=dtype, device=model.device)

    table = HealthTable()
    table.near = min(float(spans.min()) / 2.0, reach) ** 2
    table.reach = reach**2
    table.spans = array(np.square(spans), float)
    table.origins, table.partners = array(origins, wp.int32), array(partners, wp.int32)
    return table


class LateSpheres:
    """Spheres that appear during the simulation: until then, they stay at their place."""

    def __init__(self, model: Model):
        self._model = model
        frames = [frame_at(model.scene, sphere.start) for sphere in model.scene.sphere]
        self._first_frames = wp.array(frames, dtype=wp.int32, device=model.device) if any(frames) else None
        """Frame at which each sphere appears, shape (sphere_count,); None where all exist from the start"""

    def hold(self, state: State) -> None:
        """Reset spheres that have not appeared, at the end of a frame."""
        if self._first_frames is None:
            return
        starts = [self._model.parameters[f"initial_sphere_{name}"] for name in ("positions", "velocities", "spins")]
        launch(
            hold_spheres,
            state.sphere_positions.shape,
            inputs=[self._first_frames, *starts, frames_of(self._model, state)],
            outputs=[state.sphere_positions, state.sphere_velocities, state.sphere_spins],
            device=self._model.device,
        )


class ContactSums:
    """Sum the contacts of particles with things by balloon and thing: `state.contact_forces` and the like."""

    def __init__(self, model: Model):
        self._model = model
        self._offsets = wp.array(model.particle_offsets, dtype=wp.int32, device=model.device)
        self._faces = FaceTable()
        for name in ("particle_face_offsets", "particle_faces", "face_offsets", "face_particles"):
            setattr(self._faces, name, getattr(model, name))

    def __call__(self, state: State) -> None:
        """Sum the frame that ends."""
        launch(
            sum_contacts,
            state.contact_forces.shape,
            inputs=[self._offsets, self._faces, self._model.frame_seconds, state.points, state.contact_impulses],
            outputs=[
                *(state.contact_forces, state.contact_torques, state.contact_areas, state.contact_pressures),
                state.contact_places,
            ],
            device=self._model.device,
        )


TURN = 16
"""Number of substeps of a turn: few to record, and enough that counting turns takes little of a GPU's time"""
FLAT = 4 * TURN
"""Largest number of substeps of a frame without rounds, which would have to record as many"""
OUTER, INNER = 0, 1
"""Depths of rounds: those of searches for contacts, and those between two searches"""
Substeps = Callable[[range], None]
"""Function that launches substeps of these numbers, and leaves particles in the state"""


class Rounds:
    """Go through the substeps of a model's frames.

    Args:
        interval: number of substeps from one search for contacts to the next; 0 where nothing is searched for.
    """

    def __init__(self, model: Model, interval: int, clock: Any):
        self._device, self._clock = model.device, clock
        self._count, self._interval = model.substeps, interval or model.substeps
        can_repeat = model.device.is_cpu or wp.is_conditional_graph_supported()
        self.are_short = can_repeat and model.substeps > FLAT
        """Whether far fewer substeps are recorded than a frame has; a GPU with an old driver records all"""
        self._turns = [clock.left[depth : depth + 1] for depth in (OUTER, INNER)]

    def go_through(self, launch_substeps: Substeps) -> None:
        """Launch all substeps of a frame.

        Numbers are those of the first turn of a round, and a search is due at the same of them in every turn; the
        clock knows which substep it really is.
        """
        if not self.are_short:
            launch_substeps(range(self._count))
            return
        interval = self._interval
        if interval <= TURN:
            self._stretch(launch_substeps, 0, self._count, interval * (TURN // interval))
            self._clock.done.zero_()
        else:
            self._go_through(lambda first, count: self._stretch(launch_substeps, first, count, TURN))

    def go_from_search_to_search(self, launch_round: Callable[[int, int], None]) -> None:
        """Launch all substeps of a frame.

        Args:
            launch_round: function of the number of the first substep of a round, and of how many it has; it leaves the
                clock as it is.
        """
        interval = self._interval
        if self.are_short:
            self._go_through(lambda first, count: launch_round(first, count) or 0)
        else:
            for first in range(0, self._count, interval):
                launch_round(first, min(interval, self._count - first))

    def launch_round(self, launch_substeps: Substeps, first: int, count: int) -> None:
        """Launch so many substeps, and set the clock back."""
        if not self.are_short:
            launch_substeps(range(first, first + count))
        elif done := self._stretch(launch_substeps, first, count, TURN):
            launch(end_turn, 1, [self._clock, INNER, -done], device=self._device)

    def _go_through(self, launch_round: Callable[[int, int], int]) -> None:
        """Launch rounds, of so many substeps from one on, that return by how many substeps the clock is further on."""
        interval = self._interval
        turns, rest = divmod(self._count, interval)
        launch_round(0, min(interval, self._count))
        self._clock.done.zero_()
        self._repeat(OUTER, turns - 1, interval, lambda: launch_round(interval, interval))
        if rest and turns:
            launch_round(interval, rest)
        self._clock.done.zero_()

    def _stretch(self, launch_substeps: Substeps, first: int, count: int, turn: int) -> int:
        """Launch so many substeps, where a search is due at the first of every turn, or at the first of all alone.

        Return by how many substeps the clock is further on.
        """
        turns, rest = divmod(count, turn)
        if not turns:
            launch_substeps(range(first, first + rest))
            return 0
        launch_substeps(range(first, first + turn))
        second = range(first + turn, first + 2 * turn)

        def again() -> int:
            launch_substeps(second)
            return 0

        self._repeat(INNER, turns - 1, turn, again)
        if rest:
            launch_substeps(second[:rest])
        return turn * (turns - 1)

    def _repeat(self, depth: int, turns: int, substeps: int, launch_turn: Callable[[], int]) -> None:
        """Launch a turn of so many substeps again and again, by which the clock goes on."""
        if turns < 1:
            return

        def turn() -> None:
            done = launch_turn()
            launch(end_turn, 1, [self._clock, depth, substeps - done], device=self._device)

        launch(begin_round, 1, [self._clock, depth, turns], device=self._device)
        wp.capture_while(self._turns[depth], turn)


def make_clock(model: Model) -> Any:
    """Return the clock of a model's launches, at the start of a frame."""
    clock = Clock()
    clock.done = wp.zeros(1, dtype=wp.int32, device=model.device)
    clock.left = wp.zeros(2, dtype=wp.int32, device=model.device)
    clock.substep_seconds = model.step_seconds
    return clock


RARE = 16
"""Number of times that a GPU launches a piece which is not always wanted, before it is worth recording"""
FEW = 2
"""Number of times that a CPU launches a piece before it records it, which takes as long as to launch it two and a half
times"""


def _nothing() -> None:
    """Launch nothing."""


class FramePiece(NamedTuple):
    """Piece of a frame that is recorded by itself; a piece that is never wanted is not even compiled."""

    launch: Callable[[State], None]
    is_wanted: Callable[[], bool] | None = None
    """Whether it is wanted in this frame, which is known once earlier pieces are done; None for always"""
    is_short: bool = False
    """Whether far fewer substeps are recorded than it replays, so that it is worth recording at once, see `rounds`"""


class RecordedFrame:
    """A frame of one schedule and one state of a model, and the host's changes of spheres at its end.

    Args:
        before: launches the kernels before the frame, which are recorded with it.
        after: launch the kernels after it.
    """

    def __init__(self, model: Model, before: Callable[[], None] = _nothing, *after: Callable[[], None]):
        self._device, self._late_spheres = model.device, LateSpheres(model)
        self._before, self._after = before, after
        self._graphs: dict[int, Any] = {}
        self._launched: Counter[int] = Counter()

    def advance(self, schedule: Any, state: State) -> None:
        """Advance the state by a frame: record it, if the schedule can be and that is worth it, and launch it."""
        lists: ContactLists | None = schedule.contact_lists
        pieces = self._pieces(schedule)
        ending = len(pieces) - 1 if lists else len(pieces)
        self._go_through(pieces, range(ending), state, schedule.capturable)
        while lists and lists.grow(state):
            lists.put_back(state)
            self._graphs.clear()  # they have the shorter lists
            self._launched.clear()
            self._go_through(pieces, range(ending), state, schedule.capturable)
        self._go_through(pieces, range(ending, len(pieces)), state, schedule.capturable)

    def _go_through(self, pieces: Sequence[FramePiece], numbers: Iterable[int], state: State, recorded: bool) -> None:
        """Launch pieces of a frame, by their numbers."""
        for number in numbers:
            piece = pieces[number]
            if piece.is_wanted is not None and not piece.is_wanted():
                continue
            self._launched[number] += 1
            if not recorded or self._launched[number] <= self._unrecorded(piece):
                piece.launch(state)
            else:
                self._replay(number, piece, state)

    def _unrecorded(self, piece: FramePiece) -> int:
        """Return how often a piece is launched before it is recorded."""
        if piece.is_short:
            return 0
        if self._device.is_cpu:
            return FEW
        return 0 if piece.is_wanted is None else RARE

    def _replay(self, number: int, piece: FramePiece, state: State) -> None:
        if number not in self._graphs:
            with recording(self._device) as capture:
                piece.launch(state)
            self._graphs[number] = capture.graph
        replay(self._graphs[number])

    def _pieces(self, schedule: Any) -> Sequence[FramePiece]:
        """Return the pieces of a frame; where lists of contacts may have to grow, the last comes after it."""
        has_pieces = schedule.capturable and getattr(schedule, "pieces", None)
        own = list(has_pieces or [FramePiece(schedule.advance_frame)])
        lists: ContactLists | None = schedule.contact_lists
        begin, end = own[0].launch, own[-1].launch

        def first(state: State) -> None:
            if lists:
                lists.begin(state)
            self._before()
            begin(state)

        def last(state: State) -> None:
            (first if len(own) == 1 else end)(state)
            self._end(state)

        if lists:
            return [own[0]._replace(launch=first), *own[1:], FramePiece(self._end)]
        if len(own) == 1:
            return [own[0]._replace(launch=last)]
        return [own[0]._replace(launch=first), *own[1:-1], own[-1]._replace(launch=last)]

    def _end(self, state: State) -> None:
        self._late_spheres.hold(state)
        for launches in self._after:
            launches()
