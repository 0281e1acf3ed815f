"""Spheres and particles that exchange momentum, by the threads of a block, each of which has its own particles.

Each warp adds up what its particles press a sphere with, in a row of shared memory; then every warp adds up the rows,
in the same order every time. Two sets of rows take turns, so that one barrier a sum is enough.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.impulse import MOST_TURNS, Press, is_met, is_settled
from balloon_warp.kernels.loops.touching import (
    answer_of_ball,
    answer_to_ball,
    ball_function,
    change_of_ball,
    press_on_ball,
    rub_on_ball,
    rubbed_ball,
    rubbed_point,
    shift_of_ball,
)
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.schedules.block.board import Board
from balloon_warp.kernels.schedules.block.memory import Layout, Seat, velocity_functions
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warp_sums import sum_of_presses
from balloon_warp.kernels.warps import (
    WARP_THREADS,
    any_in_warp,
    block_barrier,
    put_word,
    shared_words,
    warp_sum,
)

WORDS_OF_WARP = wp.constant(32)
"""the numbers of `Press`, and some that are not used: a word for each thread of a warp"""


@wp.func
def one_of_two(t: Tables, seat: Seat, turn: wp.int32, two: wp.vec2):
    """What a thread is told of its first particle, or of its second."""
    return two[turn]


@cache
def adding_function(layout: Layout) -> Any:
    """The function that adds up what all threads press with."""
    warps = layout.warps
    rows = shared_words("presses", 2 * warps * 32)

    @wp.func
    def press_of_block(seat: Seat, part: Press, near: bool, turn: wp.int32):
        """By all threads, who get the same.

        Args:
            near: whether a thread has anything to add.
            turn: one more than the last time.
        """
        first = (turn % 2) * warps * WORDS_OF_WARP
        row = first + (seat.thread // WARP_THREADS) * WORDS_OF_WARP
        adds = any_in_warp(near)
        for number in range(part.length):
            total = float(0.0)
            if adds:
                total = warp_sum(part[number])
            if seat.thread % WARP_THREADS == 0:
                put_word(rows(), row + number, total)
        block_barrier()
        return sum_of_presses(rows(), first, warps)

    return press_of_block


@cache
def touching(traits: Traits, board: Board, mass_at: Any, layout: Layout) -> Any:
    """The function by which spheres and particles exchange momentum, sphere by sphere.

    Args:
        mass_at: the function that gives the mass of the particle that a thread has in a turn, of whatever the schedule
            tells it [kg].
    """
    spheres, threads = traits.spheres, layout.threads
    ball_at = ball_function(traits, board.sphere_at)
    press_of_block = adding_function(layout)
    friction_column = traits.columns.places["balloon_friction"]
    velocity_at, put_velocity = velocity_functions(layout)

    @wp.func
    def friction_at(t: Tables, world: wp.int32, particle: wp.int32):
        """Of a particle's balloon, negative where it does not say it."""
        row = row_of_world(world, t.balloon_numbers.shape[0])
        return t.balloon_numbers[row, t.particles.balloon[particle], friction_column]

    @wp.func
    def press_of_thread(t: Tables, seat: Seat, ball: Any, change: wp.vec3, told: Any, points: Any, velocities: Any):
        """By its own particles."""
        part = Press()
        for particle in range(seat.thread, seat.count, threads):
            mass = mass_at(t, seat, particle // threads, told)
            if mass > 0.0:
                part += press_on_ball(t, ball, change, mass, points[particle], velocity_at(velocities, particle))
        return part

    @wp.func
    def touch(t: Tables, seat: Seat, near: bool, told: Any, points: Any, velocities: Any):
        """Where particles are is known to the threads that have them; a barrier has come since the spheres moved.

        Args:
            near: whether any particle of the thread may touch a sphere.
            told: what `mass_at` is told.
        """
        sum_number = wp.int32(0)
        for sphere in range(spheres):
            ball = ball_at(t, seat.substep, seat.spins, seat.world, sphere)
            last = wp.vec3()
            part = Press()
            if near:
                part = press_of_thread(t, seat, ball, last, told, points, velocities)
            press = press_of_block(seat, part, near, sum_number)
            sum_number += 1
            if is_met(press):
                change = change_of_ball(t, ball, press, last)
                turn = wp.int32(1)
                while turn < MOST_TURNS and not is_settled(change, last):
                    last = change
                    if near:
                        part = press_of_thread(t, seat, ball, last, told, points, velocities)
                    press = press_of_block(seat, part, near, sum_number)
                    sum_number += 1
                    change = change_of_ball(t, ball, press, last)
                    turn += 1
                shift = shift_of_ball(t, ball, press)
                rubs = Press()
                if near:
                    for particle in range(seat.thread, seat.count, threads):
                        if t.particles.mass_share[particle] > 0.0:
                            start = points[particle]
                            speed = velocity_at(velocities, particle)
                            point, velocity = answer_to_ball(t, ball, last, change, shift, start, speed)
                            if wp.static(traits.spheres_rub):
                                mass = mass_at(t, seat, particle // threads, told)
                                friction = friction_at(t, seat.world, particle)
                                rub = rub_on_ball(t, ball, press, last, change, mass, friction, start, speed)
                                point, velocity = rubbed_point(t, rub, mass, point, velocity)
                                for number in range(6):
                                    rubs[number] += rub[number]
                            put_in_tile(points, particle, point)
                            put_velocity(velocities, particle, velocity)
                center, motion, force = answer_of_ball(t, ball, change, shift)
                if wp.static(traits.spheres_rub):
                    total = press_of_block(seat, rubs, near, sum_number)
                    sum_number += 1
                    rub = wp.spatial_vector(total[0], total[1], total[2], total[3], total[4], total[5])
                    center, motion, spin = rubbed_ball(t, ball, press, change, center, motion, rub)
                    if seat.thread == 0:
                        seat.spins[seat.world, sphere] = spin
                board.put_sphere(seat.substep, seat.thread, sphere, center, motion, ball.radius, force)

    return touch
