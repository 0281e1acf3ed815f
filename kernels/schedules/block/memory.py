"""What the threads of a block know, and what they keep beside the state."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.memory import in_tile, put_in_tile, put_vector, vector_at
from balloon_warp.kernels.own import own_beside_function, own_functions
from balloon_warp.kernels.phases.move import response
from balloon_warp.kernels.schedules.free_frames import FREE, FreeFrames, goes_too_far, note_hurry
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import any_in_block
from balloon_warp.kernels.working import Working


class FilmLayout(NamedTuple):
    """How a block goes through the faces of membranes."""

    slots: int
    """the most faces at a particle"""
    triangles: int
    """the most at a face"""
    mixed: bool
    """some have fewer"""
    areas: bool
    """area vectors come of them, too: they are all the faces that there are"""
    held: int = 0
    """that threads have room for in their registers, which all are quads then: the most of a thread, times the threads;
    0 where they are read in every substep"""
    pairs: int = 0
    """if the two that a thread holds stand side by side, how many such pairs there are: what they do to a corner that
    they share is one, and `slots` are the most pairs at a particle"""
    own_slots: int = 0
    """of a particle at an end of the edge that its thread's pair shares, the most other pairs at it; 0 where threads
    have no such particles"""


class Layout(NamedTuple):
    """How a world is laid out on a block."""

    threads: int
    capacity: int
    """particles that a tile holds"""
    resident: bool
    """each particle stays in the registers of a thread for all of a frame"""
    two: bool = False
    """a thread has two of them, which then share what a thread does for itself"""
    faces: int = 0
    """that a tile holds, where particles are resident"""
    kind_slots: tuple[int, int, int] = (0, 0, 0)
    """the most springs of each kind at a particle, where they are resident"""
    rings: int = 0
    """area vectors come of the ring of springs around each particle, and there are at least so many quads in it"""
    one_tile: bool = False
    """resident particles need no second tile for their points in every other substep"""
    nothing_where_none: bool = False
    """threads without a particle find no area vectors by themselves"""
    odd_substeps: bool = False
    fast_velocities: bool = False
    """they stand in a tile, too, where particles are not resident"""
    registers: int = 64
    """of a thread"""
    film: FilmLayout | None = None
    """membranes are measured face by face"""

    @property
    def warps(self) -> int:
        """of a block; on the CPU, a block is one thread"""
        return max(self.threads // 32, 1)


@wp.struct
class BlockMemory:
    """What a block keeps in global memory; arrays that a scene does not need are empty."""

    face_centers: wp.array2d[wp.vec3]
    face_area_vectors: wp.array2d[wp.vec3]
    aims: wp.array2d[wp.vec3]
    numbers: wp.array[wp.int32]
    """of the particles in the model: tables may have them in another order"""
    velocities: wp.array2d[wp.vec3]
    """in that order"""
    other_velocities: wp.array2d[wp.vec3]
    """where neighbors look at them: a substep reads one buffer and writes the other"""
    inflations: wp.array2d[wp.vec3]
    peaks: wp.array2d[float]
    """the state's, as they are in this frame, which may have to be simulated once more"""
    film_pulls: wp.array2d[wp.vec3]
    """of faces on their corners, where particles are not resident"""
    frame: wp.array[wp.int32]
    """as it was when the frame began, where a law asks for the time: the state's is counted while blocks still read"""
    free: FreeFrames
    """which worlds have a free frame, where that matters"""
    contacts: Working
    """who may touch whom, and with what force; empty unless balloons touch"""


@wp.struct
class Seat:
    """Where a thread sits, and in which substep."""

    world: wp.int32
    thread: wp.int32
    count: wp.int32  # particles of the world
    origin: wp.int32  # the one about which the volume of the first balloon is taken
    substep: wp.int32
    time_in_frame: float
    time: float
    spins: wp.array2d[wp.vec3]  # of spheres, in the state


@wp.func
def take_seat(state: WorldState, world: wp.int32, thread: wp.int32):
    """As a frame begins."""
    seat = Seat()
    seat.world = world
    seat.thread = thread
    seat.count = state.points.shape[1]
    seat.spins = state.sphere_spins
    return seat


@wp.func
def at_substep(t: Tables, seat: Seat, frame_begin: float, substep: wp.int32):
    """The seat in a substep.

    Args:
        frame_begin: [s]
    """
    now = Seat()
    now.world = seat.world
    now.thread = seat.thread
    now.count = seat.count
    now.origin = seat.origin
    now.spins = seat.spins
    now.substep = substep
    now.time_in_frame = float(substep) * t.step_seconds
    now.time = frame_begin + now.time_in_frame
    return now


@cache
def beginning_of_frame(traits: Traits) -> Any:
    """The function that tells when a frame begins [s], where a law asks for it."""

    @wp.func
    def frame_begin(t: Tables, memory: BlockMemory):
        if wp.static(traits.tells_time):
            return float(memory.frame[0]) * t.frame_seconds
        else:
            return 0.0

    return frame_begin


