"""Phases as one kernel: a thread advances eight worlds, or one, by a frame.

Its source is written from the list, flat. Where a phase takes eight side by side, an item goes through it at once. Any
other is called lane by lane, for one that is rare once it is known that something in the lanes needs it at all.

Sums have the same order for eight worlds and for eight particles, or quads, of one. Over the items of a balloon eight
particles add up lane by lane, and then lanes do: worlds have eight sums each, and every eighth particle adds to the
same one. At the corners of quads eight worlds go quad by quad, and add to its four corners; quads of one world may
share corners: lane by lane, each adds to its four.

Forces on the particles of busy worlds, eight particles side by side, are a launch of its own in each substep. The other
phases of such worlds are launched one by one, and read the results of this one.
"""

from collections.abc import Callable, Mapping
from functools import cache
from itertools import groupby
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.algebra import scaled
from balloon_warp.kernels.compose import kernel_from
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import IN_LANES, LANE_COUNT, LaneNumbers, Lanes, Lanes3, of_lane, set_lane, total_in
from balloon_warp.kernels.loops.contact import Solids
from balloon_warp.kernels.loops.net_force import Loops, loops_of_eight
from balloon_warp.kernels.loops.spheres import sphere_at
from balloon_warp.kernels.phase import STATE, Access, Item
from balloon_warp.kernels.schedules.lanes_layouts import (
    OCTETS,
    WORLDS,
    WORLDS_AS_OCTETS,
    Layout,
    NamesInLanes,
    add,
    near,
    of_item,
    of_particle,
    places_of,
    put,
    put_item,
    view_of,
)
from balloon_warp.kernels.schedules.lanes_state import (
    balloon_functions,
    frame_functions,
    kept_functions,
    lane_structs,
    params_functions_of,
    reading_functions,
    showing_function,
    writing_function,
)
from balloon_warp.kernels.schedules.writer import Piece, Step, head, named_in, values_of, written_types


@wp.func
def add_to_corners(
    vectors: wp.array[Lanes3], first: wp.int32, second: wp.int32, third: wp.int32, fourth: wp.int32,
    on_first: Lanes3, on_second: Lanes3, on_third: Lanes3, on_fourth: Lanes3,
):  # fmt: skip
    """Add vectors to those of a quad's corners, of eight worlds."""
    add(vectors, first, on_first)
    add(vectors, second, on_second)
    add(vectors, third, on_third)
    add(vectors, fourth, on_fourth)


@wp.func_native(
    """
    typedef float four __attribute__((ext_vector_type(4)));
    typedef float eight __attribute__((ext_vector_type(8)));
    four of_lane[4][8];
    const auto turn = [&of_lane](int corner, const wp::mat_t<3, 8, float>& more) {
        eight x, y, z, none = 0.0f;
        __builtin_memcpy(&x, more.data[0], sizeof(eight));
        __builtin_memcpy(&y, more.data[1], sizeof(eight));
        __builtin_memcpy(&z, more.data[2], sizeof(eight));
        const eight xy[2] = {
            __builtin_shufflevector(x, y, 0, 8, 1, 9, 2, 10, 3, 11),
            __builtin_shufflevector(x, y, 4, 12, 5, 13, 6, 14, 7, 15)};
        const eight zw[2] = {
            __builtin_shufflevector(z, none, 0, 8, 1, 9, 2, 10, 3, 11),
            __builtin_shufflevector(z, none, 4, 12, 5, 13, 6, 14, 7, 15)};
        for (int half = 0; half < 2; ++half) {
            of_lane[corner][4 * half] = __builtin_shufflevector(xy[half], zw[half], 0, 1, 8, 9);
            of_lane[corner][4 * half + 1] = __builtin_shufflevector(xy[half], zw[half], 2, 3, 10, 11);
            of_lane[corner][4 * half + 2] = __builtin_shufflevector(xy[half], zw[half], 4, 5, 12, 13);
            of_lane[corner][4 * half + 3] = __builtin_shufflevector(xy[half], zw[half], 6, 7, 14, 15);
        }
    };
    turn(0, on_first);
    turn(1, on_second);
    turn(2, on_third);
    turn(3, on_fourth);
    for (int lane = 0; lane < 8; ++lane) {
        const int corners[4] = {first[lane], second[lane], third[lane], fourth[lane]};
        for (int corner = 0; corner < 4; ++corner) {
            four vector;
            __builtin_memcpy(&vector, &vectors.data[corners[corner]], sizeof(four));
            vector += of_lane[corner][lane];
            __builtin_memcpy(&vectors.data[corners[corner]], &vector, sizeof(four));
        }
    }
    """
)
def add_to_corners(  # noqa: F811 - an overload
    vectors: wp.array[wp.vec4], first: LaneNumbers, second: LaneNumbers, third: LaneNumbers, fourth: LaneNumbers,
    on_first: Lanes3, on_second: Lanes3, on_third: Lanes3, on_fourth: Lanes3,
):  # fmt: skip
    """Add vectors to those of the corners of eight quads, lane by lane, in vector registers of a particle each."""
    ...


