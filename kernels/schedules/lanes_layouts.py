"""Layouts of the eight lanes, and the names that phases read there.

The lanes are eight worlds, or eight particles of one world. Either way the loop over a balloon goes item by item, an
item being the content of the lanes: a particle of eight worlds, or an octet, eight particles of one world. The layouts
differ in where neighbors are: in the same lane of another item, or anywhere.

A phase is called for eight at once, or for one lane or world at a time. A rare phase is called only where something in
the lanes needs it.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any, ClassVar, NamedTuple

import warp as wp

from balloon_warp.kernels.lanes import LANE_COUNT, LaneNumbers, Lanes, Lanes3, Lanes4, total_in
from balloon_warp.kernels.memory import int_at
from balloon_warp.kernels.phase import STATE, VIEWS, Phase
from balloon_warp.kernels.schedules.writer import Step, Writer


class Layout(NamedTuple):
    """Layout of the lanes."""

    worlds: bool
    """Whether lanes are eight worlds; otherwise eight particles of one"""
    as_octets: bool = False
    """Whether worlds add up over their particles in the order of octets"""

    @property
    def number(self) -> Any:
        """The type of a number that may differ between particles."""
        return wp.float32 if self.worlds else Lanes

    @property
    def reference(self) -> Any:
        """The type of a reference to particles."""
        return wp.int32 if self.worlds else LaneNumbers

    @property
    def four(self) -> Any:
        """The type of four numbers that may differ between particles."""
        return wp.vec4 if self.worlds else Lanes4

    @property
    def vector(self) -> Any:
        """The type of a vector that others read: of an item, or of one particle, padded so that one load fetches it."""
        return Lanes3 if self.worlds else wp.vec4


WORLDS, OCTETS, WORLDS_AS_OCTETS = Layout(worlds=True), Layout(worlds=False), Layout(worlds=True, as_octets=True)


# ---- vectors that others read: of eight worlds
@wp.func_native("return vectors.data[(unsigned int)item];")
def near(vectors: wp.array[Lanes3], item: wp.int32) -> Lanes3:
    """Return the vectors of a neighbor, without the checks of Warp's own indexing, see `kernels.memory`."""
    ...


@wp.func_native("return vectors.data[(unsigned int)item];")
def of_item(vectors: wp.array[Lanes3], item: wp.int32) -> Lanes3:
    """Return the vectors of an item."""
    ...


@wp.func_native("vectors.data[(unsigned int)item] = value;")
def put_item(vectors: wp.array[Lanes3], item: wp.int32, value: Lanes3):
    """Store the vectors of an item."""
    ...


@wp.func
def of_particle(vectors: wp.array[Lanes3], places: wp.array[wp.int32], particle: wp.int32):
    """Return the vector of one particle of each world."""
    return vectors[particle]


# ---- vectors that others read: of eight particles
@wp.func_native(
    """
    typedef float four __attribute__((ext_vector_type(4)));
    typedef float eight __attribute__((ext_vector_type(8)));
    four v[8];
    for (int lane = 0; lane < 8; ++lane)
        __builtin_memcpy(&v[lane], &vectors.data[numbers[lane]], sizeof(four));
    wp::mat_t<3, 8, float> lanes;
    for (int axis = 0; axis < 3; ++axis) {
        eight row = {v[0][axis], v[1][axis], v[2][axis], v[3][axis], v[4][axis], v[5][axis], v[6][axis], v[7][axis]};
        __builtin_memcpy(lanes.data[axis], &row, sizeof(eight));
    }
    return lanes;
    """
)
def near(vectors: wp.array[wp.vec4], numbers: LaneNumbers) -> Lanes3:  # noqa: F811 - an overload
    """Return the vectors of eight neighbors, from anywhere in the array.

    Native code, of which the compiler of CPU kernels makes eight loads and a few shuffles; of the same in Python it
    makes a load for each number, and a multiplication for each address.
    """
    ...


@wp.func
def of_item(vectors: wp.array[wp.vec4], item: wp.int32):  # noqa: F811 - an overload
    """Return the vectors of an octet."""
    numbers = LaneNumbers()
    for lane in range(LANE_COUNT):
        numbers[lane] = LANE_COUNT * item + lane
    return near(vectors, numbers)


@wp.func_native(
    """
    for (int lane = 0; lane < 8; ++lane)
        vectors.data[8 * item + lane] = wp::vec_t<4, float>(
            value.data[0][lane], value.data[1][lane], value.data[2][lane], 0.0f);
    """
)
def put_item(vectors: wp.array[wp.vec4], item: wp.int32, value: Lanes3):  # noqa: F811 - an overload
    """Store the vectors of an octet."""
    ...


