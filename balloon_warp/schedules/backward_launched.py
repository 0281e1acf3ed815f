"""Frames backwards, as launches: a thread has a particle of a world; and the choice of how frames run backwards."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.adjoints.exchange import (
    ExchangeBars,
    ExchangeResult,
    Exchanges,
    exchange_again_kernel,
    exchange_back_kernel,
)
from balloon_warp.kernels.adjoints.small_spheres import (
    CONTACTS_OF_A_SPHERE,
    FaceBars,
    FaceContact,
    LoggedFaces,
    add_by_starts,
    faces_back_kernel,
)
from balloon_warp.kernels.adjoints.sweeps import EDGES_BACK, RIDGES_BACK
from balloon_warp.kernels.contact.spheres import mark_count
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.touch import MAX_ADVANCEMENTS
from balloon_warp.kernels.phase import STATE, NoAdjointError
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.schedules.launched_backward import BackwardKernel, backward_kernels, made_kernels
from balloon_warp.kernels.schedules.writer import Piece, Step, cut
from balloon_warp.kernels.substep import phases_of
from balloon_warp.kernels.working import Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Counting, Room
from balloon_warp.schedules.backward import (
    BackwardFrames,
    DirectionsBackward,
    EachBackward,
    FixturesBackward,
    GasBackward,
    StringsBackward,
    TubesBackward,
)
from balloon_warp.schedules.backward_contact import (
    STATE_OF_SPHERES,
    BackwardModel,
    EdgesBackward,
    RidgesBackward,
    SpheresBackward,
    TouchBackward,
    kept_of_ridges,
    kept_of_sweeps,
    kept_of_touch,
    log_of_spheres,
)
from balloon_warp.schedules.backward_one_launch import (
    BlockBackward,
    LanesBackward,
    fits_in_block_backwards,
    fits_in_lanes_backwards,
)
from balloon_warp.schedules.choose import AS_OCTETS
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.launched import Launches, Moving, Own, TouchLaunches, step_arrays, team_threads
from balloon_warp.schedules.layouts import fits_in_block
from balloon_warp.schedules.tables import make_tables, model_features, world_state
from balloon_warp.system.warp_threads import launch, launch_tiled


class ExchangeBackward:
    """Run the exchange of momentum backwards, a substep at a time.

    Args:
        spheres: whose bars it turns into those of before the exchange.
    """

    def __init__(self, of: BackwardModel, spheres: SpheresBackward, room: Room):
        self._model, self._tables, self._working, self._of_frame = of.model, of.tables, of.working, of.bars
        self._again, self._back = exchange_again_kernel(of.features), exchange_back_kernel(of.features, of.columns)
        self._came, self._exchanges = kept_of_exchange(of.model, room)
        self._bars = ExchangeBars()
        self._bars.spheres = spheres.bars
        self._bars.points, self._bars.velocities = of.arrays["all_point_bar"], of.arrays["all_velocity_bar"]
        self._bars.masses = room.array((of.model.world_count, of.model.particle_count), wp.float32)
        self._bars.gas_masses, self._bars.numbers = of.arrays["all_gas_mass_bar"], of.arrays["number_bars"]

    def note(self, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles are before the exchange, and which are near spheres."""
        for kept, array in zip(self._came[substep], (points, velocities, self._working.near), strict=True):
            wp.copy(kept, array)

    def turn_back(self, substep: int, log: Any) -> None:
        """Backward pass of the exchange of momentum.

        Args:
            log: courses of spheres in the substep, as they come to the exchange.
        """
        points, velocities, near = self._came[substep]
        wp.copy(self._exchanges.points[0], points)
        wp.copy(self._exchanges.velocities[0], velocities)
        working = Working()
        for name in vars(Working.cls)["__annotations__"]:
            setattr(working, name, getattr(self._working, name))
        working.near = near
        model, device = self._model, self._model.device
        worlds, threads = [model.world_count], team_threads(model)
        inputs = [self._tables, working, log, self._exchanges]
        launch_tiled(self._again, dim=worlds, inputs=inputs, block_dim=threads, device=device)
        inputs += [substep * model.step_seconds, self._bars, self._of_frame]
        launch_tiled(self._back, dim=worlds, inputs=inputs, block_dim=threads, device=device)