OFFSETS: Mapping[Item, str] = {
    "particle": "t.item_offsets",
    "face": "t.faces.balloon_offsets",
    "quad": "t.quad_offsets",
}
"""Begin of each balloon's items"""


class ItemsInLanes(NamesInLanes):
    """Write loops over items."""

    @staticmethod
    def _flips(piece: Piece, view: str) -> int:
        return sum(STATE[name] == view for name in piece.doubles)

    def _items(
        self, kind: Item, body: Callable[[], Any], before: str = "", after: Callable[[], Any] | None = None
    ) -> None:
        """Write a loop over the items of all balloons."""
        known = set(self.known)
        self.item = "item" if kind == "particle" else kind
        self.line("for balloon in range(tables.inflation_kind.shape[0]):")
        with self.deeper():
            lines, self.lines, self.of_balloon = self.lines, [], []
            self.known |= {"balloon", self.item}
            with self.deeper():
                body()
            of_items, self.lines = self.lines, lines
            self.lines += self.of_balloon
            if before:
                self.line(before)
            self.line(f"for {self.item} in range({OFFSETS[kind]}[balloon], {OFFSETS[kind]}[balloon + 1]):")
            self.lines += of_items
            self.known = known | {"balloon"}
            if after:
                after()
        self.known = known

    def _leave(self, piece: Piece) -> None:
        """Write the results of an item to where they are kept."""
        for name in piece.moves:
            view = STATE[name]
            target = self.place_of(view, self.flips[view] + self._flips(piece, view))
            self.line(f"put_item({target}, {self.item}, {name})")
        for name in piece.keeps:
            self.line(f"put_{name}(t, kept_{name}, group, {self.item}, {name})")
        for name in piece.leaves:
            if self.step.owner(name) == "balloon":
                continue
            if name in self.seen:
                self.line(f"put_item(all_{name}[{self.row}], {self.item}, {name})")
            else:
                self.line(f"all_{name}[{self.row}, {self.item}] = {name}")

    def _sum(self, piece: Piece) -> None:
        """Write the results of a balloon's items, and their sum."""
        *others, phase = piece.phases
        (value,) = phase.writes
        parts = f"{value}_parts"

        def add() -> None:
            self.calls(others)
            self.calls((phase,))
            pads = piece.item == "particle" and not self.layout.worlds
            if self.layout.as_octets:
                self.line(f"part = ({self.item} - {OFFSETS[piece.item]}[balloon]) % LANE_COUNT")
                self.line(f"{parts}[part] = {parts}[part] + {value}")
            else:
                self.line(f"{value}_total += {f'scaled({value}, t.present[item])' if pads else value}")
            self._leave(piece)

        def end() -> None:
            if self.layout.as_octets:
                self.line("for part in range(LANE_COUNT):")
                self.line(f"    {value}_total += {parts}[part]")
                self.line(f"    {parts}[part] = {value}_lanes()")
            self.line(f"all_{value}[{self.row}, balloon] = totals_of({value}_total)")

        if self.layout.as_octets:
            self.line(f"{parts} = all_{parts}[{self.place}]")
        self._items(piece.item, add, f"{value}_total = {value}_lanes()", end)


