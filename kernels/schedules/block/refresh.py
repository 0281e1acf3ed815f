"""The aims of normal forces, by the threads of a block."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.loops.aims import aim_loop, ring_aim_loop
from balloon_warp.kernels.loops.areas import area_vector_between, face_measures
from balloon_warp.kernels.memory import in_tile, put_in_array, put_in_tile, quad_at, vector_at
from balloon_warp.kernels.schedules.block.memory import Layout, Seat
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import (
    WARP_THREADS,
    block_barrier,
    put_word,
    shared_words,
    warp_sum,
    word_at,
)


class Refresh(NamedTuple):
    """How a block aims."""

    measure: Any
    """(t, seat, points, centers, area_vectors): every face by one thread; with a barrier"""
    area: Any
    """(balloon): its area [m^2], when faces have been measured"""
    aim: Any
    """(t, points, centers, area_vectors, particle, point, area): (A_p / A_total) n"""


@cache
def refresh_of(traits: Traits, layout: Layout) -> Refresh:
    """For a layout: faces are measured into tiles where particles are resident, and into arrays otherwise; where aims
    come of rings, their areas alone are needed."""
    warps, balloons = layout.warps, traits.balloons
    areas = shared_words("areas", traits.balloons * warps)
    at, put = (in_tile, put_in_tile) if layout.resident else (vector_at, put_in_array)
    center_of_face, area_vector_of_face = face_measures(in_tile)
    aim_of_particle = aim_loop(at)
    aim_in_ring = ring_aim_loop(in_tile)
    rings = traits.rings and (traits.fresh_normals or not layout.resident)

    @wp.func
    def measure(t: Tables, seat: Seat, points: Any, centers: Any, area_vectors: Any):
        for balloon in range(balloons):
            part = float(0.0)
            begin = t.faces.balloon_offsets[balloon]
            for face in range(begin + seat.thread, t.faces.balloon_offsets[balloon + 1], wp.block_dim()):
                if wp.static(rings):
                    part += wp.length(area_vector_between(points, quad_at(t.faces.particles, face)))
                else:
                    center = center_of_face(t.faces, points, face)
                    area_vector = area_vector_of_face(t.faces, points, face, center)
                    put(centers, face, center)
                    put(area_vectors, face, area_vector)
                    part += wp.length(area_vector)
            part = warp_sum(part)
            if seat.thread % WARP_THREADS == 0:
                put_word(areas(), balloon * warps + seat.thread // WARP_THREADS, part)
        block_barrier()

    @wp.func
    def area(balloon: wp.int32):
        total = float(0.0)
        for warp in range(warps):
            total += word_at(areas(), balloon * warps + warp)
        return total

    @wp.func
    def aim(t: Tables, points: Any, centers: Any, area_vectors: Any, particle: wp.int32, point: wp.vec3, area: float):
        if wp.static(rings):
            return aim_in_ring(t.rings, points, particle, point, area)
        else:
            return aim_of_particle(t.faces, centers, area_vectors, particle, point, area)

    return Refresh(measure, area, aim)