def kept_of_exchange(model: Model, room: Room) -> tuple[list[tuple[wp.array, wp.array, wp.array]], Any]:
    """Allocate the state before each substep's exchange, and the values of one that are computed again."""
    worlds, particles, spheres = model.world_count, model.particle_count, model.sphere_count
    exchanges = Exchanges()
    for name in ("points", "velocities"):
        setattr(exchanges, name, room.array((spheres + 1, worlds, particles), wp.vec3))
    exchanges.met = room.array((worlds, spheres), ExchangeResult)
    came = [
        (
            room.array((worlds, particles), wp.vec3),
            room.array((worlds, particles), wp.vec3),
            room.array((worlds, mark_count(particles)), wp.int32),
        )
        for _ in range(model.substeps)
    ]
    return came, exchanges


class FacesBackward:
    """Run contacts of small spheres with faces backwards, a substep at a time.

    Args:
        spheres: whose bars it turns into those of before the contacts.
    """

    def __init__(self, of: BackwardModel, spheres: SpheresBackward, room: Room):
        self._model, self._tables, self._working, self._spheres = of.model, of.tables, of.working, spheres
        self._back = faces_back_kernel(of.features, of.columns)
        self._came, self._again, self._log, self._bars = kept_of_faces(of.model, room)
        self._bars.points, self._bars.velocities = of.arrays["all_point_bar"], of.arrays["all_velocity_bar"]
        self._bars.gas_masses, self._bars.numbers = of.arrays["all_gas_mass_bar"], of.arrays["number_bars"]
        self._bars.spheres = spheres.bars

    def note(self, state: State, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles and spheres are before they meet."""
        came = (points, velocities, *(getattr(state, name) for name in STATE_OF_SPHERES))
        for kept, array in zip(self._came[substep], came, strict=True):
            wp.copy(kept, array)

    def turn_back(self, substep: int, starts: wp.array) -> None:
        """Backward pass of the contacts: bars of the state before them, and of the substep's start.

        Args:
            starts: places of particles as the substep began.
        """
        model = self._model
        for again, kept in zip(self._again, self._came[substep], strict=True):
            wp.copy(again, kept)
        working = Working()
        for name in vars(Working.cls)["__annotations__"]:
            setattr(working, name, getattr(self._working, name))
        working.sphere_starts, working.point_starts = self._spheres.log.sphere_starts, starts
        launch_tiled(
            self._back, dim=[model.world_count],
            inputs=[self._tables, working, self._log, *self._again[:2], self._bars],
            block_dim=team_threads(model), device=model.device,
        )  # fmt: skip

    def add_by_starts(self) -> None:
        """Add the bars of where the substep began, once all else has run backwards."""
        model = self._model
        launch(add_by_starts, (model.world_count, model.particle_count), [self._bars], device=model.device)


def kept_of_faces(model: Model, room: Room) -> tuple[list[tuple[wp.array, ...]], tuple[wp.array, ...], Any, Any]:
    """Allocate the state before each substep's contacts, room to move it, the log of contacts, and bars."""
    worlds, particles, spheres = model.world_count, model.particle_count, model.sphere_count

    def moving() -> tuple[wp.array, ...]:
        of_particles: Moving = room.array((worlds, particles), wp.vec3), room.array((worlds, particles), wp.vec3)
        return (*of_particles, *(room.array((worlds, spheres), wp.vec3) for _ in STATE_OF_SPHERES))

    came, again = [moving() for _ in range(model.substeps)], moving()
    log = LoggedFaces()
    for name, array in zip(STATE_OF_SPHERES, again[2:], strict=True):
        setattr(log, name, array)
    log.contacts = room.array((worlds, CONTACTS_OF_A_SPHERE * spheres), FaceContact)
    log.counts = room.array(worlds, wp.int32)
    bars = FaceBars()
    bars.starts, bars.inverse_masses = (
        room.array((worlds, particles), wp.vec3),
        room.array((worlds, particles), wp.float32),
    )
    bars.parts = room.array((worlds, int(MAX_ADVANCEMENTS)), wp.float32)
    return came, again, log, bars


class _Remembering(Launches):
    """Launch a step's pieces, and keep the values of each substep.

    Args:
        remembered: where the values of each substep are kept.
    """

    def __init__(
        self, model: Model, step: Step, tables: Any, room: Room, remembered: "_Remembered", own: Mapping[str, Own]
    ):
        super().__init__(model, step, tables, room, own, fast_math=GatherSchedule.fast_math)
        self._remembered, self._substep = remembered, 0
        self.notes: dict[str, ExchangeBackward | EdgesBackward | RidgesBackward | FacesBackward] = {}
        """Adjoints of phases that keep the state before these, by their names"""

    def substep(self, state: State, substep: int, now: Moving) -> Moving:
        """Execute a substep, and return where particles are then."""
        self._substep, self.values = substep, self._remembered.values[substep]
        return super().substep(state, substep, now)

    def _launch(self, piece: Piece, state: State, substep: int, now: Moving) -> Moving:
        noting = self.notes.get(piece.phases[0].name)
        if isinstance(noting, FacesBackward):
            noting.note(state, self._substep, *now)
        elif noting:
            noting.note(self._substep, *now)
        new = super()._launch(piece, state, substep, now)
        if isinstance(noting, RidgesBackward):
            noting.note_left(state, self._substep, *new)
        return new

    def _targets(self, piece: Piece, state: State, now: Moving) -> Moving:
        after = dict(zip(STATE, self._remembered.moving[self._substep + 1], strict=True))
        points, velocities = (after[name] if name in piece.moves else old for name, old in zip(STATE, now, strict=True))
        return points, velocities


FOUND_AGAIN = {"inflate"}
"""Phases whose outputs adjoints recompute by a product, from inputs that these read anyway"""
CARRIED = {"inflation_loads": wp.vec2}
"""Values that balloons carry from one substep to the next, and their types"""
WAYS_OUT = {"meet_ridges": "faces = false"}
"""Settings by the names of phases without an adjoint, which they leave out"""
GAS_CARRIED = {"pressures": wp.float32, "gas_amounts": wp.float64, "free_volumes": wp.float64}
"""Further values that balloons carry, where gas comes and goes"""
MOST_RECORDED = 256
"""Largest number of substeps of a frame of launches that is recorded: each keeps values in arrays of its own, so that
none stands for others, and a graph would grow with their number"""


class _Remembered:
    """Hold all values that the substeps of a frame find."""

    def __init__(self, model: Model, step: Step, state: State, room: Room):
        of_particles = (model.world_count, model.particle_count)
        self.values = [step_arrays(model, step, room)[0] for _ in range(model.substeps)]
        once = {name for piece in step.pieces if piece.once for name in piece.leaves}
        for values in self.values[1:]:
            values.update({name: self.values[0][name] for name in once})
        self.moving: list[Moving] = [(state.points, state.velocities)] + [
            (room.array(of_particles, wp.vec3), room.array(of_particles, wp.vec3)) for _ in range(model.substeps)
        ]
        """Points and velocities before each substep, and after the last"""
        balloons = (model.world_count, model.balloon_count)
        carried = CARRIED | GAS_CARRIED if step.features.gas_changes else CARRIED
        spheres = (model.world_count, model.sphere_count)
        self.carried = [
            {name: room.array(balloons, dtype) for name, dtype in carried.items()}
            | ({name: room.array(spheres, wp.vec3) for name in STATE_OF_SPHERES} if model.sphere_count else {})
            for _ in range(model.substeps + 1)
        ]
        """Arrays that balloons and spheres carry into each substep, by their names in the state, and those that the
        last leaves"""

    def note(self, state: State) -> None:
        """Keep the state with which a frame begins."""
        for name, array in self.carried[0].items():
            wp.copy(array, getattr(state, name))

    def state_after(self, state: State, substep: int) -> State:
        """Return a state in which a substep may change the values that balloons carry."""
        for name, array in self.carried[substep + 1].items():
            wp.copy(array, self.carried[substep][name])
        return replace(state, **self.carried[substep + 1])


def gradient_step(model: Model, features: Features) -> Step:
    """Return the phases of a model, in pieces, with their outputs kept, unless they are soon found again."""
    phases = phases_of(features)
    shown = [name for phase in phases if not (phase.light or phase.name in FOUND_AGAIN) for name in phase.writes]
    return cut(phases, features, GATHERED, shown=shown)


def kernels_of(step: Step, columns: tuple[int, ...]) -> tuple[BackwardKernel, ...]:
    """Return the kernels of a step backwards.

    Raises:
        InputError: a phase has no adjoint.
    """
    try:
        return backward_kernels(step, columns)
    except NoAdjointError as missing:
        way_out = next((text for name, text in WAYS_OUT.items() if f"`{name}`" in str(missing)), "a scene without")
        raise InputError(
            f"gradients: {missing} has no adjoint yet; expected {way_out}, see docs/GRADIENTS.md"
        ) from None


class LaunchedBackward(BackwardFrames):
    """Run frames backwards by launches of each piece.

    Raises:
        InputError: a phase has no adjoint.
    """

    _directions: DirectionsBackward | None = None
    _searching: TouchLaunches | None = None
    _exchange: ExchangeBackward | None = None
    _edges: EdgesBackward | None = None
    _ridges: RidgesBackward | None = None
    _faces: FacesBackward | None = None

    def __init__(self, model: Model, state: State, columns: Sequence[int]):
        features = model_features(model)
        step, tables = gradient_step(model, features), make_tables(model, features)
        super().__init__(model, state, columns, step, tables)
        room = self.room
        self.recorded = model.substeps <= MOST_RECORDED
        kernels = kernels_of(step, self.columns)
        self._remembered = _Remembered(model, step, self.state, room)
        own = {"touch_balloons": self._touch}
        self._launches = _Remembering(model, step, tables, room, self._remembered, own)
        self._framing = Framing(model, features, tables, self._launches.working)
        self._kernels = list(zip(kernels, made_kernels(step, self.columns), strict=True))
        self._gas_back = None
        self.working = working = self._launches.working
        self.parts: list[EachBackward | StringsBackward] = []
        """Derivatives by single springs, faces and strings, where they are asked for"""
        self.fixtures: FixturesBackward | None = None
        """Derivatives by obstacles, where they are asked for"""
        of = BackwardModel(model, features, self.columns, tables, working, self.arrays, self.bars)
        if features.inflation_directions:
            self._directions = DirectionsBackward(model, tables, working, self.bars.points, room)
        if features.touches:
            self._searching = TouchLaunches(model, features, tables, working, GatherSchedule.fast_math)
            self.touch = TouchBackward(of, room, GatherSchedule.fast_math)
        if model.sphere_count:
            self.spheres = SpheresBackward(of, room)
        if self.spheres and features.impulses:
            self._exchange = ExchangeBackward(of, self.spheres, room)
            self._launches.notes["meet_spheres"] = self._exchange
        if self.touch and features.edges_meet:
            self._edges = EdgesBackward(of, self.touch, room)
            self._launches.notes["meet"] = self._edges
        if features.ridges:
            self._ridges = RidgesBackward(of, self.spheres, room)
            self._launches.notes["meet_ridges"] = self._ridges
        if self.spheres and features.small_spheres:
            self._faces = FacesBackward(of, self.spheres, room)
            self._launches.notes["meet_faces"] = self._faces
        if features.gas_changes:
            self._gas_back = GasBackward(of)
        if features.tubes:
            self.tubes = TubesBackward(of)
        self.carries_loads = any(
            kernel.item == "particle" and not kernel.after_note and "all_load_bar" in kernel.arguments
            for kernel in kernels
        )

    @staticmethod
    def room_of_frame(model: Model, room: Room) -> None:
        """Allocate the memory of a frame's substeps."""
        step = gradient_step(model, model_features(model))
        for _ in range(model.substeps):
            step_arrays(model, step, room)
            room.array((2, model.world_count, model.particle_count), wp.vec3)
        if model.sphere_count:
            log_of_spheres(model, room)
        if step.features.impulses:
            kept_of_exchange(model, room)
        if step.features.touches:
            kept_of_touch(model, step.features, room)
        if step.features.edges_meet:
            kept_of_sweeps(EDGES_BACK, model, step.features, room)
        if step.features.small_spheres:
            kept_of_faces(model, room)
        if step.features.ridges:
            kept_of_sweeps(RIDGES_BACK, model, step.features, room)
            kept_of_ridges(model, step.features, room)

    def _touch(self, state: State, substep: int, now: Moving) -> None:
        """Let balloons touch, and keep their contacts."""
        assert self._searching
        assert self.touch
        self._searching.search(state, substep, *now)
        self.touch.note(substep, state.holds)
        self._searching.press(state, *now)

    def frame(self) -> None:
        """Launch a frame forward, and then its substeps backwards."""
        state, kept = self.state, self._remembered
        self._framing.begin(state)
        now = kept.moving[0]
        kept.note(state)
        for substep in range(self.model.substeps):
            if self.spheres and self.step.features.penalties:
                self.spheres.note(substep)
            now = self._launches.substep(kept.state_after(state, substep), substep, now)
        for substep in reversed(range(self.model.substeps)):
            self._substep_back(substep)
        if self.fixtures:
            self.fixtures.add_up()

    def _substep_back(self, substep: int) -> None:
        m, kept = self.model, self._remembered
        points, velocities = kept.moving[substep]
        found = self._gas_back.found_again(self.state, kept.carried[substep], substep) if self._gas_back else {}
        among = self.spheres.found_again(self.state, kept.carried[substep], substep) if self.spheres else {}
        if self._edges:
            self._edges.turn_back(self.state, substep)
        if self._faces:
            self._faces.turn_back(substep, points)
        if self._exchange and self.spheres:
            log = self.spheres.log
            self._exchange.turn_back(substep, self._ridges.log_left(log, substep) if self._ridges else log)
        beside_ridges = self._ridges
        for kernel, made in self._kernels:
            loads = kept.carried[substep + kernel.after_note]["inflation_loads"]
            if beside_ridges and kernel.meets != "meet_ridges":
                beside_ridges.turn_back(replace(self.state, **among), substep)
                beside_ridges = None  # for all other phases are earlier
            now = beside_ridges.left[substep] if beside_ridges else (points, velocities)
            met = beside_ridges.spheres_left(substep) if beside_ridges else {}
            has = {
                "t": self.tables, "time_in_frame": substep * m.step_seconds,
                "state": world_state(replace(self.state, inflation_loads=loads, **found, **among | met)),
                "working": self._launches.working, "all_points": now[0], "all_velocities": now[1],
                **{f"all_{name}": array for name, array in kept.values[substep].items()}, **self.arrays,
            }  # fmt: skip
            inputs = [has[name] for name in kernel.arguments]
            if self.tubes and "all_slope_bar" in kernel.arguments:
                self.tubes.turn_back(self.state, found, kept.values[substep]["gas_load"], substep)
            if kernel.item == "balloon":
                places = (m.world_count, m.balloon_count)
                launch_tiled(made, dim=places, inputs=inputs, block_dim=team_threads(m), device=m.device)
            else:
                launch(made, (m.world_count, m.particle_count), inputs, device=m.device)
        if self._faces:
            self._faces.add_by_starts()
        for part in self.parts:
            part.turn_back(self.state.frame, substep * m.step_seconds, points, velocities)
        if self.touch:
            self.touch.turn_back(points, velocities, substep)
        if self._directions and (substep == 0 or self.step.features.fresh_normals):
            self._directions.turn_back(points, kept.values[substep]["balloon_area"])
        if self.spheres:
            self.spheres.turn_back(substep)
        if self._gas_back:
            self._gas_back.turn_back(self.state, kept.carried[substep], substep)
        elif substep == m.substeps - 1:
            self.bars.pressures.zero_()  # of the frame's end alone


Backward = type[LaunchedBackward] | type[BlockBackward] | type[LanesBackward]
"""Schedules that run frames backwards"""
BACKWARDS: dict[str, Backward] = {"launched": LaunchedBackward, "block": BlockBackward, "lanes": LanesBackward}


def backwards_of(model: Model, name: str = "auto") -> Backward:
    """Return the backward schedule of a model, whatever the number of its worlds: of that name, or the fastest.

    Raises:
        InputError: there is none of that name, or it cannot run this model backwards.
    """
    fits = fits_in_block_backwards(model)
    if name == "auto":
        name = "lanes" if fits_in_lanes_backwards(model) else "block" if fits else "launched"
    if name not in BACKWARDS:
        raise InputError(f"schedule: expected auto, launched, block or lanes, which run backwards (got {name!r})")
    if name == "lanes" and not fits_in_lanes_backwards(model):
        raise InputError(
            "schedule: lanes runs one balloon of springs or rubber backwards on a CPU, in the air or on the ground, "
            "with a constant amount of gas, and rubber that is not viscous; expected block or launched"
        )
    if name == "block" and not fits:
        raise InputError(
            "schedule: block runs one balloon backwards that fits in a block, out of water, without spheres or "
            "normal forces, with as much gas all the time, and that does not touch itself; expected launched"
        )
    return BACKWARDS[name]


def forward_of(model: Model, backward: Backward) -> str:
    """Return the schedule of the frames forward: one whose results are the same for any number of worlds."""
    if backward is LaunchedBackward:
        return "gather"
    if model.device.is_cpu:
        return AS_OCTETS if backward is LanesBackward and model.world_count > 1 else "octets"
    return "block" if fits_in_block(model) else "gather"


def bytes_backwards(model: Model, columns: Sequence[int], frames: int, name: str = "auto") -> int:
    """Return the device memory that gradients take of each world: a frame's substeps, and a little of each frame."""
    room = Counting()
    backwards_of(model, name).room_of_frame(model, room)
    bars = 4 * model.world_count * model.particle_count * (len(columns) + 24 + 8 * model.sphere_count)
    of_frame = 40 * model.balloon_count + 48 * model.sphere_count
    if model.scene.touches:
        bars += model.world_count * model.particle_count * (85 + 24 * model.balloon_count)
        of_frame += 17 * model.particle_count
    return (room.bytes + bars) // model.world_count + frames * of_frame