PARTS = int(LANE_COUNT)
OVER_ITEMS = {"load": 2, "keyed": 2, "gas_mass": 1}
"""Bars of a balloon's values to which items add, and how many numbers they have"""


class Sums(NamedTuple):
    """Places of sums: those of the balloon's values, then of the numbers that are derived by."""

    numbers: int

    @property
    def total(self) -> int:
        """Return how many there are."""
        return sum(OVER_ITEMS.values()) + self.numbers

    def places(self, name: str) -> range:
        """Return the places of a balloon's value."""
        names = list(OVER_ITEMS)
        begin = sum(OVER_ITEMS[each] for each in names[: names.index(name)])
        return range(begin, begin + OVER_ITEMS[name])

    def of_number(self, place: int) -> int:
        """Return the place of a number."""
        return sum(OVER_ITEMS.values()) + place


@wp.func_native("sums.data[((unsigned int)slot * sums.shape[1] + number) * 8 + (unsigned int)item % 8u] += value;")
def add_every_eighth(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32, item: wp.int32, value: Lanes):
    """Add to the sum of every eighth item."""
    ...


@wp.func_native("sums.data[((unsigned int)slot * sums.shape[1] + number) * 8] += value;")
def add_each(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32, item: wp.int32, value: Lanes):
    """Add to the sum of all items."""
    ...


@wp.func
def clear_sum(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32):
    """Begin again."""
    for part in range(PARTS):
        sums[slot, number, part] = Lanes()


@wp.func
def total_of_worlds(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32):
    """Return the sum of each of eight worlds."""
    total = Lanes()
    for part in range(PARTS):
        total += sums[slot, number, part]
    return total


@wp.func
def total_of_octets(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32):
    """Return the sum of a world, in each lane."""
    return total_in(sums[slot, number, 0])


@cache
def sum_functions(layout: Layout) -> dict[str, Any]:
    """Return the functions that add up, by their names."""
    return {
        "add_to": add_every_eighth if layout.worlds else add_each,
        "total_of": total_of_worlds if layout.worlds else total_of_octets,
        "clear_sum": clear_sum,
    }


COUNTS: Mapping[Item, str] = {
    "sphere": "state.sphere_positions.shape[1]", "triangle": "tables.membranes.corners.shape[0]",
    "hinge": "tables.hinges.ends.shape[0]", "spring": "tables.correction.particles.shape[0]",
    "face": "tables.faces.balloon.shape[0]",
}  # fmt: skip
"""Number of the items of a world that are looped over one by one"""
MOVERS: set[Item] = {"sphere", "world", "balloon", "team"}
"""Items whose phases may move spheres"""