@wp.func
def of_particle(vectors: wp.array[wp.vec4], places: wp.array[wp.int32], particle: wp.int32):  # noqa: F811 - an overload
    """Return the vector of one particle of the world, in every lane."""
    return near(vectors, LaneNumbers(places[particle]))


# ---- one lane at a time, as phases see it that are of one world
@wp.struct
class WorldInLane:
    """The vectors of one of eight worlds."""

    vectors: wp.array[Lanes3]
    lane: wp.int32


@wp.struct
class WorldAlone:
    """The vectors of the one world, by the places of its particles."""

    vectors: wp.array[wp.vec4]
    places: wp.array[wp.int32]


@wp.func_native(
    """
    const auto& item = vectors.data[(unsigned int)index].data;
    return wp::vec3(item[0][lane], item[1][lane], item[2][lane]);
    """
)
def column_at(vectors: wp.array[Lanes3], index: wp.int32, lane: wp.int32) -> wp.vec3:
    """Return the vector of one lane of an item."""
    ...


@wp.func
def near(world: WorldInLane, particle: wp.int32):  # noqa: F811 - an overload
    """Return the index of a particle in one of eight worlds."""
    return column_at(world.vectors, particle, world.lane)


@wp.func
def near(world: WorldAlone, particle: wp.int32):  # noqa: F811 - an overload
    """Return the index of a particle of the one world."""
    vector = world.vectors[int_at(world.places, particle)]
    return wp.vec3(vector[0], vector[1], vector[2])


@wp.func_native(
    """
    auto& item = world.vectors.data[(unsigned int)particle].data;
    for (int axis = 0; axis < 3; ++axis)
        item[axis][world.lane] = vector[axis];
    """
)
def put(world: WorldInLane, particle: wp.int32, vector: wp.vec3):
    """Write a particle's vector."""
    ...


@wp.func
def put(world: WorldAlone, particle: wp.int32, vector: wp.vec3):  # noqa: F811 - an overload
    """Write a particle's vector."""
    world.vectors[int_at(world.places, particle)] = wp.vec4(vector[0], vector[1], vector[2], 0.0)


@wp.func
def add(vectors: wp.array[Lanes3], item: wp.int32, more: Lanes3):
    """Add vectors to those of an item."""
    vectors[item] = vectors[item] + more


@wp.func_native(
    """
    for (int lane = 0; lane < 8; ++lane) {
        auto& vector = vectors.data[numbers[lane]];
        for (int axis = 0; axis < 3; ++axis)
            vector[axis] += more.data[axis][lane];
    }
    """
)
def add(vectors: wp.array[wp.vec4], numbers: LaneNumbers, more: Lanes3):  # noqa: F811 - an overload
    """Add vectors to those of eight particles, some of which may be the same."""
    ...


@wp.func
def add(world: Any, particle: wp.int32, more: wp.vec3):  # noqa: F811 - an overload
    """Add a vector to that of one particle."""
    put(world, particle, near(world, particle) + more)


@wp.func
def view_of(vectors: wp.array[Lanes3], lane: wp.int32, places: wp.array[wp.int32]):
    """Return the vectors of the world in a lane."""
    view = WorldInLane()
    view.vectors = vectors
    view.lane = lane
    return view


@wp.func
def view_of(vectors: wp.array[wp.vec4], lane: wp.int32, places: wp.array[wp.int32]):  # noqa: F811 - an overload
    """Return the vectors of the one world."""
    view = WorldAlone()
    view.vectors = vectors
    view.places = places
    return view


class Places(NamedTuple):
    """World and particle that a lane holds."""

    world: Any
    """(group, lane, world_count) to the world in a lane; lanes that are left over copy the last world"""
    worlds: Any
    """(group, world_count) to how many worlds a group has"""
    first_world: Any
    """(group) to the first of them"""
    is_there: Any
    """(t, group, item, lane) to whether a lane holds a particle that no other lane holds"""
    particle: Any
    """(t, item, lane) to the particle in a lane; the padding of an octet copies the first there"""
    totals: Any
    """Function that reduces sums of lanes to sums of worlds"""


@cache
def places_of(layout: Layout) -> Places:
    """Return the places of lanes in a layout."""

    @wp.func
    def world_in_lane(group: wp.int32, lane: wp.int32, world_count: wp.int32):
        if wp.static(layout.worlds):
            return wp.min(group * LANE_COUNT + lane, world_count - 1)
        else:
            return group

    @wp.func
    def first_world(group: wp.int32):
        if wp.static(layout.worlds):
            return group * LANE_COUNT
        else:
            return group

    @wp.func
    def worlds_of(group: wp.int32, world_count: wp.int32):
        if wp.static(layout.worlds):
            return wp.min(world_count - group * LANE_COUNT, LANE_COUNT)
        else:
            return 1

    @wp.func
    def is_there(t: Any, group: wp.int32, item: wp.int32, lane: wp.int32):
        if wp.static(layout.worlds):
            return group * LANE_COUNT + lane < t.world_count
        else:
            return t.particles[LANE_COUNT * item + lane] >= 0

    @wp.func
    def particle_in_lane(t: Any, item: wp.int32, lane: wp.int32):
        if wp.static(layout.worlds):
            return item
        else:
            number = t.particles[LANE_COUNT * item + lane]
            return wp.where(number >= 0, number, t.particles[LANE_COUNT * item])

    @wp.func
    def totals_of(parts: Any):
        if wp.static(layout.worlds):
            return parts
        else:
            return total_in(parts)

    return Places(world_in_lane, worlds_of, first_world, is_there, particle_in_lane, totals_of)