@cache
def frame_functions(traits: Traits) -> tuple[Any, Any, Any, Any]:
    """The functions that begin a frame of a world, if it is to be advanced; that say how fast a particle was in a
    substep; whether a frame was what it was believed to be; and that count it."""

    @wp.func
    def is_due(memory: BlockMemory, world: wp.int32):
        if wp.static(traits.frames == "free"):
            return memory.free.verdicts[world] == FREE
        elif wp.static(traits.frames == "busy"):
            return memory.free.verdicts[world] != FREE
        else:
            return True

    @wp.func
    def squared_speed(t: Tables, before: wp.vec3, after: wp.vec3, velocity: wp.vec3):
        """[m^2/s^2]. What spheres or the ground shift goes further than its velocity says."""
        if wp.static(traits.obstacles):
            return wp.length_sq(after - before) / (t.step_seconds * t.step_seconds)
        else:
            return wp.length_sq(velocity)

    @wp.func
    def ends_well(t: Tables, memory: BlockMemory, world: wp.int32, thread: wp.int32, fastest: float):
        """By all threads: whether all particles stayed where there is nothing."""
        well = bool(True)
        if wp.static(traits.frames == "free"):
            well = not any_in_block(goes_too_far(memory.free, world, fastest, t.frame_seconds))
            if thread == 0 and not well:
                note_hurry(memory.free, world)
        return well

    @wp.func
    def count_frame(state: WorldState, world: wp.int32, thread: wp.int32):
        """By one thread of all: the frame has passed. Nobody reads it while it does."""
        if wp.static(traits.frames != "busy"):
            if world == 0 and thread == 0:
                state.frame[0] = state.frame[0] + 1

    return is_due, squared_speed, ends_well, count_frame


@cache
def member_functions(traits: Traits, springs_type: Any, read_springs: Any) -> tuple[Any, Any, Any]:
    """The type of a particle in a thread's registers, the function that seats one, and the one that seats one beside
    another, with what they share in the same registers."""
    Own, read_own = own_functions(traits.columns, traits.balloons)  # noqa: N806 - a type
    read_own_beside = own_beside_function(traits.columns, traits.balloons)

    @wp.struct
    class Member:
        """A particle."""

        own: Own
        active: bool  # whether there is such a particle
        springs: springs_type
        ramp: wp.vec2  # what is keyframed, at the start of the frame, and its slope [1/s]
        load: wp.vec2  # with gas: the pressure at height 0 [Pa], and its rise with height [Pa/m]
        inertia: float  # its mass, and with gas its share of that [kg]
        gain: float  # velocity that a force gives it in a substep [m/s/N]
        point: wp.vec3
        velocity: wp.vec3
        aim: wp.vec3
        area_vector: wp.vec3
        fastest: float  # square of its highest speed so far, in a free frame [m^2/s^2]
        free_velocity: wp.vec3  # with gas: without the inflation
        push: wp.vec3  # of the inflation [N]

    @wp.func
    def seated(t: Tables, slots: Any, seat: Seat, place: wp.int32, member: Member):
        """With its springs; where there is no particle, it does not move."""
        member.active = place < seat.count
        if not member.active:
            member.own.share = 0.0
            member.own.mass = 0.0
        member.springs = read_springs(t, slots, member.own, place, member.active)
        member.inertia = member.own.mass
        member.gain = response(member.inertia, t.step_seconds)
        return member

    @wp.func
    def seat_member(t: Tables, slots: Any, state: WorldState, seat: Seat, place: wp.int32):
        """The particle at a place, but for where it is; where there is none, the last again, which does not move."""
        member = Member()
        member.own = read_own(t, seat.world, wp.min(place, seat.count - 1))
        member.ramp = state.inflation_ramp[seat.world, member.own.balloon]
        return seated(t, slots, seat, place, member)

    @wp.func
    def seat_beside(t: Tables, slots: Any, state: WorldState, seat: Seat, place: wp.int32, beside: Member):
        """The same; of one balloon, which all are of, less is read."""
        if wp.static(traits.balloons == 1):
            member = Member()
            member.own = read_own_beside(t, beside.own, wp.min(place, seat.count - 1))
            member.ramp = beside.ramp
            return seated(t, slots, seat, place, member)
        else:
            return seat_member(t, slots, state, seat, place)

    return Member, seat_member, seat_beside


@wp.func
def no_springs(t: Tables, slots: wp.int32, own: Any, place: wp.int32, active: bool):
    """Of a particle whose springs are read every substep, nothing is kept of them."""
    return own.number


def velocity_functions(layout: Layout) -> tuple[Any, Any]:
    """The functions that read and write a velocity where a layout has them."""
    return (in_tile, put_in_tile) if layout.fast_velocities else (vector_at, put_vector)


@cache
def pair_functions(layout: Layout) -> tuple[Any, Any]:
    """The functions that put the particles which a thread has in its registers where all threads find them, points in a
    tile and velocities in an array, and that get them from there."""
    two, threads = layout.two, layout.threads

    @wp.func
    def put_members(seat: Seat, mine: Any, also: Any, points: Any, velocities: wp.array[wp.vec3]):
        put_in_tile(points, seat.thread, mine.point)
        if mine.active:
            velocities[mine.own.number] = mine.velocity
        if wp.static(two):
            put_in_tile(points, seat.thread + threads, also.point)
            if also.active:
                velocities[also.own.number] = also.velocity

    @wp.func
    def get_members(seat: Seat, mine: Any, also: Any, points: Any, velocities: wp.array[wp.vec3]):
        mine.point = points[seat.thread]
        mine.velocity = velocities[mine.own.number]
        if wp.static(two):
            also.point = points[seat.thread + threads]
            also.velocity = velocities[also.own.number]
        return mine, also

    return put_members, get_members