class FrameWriter(ItemsInLanes):
    """Write the source of a frame."""

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "advance_worlds" if self.layout.worlds else "advance_octets"

    # ---- the frame

    def source(self) -> str:
        """Return the text of the kernel."""
        if not self.lines:
            self._frame()
        return "\n".join([*head(self.name, self.arguments(), self.remark), *self.lines, ""])

    @property
    def remark(self) -> str:
        """Return a sentence on a thread's work."""
        return f"A thread for each {'eight worlds' if self.layout.worlds else 'world'}: a frame."

    def arguments(self) -> dict[str, str]:
        """Return the names of the kernel's arguments, as it needs them, and their types."""
        states = {view: "Seen" if view in self.seen else "Lanes3" for view in STATE.values()}
        may_be = {
            "t": "LaneTables", "tables": "Tables", "first_group": "wp.int32", "state": "WorldState",
            "working": "Working", "solids": "Solids", **self.kept_arrays,
            **{f"all_{view}": f"wp.array2d[{kind}]" for view, kind in states.items()},
            **{f"other_{view}": f"wp.array2d[{kind}]" for view, kind in states.items()},
            **{
                f"all_{value}": f"wp.array2d[{'Seen' if value in self.seen else f'{value}_lanes'}]"
                for value in self.step.kept
            },
            **{f"all_{value}_parts": f"wp.array2d[{value}_lanes]" for value in self.step.kept},
        }  # fmt: skip
        return named_in(self.lines, may_be)

    def _frame(self) -> None:
        self.line("group = first_group + wp.tid()")
        if self.step.features.watched:
            self.line("if not any_free(t, working, group):")
            self.line("    return")
        if self.step.features.spheres:
            self.line("spheres = spheres_in_state(tables, state, working)")
        for view in STATE.values():
            self.line(f"{view} = all_{view}[group]")
        for view in self.doubled:
            self.line(f"new_{view} = other_{view}[group]")
        self.line("read_frame(t, state, working, group, points, velocities)")
        self.substeps()
        self.line(f"write_frame(t, state, working, group, {self.bound('points')}, {self.bound('velocities')})")

    def substeps(self) -> None:
        """Write the loop over substeps."""
        self.line("for substep in range(tables.substeps):")
        with self.deeper():
            self._begin_substep()
            for once, pieces in groupby(self.step.pieces, key=lambda piece: piece.once):
                if once:
                    self.line("if substep == 0:")
                with self.deeper(int(once)):
                    for piece in pieces:
                        self._piece(piece)
                self.shown = self.shown and not once  # in the first substep alone

    def _begin_substep(self) -> None:
        self.line("time_in_frame = float(substep) * t.step_seconds")
        self.line("time = time_of(tables, state.frame, time_in_frame)")
        self.line("end = time_in_frame + t.step_seconds")
        turns = [view for view in self.doubled if sum(self._flips(piece, view) for piece in self.step.pieces) % 2]
        for condition, names in (("if substep % 2 == 1:", ("other", "all")), ("else:", ("all", "other"))):
            if turns:
                self.line(condition)
            for view in turns:
                self.line(f"    {view} = {names[0]}_{view}[group]")
                self.line(f"    new_{view} = {names[1]}_{view}[group]")

    # ---- a piece

    def _piece(self, piece: Piece) -> None:
        known, single = set(self.known), dict(self.single)
        wide = piece.phases[0].takes_eight(self.step.features, self.step.access)
        self._show_solids(piece)
        if piece.phases[-1].sums:
            self._sum(piece)
        elif piece.item in ("particle", "quad") or (piece.item == "face" and wide):
            self._items(piece.item, lambda: (self.calls(piece.phases), self._leave(piece)))
        elif piece.item in COUNTS:
            self._singles(piece)
        else:
            self._each_world(lambda: self._worlds(piece))
        self.known, self.single = known, single
        for view in self.flips:
            self.flips[view] += self._flips(piece, view)
        self.shown = self.shown and piece.item not in MOVERS

    def _show_solids(self, piece: Piece) -> None:
        """Show spheres and obstacles, if the piece asks about them and they may have moved."""
        phases = (*piece.phases, *self.step.light)
        asks = any("solids" in self.names_of(phase.asked(self.step.features, self.step.access)) for phase in phases)
        if asks and piece.item == "particle" and not self.shown:
            self.line("show_solids(t, tables, state, solids, group, end)")
            self.shown = True

    def _singles(self, piece: Piece) -> None:
        """Write a loop over items that are gone through one by one, in each world."""
        kind = piece.item
        if kind == "spring":
            self.line("for _sweep in range(tables.correction.sweeps):")
        with self.deeper(int(kind == "spring")):
            self.line(f"for {kind} in range({COUNTS[kind]}):")
            self.known.add(kind)
            self.single[kind] = kind
            with self.deeper():
                self._each_world(lambda: (self.calls(piece.phases), self.keep_of_one(piece.keeps)))

    def _each_world(self, body: Callable[[], Any]) -> None:
        """Write a loop over a group's worlds."""
        self.line("for place in range(worlds_of(group, t.world_count)):")
        self.lane, single = "place", dict(self.single)
        with self.deeper():
            self.line("world = first_world(group) + place")
            self.single |= {"world": "world", "balloon": "balloon"}
            body()
        self.lane, self.single = "lane", single

    def _worlds(self, piece: Piece) -> None:
        """Write the work for a world, balloon by balloon."""
        for of_balloon, some in groupby(piece.phases, key=lambda phase: phase.item == "balloon"):
            phases, single = tuple(some), dict(self.single)
            if of_balloon:
                self.line("for balloon in range(tables.inflation_kind.shape[0]):")
            with self.deeper(int(of_balloon)):
                self.calls(phases)
                self.keep_of_one(name for phase in phases for name in phase.keeps)
                for name in [name for phase in phases for name in phase.writes if name in piece.leaves]:
                    self._leave_of_world(name)
            self.single = single

    def _leave_of_world(self, name: str) -> None:
        """Write a result of a balloon of a world to where it is kept, for all lanes that hold the world."""
        kept = f"all_{name}[{self.row}, balloon]"
        if self.layout.worlds:
            self.line(f"{kept} = set_lane({kept}, place, its_{name})")
        else:
            self.line("for lane in range(LANE_COUNT):")
            self.line(f"    {kept} = set_lane({kept}, lane, its_{name})")

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        step, layout = self.step, self.layout
        features, access = step.features, step.access
        phases = [phase for piece in step.pieces for phase in piece.phases]
        structs, places = lane_structs(layout), places_of(layout)
        read_frame, write_frame = frame_functions(features, layout)
        params_of, params_of_quad, params_of_one = params_functions_of(features.columns.places["mass"], layout)
        types = written_types(step) | {name: kind for phase in step.light for name, kind in phase.writes.items()}
        return {
            **self.scope(phases), **balloon_functions(layout),
            "LaneTables": structs.tables, "Solids": Solids, "Seen": layout.vector,
            "Lanes3": Lanes3, "LANE_COUNT": LANE_COUNT,
            "read_frame": read_frame, "write_frame": write_frame, "show_solids": showing_function(features, layout),
            "params_of": params_of, "params_of_quad": params_of_quad, "params_of_one": params_of_one,
            "world_in_lane": places.world, "worlds_of": places.worlds, "first_world": places.first_world,
            "is_there": places.is_there, "particle_in_lane": places.particle, "totals_of": places.totals,
            "of_item": of_item, "put_item": put_item, "of_particle": of_particle, "view_of": view_of,
            "of_lane": of_lane, "set_lane": set_lane, "scaled": scaled,
            **{f"{name}_lanes": IN_LANES[kind] for name, kind in types.items()},
            **{name: function for each in features.keeps for name, function in kept_functions(each, layout).items()},
            **{f"{each.name}_may_act": each.asked(features, access) for each in (*phases, *step.light) if each.rare},
        }  # fmt: skip


