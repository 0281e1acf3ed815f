"""The pieces of a substep as the threads of a block do them, each for a particle or together: see `kernels.substep`."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.laws.inflation import aim_of
from balloon_warp.kernels.loops.jets import jet_loop
from balloon_warp.kernels.loops.net_force import Loops, net_force_function
from balloon_warp.kernels.loops.obstacles import around_function, leave_one_sphere, standing_function
from balloon_warp.kernels.loops.touching import is_near_sphere
from balloon_warp.kernels.memory import in_tile
from balloon_warp.kernels.phases.inflate import inflation_of, pressure_at
from balloon_warp.kernels.phases.move import drift_of, kick, response
from balloon_warp.kernels.phases.swell import memory_function, swell_function
from balloon_warp.kernels.schedules.block.board import Board
from balloon_warp.kernels.schedules.block.gas import GasSums
from balloon_warp.kernels.schedules.block.memory import Layout, Seat
from balloon_warp.kernels.schedules.block.refresh import Refresh
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import any_in_warp


class Pieces(NamedTuple):
    """Functions of one particle, or of two that one thread has."""

    fill: Any
    """(t, seat, member): what it moves, gas too"""
    pull: Any
    """(t, seat, points, velocities, member, area): all forces but the inflation, and the particle with its area vector
    and aim, where they come on the way; of the balloon whose area is that, or of one of several"""
    free: Any
    """(t, seat, member, force): the velocity that they give"""
    swell: Any
    """(t, seat, member, origin): the particle's part of its balloon's swelling"""
    push: Any
    """(t, seat, member, velocity, force): the inflation, and the movement"""
    leave: Any
    """(t, seat, member, other): out of spheres, by all threads of a warp; the other is a second particle, or none.
    Where nobody needs to know sooner where the spheres are, each warp moves them here for itself."""
    is_near: Any
    """(t, seat, member, other): whether either may touch a sphere, where both then exchange momentum; by all threads of
    a warp, who move the spheres as in `leave`"""
    stand: Any
    """(t, seat, member): up to the ground, and out of obstacles that go where they are told"""


@cache
def pieces_of(
    traits: Traits, loops: Loops, board: Board, gas: GasSums, refresh: Refresh, member_type: Any, layout: Layout
) -> Pieces:
    """For what a scene has."""
    Member = member_type  # noqa: N806 - a type
    area_of_balloon = refresh.area
    net_force = net_force_function(traits, loops)
    jet = jet_loop(traits, in_tile) if traits.jets else None
    inflation = inflation_of(traits)
    drift = drift_of(traits)
    swell_of_particle = swell_function(traits, board.sphere_at)
    remembered = memory_function(traits)
    stand_of_particle = standing_function(traits)
    spheres, two = traits.spheres, layout.two
    rolls = board.rolls_by_warps
    around_own = around_function(traits)
    molar_mass_column = traits.columns.places["molar_mass"]

    @wp.func
    def fill(t: Tables, seat: Seat, member: Member):
        if wp.static(traits.gas):
            amount = gas.amount_at(seat.substep, member.own.balloon)
            along = amount * member.own.n[molar_mass_column]
            if wp.static(traits.takes_air_along):
                along += gas.air_at(member.own.balloon)
            member.inertia = member.own.mass + member.own.share * along
            member.gain = response(member.inertia, t.step_seconds)
        return member

    @wp.func
    def pull(t: Tables, seat: Seat, points: Any, velocities: Any, member: Member, area: float):
        force, area_vector, facing = net_force(
            t, points, velocities, member.own, member.springs, member.point, member.velocity, seat.time
        )
        if wp.static(jet is not None):
            force += jet(
                t.necks, points, t.necks.weights[member.own.number], member.own.balloon, member.load,
                wp.dot(member.point, t.up), seat.time, member.own.n,
            )  # fmt: skip
        member.area_vector = area_vector
        if wp.static(traits.aims_on_the_way and traits.balloons == 1):
            member.aim = aim_of(facing, area)
        elif wp.static(traits.aims_on_the_way):
            member.aim = aim_of(facing, area_of_balloon(member.own.balloon))
        return force, member

    @wp.func
    def free(t: Tables, seat: Seat, member: Member, force: wp.vec3):
        return kick(member.velocity, force, member.gain)

    @wp.func
    def swell(t: Tables, seat: Seat, member: Member, origin: wp.vec3):
        around = around_own(member.own, seat.time + t.step_seconds)
        area_vector = member.area_vector
        if wp.static(not layout.nothing_where_none):
            area_vector = wp.where(member.active, area_vector, wp.vec3())
        return swell_of_particle(
            t, seat.substep, around, member.own.share, member.gain,
            member.load, member.point - origin, member.point, member.free_velocity,
            remembered(member.velocity, member.own.n), area_vector,
        )  # fmt: skip

    @wp.func
    def inflation_now(t: Tables, seat: Seat, member: Member):
        """Its force [N], where the particle is."""
        value = member.ramp[0] + member.ramp[1] * seat.time_in_frame
        load = wp.vec2(value, 0.0)  # a given pressure
        if wp.static(traits.gas):
            load = member.load
        return inflation(member.own.kind, value, load[0], load[1], t.up, member.point, member.aim, member.area_vector)

    @wp.func
    def last_push(t: Tables, seat: Seat, member: Member):
        """The inflation of this substep [N]: kept, if it depends on where the particle was, or else found again, since
        few particles touch and registers are few."""
        if wp.static(traits.pressures):
            return member.push
        else:
            return inflation_now(t, seat, member)

    @wp.func
    def push(t: Tables, seat: Seat, member: Member, velocity: wp.vec3, force: wp.vec3):
        pushed = inflation_now(t, seat, member)
        if wp.static(traits.pressures):
            member.push = pushed
        old_velocity = member.velocity
        if wp.static(traits.gas and not traits.aims):  # no other force is left, and the pressure takes few products
            pressure = pressure_at(member.load[0], member.load[1], member.point, t.up)
            member.velocity = kick(velocity, member.area_vector, member.gain * pressure)
        else:
            member.velocity = kick(velocity, force + pushed, member.gain)
        member.point = drift(member.point, old_velocity, member.velocity, t.step_seconds)
        return member

    @wp.func
    def is_inside(member: Member, center: wp.vec3, radius: float):
        """Whether a particle that moves is inside a sphere."""
        return member.own.mass > 0.0 and wp.length_sq(member.point - center) < radius * radius

    @wp.func
    def see_sphere(t: Tables, seat: Seat, sphere: wp.int32):
        """Center, velocity and radius in this substep."""
        if wp.static(rolls):
            center, motion, radius = board.roll_sphere(
                t, seat.spins, seat.world, seat.thread, seat.substep, seat.time + t.step_seconds, sphere
            )
            return center, motion, radius
        else:
            there, moving, reach = board.sphere_at(t, seat.substep, seat.world, sphere)
            return there, moving, reach

    @wp.func
    def leave(t: Tables, seat: Seat, member: Member, other: Member):
        for sphere in range(spheres):
            center, motion, radius = see_sphere(t, seat, sphere)
            meets = is_inside(member, center, radius)
            other_meets = bool(False)
            if wp.static(two):
                other_meets = is_inside(other, center, radius)
            if any_in_warp(meets or other_meets):
                force = wp.vec3()
                if meets:
                    out, after, pushed = leave_one_sphere(
                        t, seat.world, sphere, center, motion, radius, member.point, member.velocity,
                        last_push(t, seat, member),
                    )  # fmt: skip
                    member.point = out
                    member.velocity = after
                    force = pushed
                if wp.static(two):
                    if other_meets:
                        out, after, pushed = leave_one_sphere(
                            t, seat.world, sphere, center, motion, radius, other.point, other.velocity,
                            last_push(t, seat, other),
                        )  # fmt: skip
                        other.point = out
                        other.velocity = after
                        force += pushed
                board.post(sphere, seat.substep, seat.thread, force)
        return member, other

    @wp.func
    def is_near(t: Tables, seat: Seat, member: Member, other: Member):
        near = bool(False)
        for sphere in range(spheres):
            center, motion, radius = see_sphere(t, seat, sphere)
            if is_near_sphere(t, center, motion, radius, member.point, member.velocity):
                near = near or member.own.mass > 0.0
            if wp.static(two):
                if is_near_sphere(t, center, motion, radius, other.point, other.velocity):
                    near = near or other.own.mass > 0.0
        return near

    @wp.func
    def stand(t: Tables, seat: Seat, member: Member):
        if member.own.mass > 0.0:
            around = around_own(member.own, seat.time + t.step_seconds)
            stood, slowed = stand_of_particle(t, around, member.point, member.velocity)
            member.point = stood
            member.velocity = slowed
        return member

    return Pieces(fill, pull, free, swell, push, leave, is_near, stand)