OF_BALLOON: Mapping[str, str] = {
    "keyed": "ramps_of(t, state, group, balloon, time_in_frame)",
    "load": "loads_of(t, state, group, balloon)",
    "gas_mass": "gas_masses_of(t, working, group, balloon)",
    "travel_limit": "travel_limits_of(t, working, group)",
    "forces": "t.forces[group]",
    "origin": "of_particle({points}, t.places, volume_origin(tables, balloon))",
}
"""Expressions for values of a balloon, or of all"""
HANDLES = ("t", "tables", "state", "working", "solids", "spheres", "group", "substep", "time_in_frame", "time", "end")
SAME = {"state", "working", "spheres", "time_in_frame", "time", "end"}
"""Names that a phase for one item gets unchanged"""


class NamesInLanes(Writer):
    """Find names, and write calls."""

    aliases: ClassVar[Mapping[str, str]] = {"springs": "working"}
    tables = "tables"
    row = "group"
    """Row in which values are kept"""
    place = "group"
    """Row of values that are used up within a substep"""

    def __init__(self, step: Step, layout: Layout):
        super().__init__(step, (*HANDLES, *STATE.values(), *(f"new_{view}" for view in STATE.values())))
        self.layout = layout
        self.item = "item"
        """Variable of the loop over items at hand"""
        self.lane = "lane"
        """Variable of the loop over lanes or worlds"""
        self.single: dict[str, str] = {}
        """Variables that hold values of the world at hand alone"""
        self.flips = dict.fromkeys(STATE.values(), 0)
        """Number of times that the state of particles has changed buffers in this substep"""
        self.shown = False
        """Whether the lanes have the current spheres"""
        self.of_balloon: list[str] = []
        """Lines before the loop over a balloon's items"""

    @property
    def seen(self) -> set[str]:
        """Return the names that particles or faces read of others: views of state, and values."""
        read = {
            name
            for piece in self.step.pieces
            for phase in piece.phases
            for name in phase.reads(self.step.features, self.step.access)
        }
        return {name for name in read if name in STATE.values()} | {VIEWS[name] for name in read if name in VIEWS}

    @property
    def doubled(self) -> list[str]:
        """Return the views of state that have two places."""
        return [STATE[name] for name in self.step.doubled]

    @contextmanager
    def deeper(self, levels: int = 1) -> Iterator[None]:
        """Write the block below the line before."""
        self.indent += "    " * levels
        yield
        self.indent = self.indent[: len(self.indent) - 4 * levels]

    def calls(self, phases: Iterable[Phase]) -> None:
        """Write calls of phases: of eight side by side, or lane by lane."""
        for phase in phases:
            if self.lane == "place":
                call = self._call_of_one(phase)
                self.line(f"# {phase.summary}")
                self._bind_of_one(phase, call)
            elif phase.takes_eight(self.step.features, self.step.access):
                super().calls((phase,))
            else:
                self._lane_by_lane(phase)

    def need(self, name: str) -> None:
        """Bind a name: one of a balloon before the loop over its items."""
        light = next((phase for phase in self.step.light if name in phase.writes), None)
        if self.bound(name) in self.known:
            return
        if light and not light.takes_eight(self.step.features, self.step.access):
            self._lane_by_lane(light)
        elif not light and (text := self.found_of_balloon(name)):
            self.known.add(name)
            self.of_balloon.append(f"{self.indent[4:]}{name} = {text}")
        else:
            super().need(name)

    def found_of_balloon(self, name: str) -> str:
        """Return the text that finds a value of a balloon or of all, or "" where it is of an item."""
        if name in self.step.kept and self.step.owner(name) == "balloon":
            return f"all_{name}[{self.row}, balloon]"
        if name in VIEWS and VIEWS[name] in self.step.kept:
            return f"all_{VIEWS[name]}[{self.row}]"
        features = self.step.features
        if name in features.kept and features.kept[name].item == "balloon":
            return f"{name}_of(t, kept_{name}, group, balloon)"
        return OF_BALLOON.get(name, "").format(points=self.bound("points"))

    def bound(self, name: str) -> str:
        """Return the variable of a phase's argument or result."""
        if name in self.flips:
            return self.place_of(name, self.flips[name])
        return self.item if name == "particle" else name

    @staticmethod
    def place_of(view: str, flips: int) -> str:
        """Return the variable for one of the two places of a view."""
        return f"new_{view}" if flips % 2 else view

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        kept, row = self.step.kept, self.row
        if name in kept:
            return (
                "",
                f"of_item(all_{name}[{row}], {self.item})" if name in self.seen else f"all_{name}[{row}, {self.item}]",
            )
        if name in STATE:
            return "", f"of_item({self.bound(STATE[name])}, {self.item})"
        if name == "params":
            return "", f"{'params_of_quad' if self.item == 'quad' else 'params_of'}(t, group, balloon, {self.item})"
        if name in self.step.features.kept:
            return "", f"{name}_of(t, kept_{name}, group, {self.item})"
        if kept := self.step.features.kept_views.get(name):
            return "", f"kept_{kept}"
        return self.number_at(name)

    def _call_of_one(self, phase: Phase) -> str:
        """Return the call of a phase for one lane or world."""
        reads = phase.reads(self.step.features, self.step.access)
        return f"{phase.name}({', '.join(self._of_one(name) for name in reads)})"

    def _bind_of_one(self, phase: Phase, call: str) -> None:
        """Write a call, whose results hold for the world at hand alone."""
        its = {name: f"its_{name}" for name in phase.writes}
        self.line(f"{', '.join(its.values())} = {call}" if its else call)
        self.single |= its

    def _of_one(self, name: str) -> str:
        """Return the text that finds an argument of a phase for one."""
        lane = self.lane
        light = next((phase for phase in self.step.light if name in phase.writes and phase.item == "balloon"), None)
        if light and name not in self.single:
            self._bind_of_one(light, self._call_of_one(light))
        if name in self.single or name in SAME or name == "balloon":
            return self.single.get(name, name)
        texts = {
            "t": "tables", "thread": "0",
            "numbers": f"t.rows[group, {lane}, balloon]", "params": f"params_of_one(t, params, {lane})",
            "world": f"world_in_lane(group, {lane}, t.world_count)", "particle": f"particle_in_lane(t, item, {lane})",
        }  # fmt: skip
        if name in self.step.features.kept_views or (lane == "place" and name in self.step.features.kept):
            return self.kept_at(name, "world" if lane == "place" else texts["world"])
        if "sphere" in self.single and (number := self.number_at(name)):
            return number[1]
        if name == "params":
            self.need(name)
        if name in texts:
            return texts[name]
        if name in STATE.values():
            return f"view_of({self.bound(name)}, {lane}, t.places)"
        if name == "forces":
            return f"view_of({OF_BALLOON[name]}, {lane}, t.places)"
        if lane == "place" and (text := self.found_of_balloon(name)) and name not in self.known:
            return f"of_lane({text}, {lane})"
        self.need(name)
        return f"of_lane({self.bound(name)}, {lane})"

    def keep_of_one(self, names: Iterable[str]) -> None:
        """Write the kept values of an item of one world to where they stay."""
        for name in names:
            self.line(f"{self.kept_at(name)} = {self.single[name]}")

    def _lane_by_lane(self, phase: Phase) -> None:
        """Write the call of a phase for one in each lane, if it is rare once it is known that any needs it."""
        features, access = self.step.features, self.step.access
        reads = phase.reads(features, access)
        call = self._call_of_one(phase)
        begins = {name: name if name in self.known or name in STATE else "" for name in phase.writes}
        for name, start in begins.items():
            if start:
                self.need(name)
            else:
                self.line(f"{name} = {name}_lanes()")
        self.line(f"# {phase.summary}")
        asked = self._question(phase)
        guarded = bool(asked) or not phase.writes or {"state", "working", "spheres"} & set(reads)
        with self.deeper(int(bool(asked))):
            self.line(f"for lane in range({'t.lane_count' if guarded else 'LANE_COUNT'}):")
            with self.deeper():
                if guarded:
                    self.line(f"if is_there(t, group, {self.item}, lane):")
                with self.deeper(int(bool(guarded))):
                    its = [f"its_{name}" for name in phase.writes]
                    self.line(f"{', '.join(its)} = {call}" if its else call)
                    for name in phase.writes:
                        self.line(f"{name} = set_lane({name}, lane, its_{name})")
        self.known |= phase.writes.keys()

    def _question(self, phase: Phase) -> bool:
        """Write whether a rare phase has anything to do."""
        if not phase.asked(self.step.features, self.step.access):
            return False
        self.line(f"if {self.may_act(phase)}:")
        return True

    @staticmethod
    def names_of(function: Any) -> list[str]:
        """Return the names of the arguments of a function of Warp."""
        return list(function.input_types) if function else []