@cache
def kernel_of(step: Step, layout: Layout) -> Any:
    """Make the kernel that advances groups of worlds, or worlds."""
    writer = FrameWriter(step, layout)
    return kernel_from(writer.name, writer.source(), writer.names(), module_options=OPTIONS)


@cache
def arguments_of(step: Step, layout: Layout) -> dict[str, str]:
    """Return the names of its arguments, in order, and their types."""
    writer = FrameWriter(step, layout)
    writer.source()
    return writer.arguments()


def source_of(step: Step, layout: Layout) -> str:
    """Write the kernel of a list."""
    return FrameWriter(step, layout).source()


def kinds_of(step: Step, layout: Layout) -> dict[str, tuple[Item, Any]]:
    """Return the owners and types of the kept values."""
    seen = FrameWriter(step, layout).seen
    return {
        value: (step.owner(value), layout.vector if value in seen else IN_LANES[kind])
        for value, kind in values_of(step).items()
    }


class _Writer(FrameWriter):
    """Write the source of some phases of a substep, which leave values of particles."""

    def __init__(self, step: Step):
        super().__init__(step, OCTETS)

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "pull_octets"

    @property
    def remark(self) -> str:
        """Return a sentence on a thread's work."""
        return "A thread for each world: some phases of a substep."

    def arguments(self) -> dict[str, str]:
        """Return the names of the kernel's arguments, as it needs them, and their types."""
        more = {
            "clock": "Clock",
            "substep": "wp.int32",
            "from_points": "wp.array2d[wp.vec3]",
            "from_velocities": "wp.array2d[wp.vec3]",
            **{f"to_{value}": f"wp.array2d[{value}_type]" for value in self.step.pieces[-1].leaves},
        }
        return super().arguments() | named_in(self.lines, more)

    def _frame(self) -> None:
        self.line("group = wp.tid()")
        if self.step.features.frames == "busy":
            self.line("if working.verdicts[group] == 0:")
            self.line("    return")
        self.line("time_in_frame = time_in_frame_of(clock, substep)")
        self.line("if time_in_frame == 0.0:")
        self.line("    read_numbers(t, group)")
        self.line("points = all_points[group]")
        self.line("velocities = all_velocities[group]")
        self.line("read_particles(t, group, from_points, from_velocities, points, velocities)")
        self.line("time = time_of(tables, state.frame, time_in_frame)")
        for piece in self.step.pieces:
            self._piece(piece)
        for value in self.step.pieces[-1].leaves:
            self.line(f"write_vectors(t, group, all_{value}[group], to_{value})")

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        read_numbers, read_particles = reading_functions(self.step.features, self.layout)
        write_vectors = writing_function(self.layout)
        return super().names() | {
            "read_numbers": read_numbers, "read_particles": read_particles, "write_vectors": write_vectors,
        }  # fmt: skip


