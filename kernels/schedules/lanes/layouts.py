"""Layouts of the eight lanes: eight worlds, or eight particles of one world.

Either way the loop over a balloon goes item by item, an item being the content of the lanes: a particle of eight
worlds, or an octet, eight particles of one world. The layouts differ in where neighbors are: in the same lane of
another item, or anywhere.
"""

from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.lanes import LANE_COUNT, LaneNumbers, Lanes, Lanes3, Lanes4
from balloon_warp.kernels.memory import int_at


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