@cache
def pulling_kernel(step: Step) -> Any:
    """Make the kernel; a thread a world."""
    writer = _Writer(step)
    return kernel_from(writer.name, writer.source(), writer.names(), module_options=OPTIONS)


def pulling_source(step: Step) -> str:
    """Write the kernel."""
    return _Writer(step).source()


@cache
def pulling_arguments(step: Step) -> dict[str, str]:
    """Return the names of its arguments, in order, and their types."""
    writer = _Writer(step)
    writer.source()
    return writer.arguments()


@wp.func
def take_forces(t: Any, params: Any):
    """Take the forces that hinges, faces and membranes have added to an item [N], and clear them."""
    forces = t.forces[params.group]
    force = of_item(forces, params.number)
    put_item(forces, params.number, Lanes3())
    return force


@wp.func
def itself(part: Any):
    """Return the part of the only thread."""
    return part


def _access(layout: Layout) -> Access:
    places = places_of(layout)

    @cache
    def loops(features: Features) -> Loops:
        """Return the loops over all forces on an item."""
        _, _, params_of_one = params_functions_of(features.columns.places["mass"], layout)
        return loops_of_eight(features, near, take_forces, view_of, params_of_one)

    @wp.func
    def world_of(t: Any, params: Any, lane: wp.int32):
        return places.world(params.group, lane, t.world_count)

    return Access(
        near, sphere_at, loops, put=put, velocity_at=near, put_velocity=put,
        in_team=(near, put, itself), add=add, add_to_corners=add_to_corners, world=world_of,
    )  # fmt: skip


ACCESS = {layout: _access(layout) for layout in (WORLDS, OCTETS, WORLDS_AS_OCTETS)}
"""Access functions for eight worlds, and for eight particles of one"""
