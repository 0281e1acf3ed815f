"""Adjoints of the paper's push along normals: d = (A_near / A_total) N / |N|, N the sum of unit normals around.

This push is not conservative, so its derivative is no symmetric one: the transpose is gathered. Which face is nearest
to a particle is frozen. Of a particle's bar b by d comes

- by N: (A_near / A_total) (b - (b . n) n) / |N|, which each face around gets, and turns by its own unit normal
- by A_near, of the nearest face alone: b . n / A_total
- by A_total, summed over the balloon: -(A_near / A_total) (b . n) / A_total

and a face gives each of its corners, between those before and after, half of (after - before) x its bar.
"""

from collections.abc import Sequence
from inspect import signature
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad
from balloon_warp.kernels.compose import function_from
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.body import FAR, NORMAL_FORCE, normal_push
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phase import Adjoint, Look, Phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@wp.struct
class DirectionBars:
    """Bars that particles hand on to faces, shape (W, P), and to their balloons."""

    of_sums: wp.array2d[wp.vec3]
    """Bars of the sum of unit normals around"""
    of_areas: wp.array2d[float]
    """Bars of the area of the nearest face"""
    nearest: wp.array2d[wp.int32]
    """Nearest faces"""
    of_totals: wp.array2d[float]
    """Bars of the area of the balloon, from each particle"""
    totals: wp.array2d[float]
    """Bars of the area of each balloon, shape (W, B)"""


def directions_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of where normal forces push: kernels of their own run that backwards."""
    return ()


@wp.func
def add_direction_bar(working: Working, world: wp.int32, particle: wp.int32, bar: wp.vec3):
    """Add to the bar of a particle's direction."""
    working.direction_bars[world, particle] = working.direction_bars[world, particle] + bar


def inflate_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the force of the inflation; bars of directions are left in `working.direction_bars`."""
    if not features.inflation_directions:
        return by_grad(phase, features, look)

    @wp.func
    def push_along_adjoint(
        working: Working, world: wp.int32, particle: wp.int32, keyed: float, inflation_direction: wp.vec3,
        inflation_bar: wp.vec3,
    ):  # fmt: skip
        add_direction_bar(working, world, particle, normal_push(keyed) * inflation_bar)
        return normal_push(wp.dot(inflation_direction, inflation_bar))

    @wp.func
    def push_either_way_adjoint(
        t: Tables, working: Working, params: Any, keyed: float, load: wp.vec2, point: wp.vec3,
        inflation_direction: wp.vec3, area_vector: wp.vec3, inflation_bar: wp.vec3,
    ):  # fmt: skip
        keyed_bar = float(0.0)
        load_bar = wp.vec2()
        point_bar = wp.vec3()
        area_bar = wp.vec3()
        if params.kind == NORMAL_FORCE:
            add_direction_bar(working, params.world, params.number, normal_push(keyed) * inflation_bar)
            keyed_bar = normal_push(wp.dot(inflation_direction, inflation_bar))
        else:
            height = wp.dot(point, t.up)
            by_push = wp.dot(area_vector, inflation_bar)
            load_bar = wp.vec2(by_push, by_push * height)
            point_bar = (by_push * load[1]) * t.up
            area_bar = (load[0] + load[1] * height) * inflation_bar
        return keyed_bar, load_bar, point_bar, area_bar

    if not features.pressures:
        return (Adjoint(push_along_adjoint, ("keyed",)),)
    return (Adjoint(push_either_way_adjoint, ("keyed", "load", "point", "area_vector")),)


def expect_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the inflation that is expected, which is that of the inflation by another name."""
    if not features.inflation_directions:
        return by_grad(phase, features, look)
    (found,) = inflate_backwards(phase, features, look)
    names = [name.replace("inflation_bar", "expected_bar") for name in signature(found.function.func).parameters]
    source = (
        f"def expect_adjoint({', '.join(f'{name}: Any' for name in names)}):\n"
        f"    return inflation_adjoint({', '.join(names)})\n"
    )
    return (Adjoint(function_from("expect_adjoint", source, {"inflation_adjoint": found.function}), found.of),)


center_of_face, area_vector_of_face = face_measures(vector_at)


@wp.func
def area_of(t: Tables, points: wp.array[wp.vec3], face: wp.int32):
    """Return the area vector of a face [m^2]."""
    return area_vector_of_face(t.faces, points, face, center_of_face(t.faces, points, face))


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def hand_on_to_faces(
    t: Tables, working: Working, all_points: wp.array2d[wp.vec3], areas: wp.array2d[float], bars: DirectionBars
):
    """Turn the bar of each particle's direction into those of its inputs, and clear it."""
    world, particle = wp.tid()
    bar = working.direction_bars[world, particle]
    working.direction_bars[world, particle] = wp.vec3()
    points = all_points[world]
    normals = wp.vec3()
    squared_distance = float(FAR)
    nearest = wp.int32(-1)
    for incidence in range(t.faces.particle_offsets[particle], t.faces.particle_offsets[particle + 1]):
        face = t.faces.around_particles[incidence]
        normals += wp.normalize(area_of(t, points, face))
        squared = wp.length_sq(center_of_face(t.faces, points, face) - points[particle])
        if squared < squared_distance:
            squared_distance = squared
            nearest = face
    of_sum = wp.vec3()
    of_area = float(0.0)
    of_total = float(0.0)
    length = wp.length(normals)
    if length > 0.0 and nearest >= 0:
        normal = normals / length
        total = areas[world, t.particles.balloon[particle]]
        part = wp.length(area_of(t, points, nearest)) / total
        along = wp.dot(bar, normal)
        of_sum = (part / length) * (bar - along * normal)
        of_area = along / total
        of_total = -part * of_area
    bars.of_sums[world, particle] = of_sum
    bars.of_areas[world, particle] = of_area
    bars.nearest[world, particle] = nearest
    bars.of_totals[world, particle] = of_total


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def add_up_totals(t: Tables, bars: DirectionBars):
    """Add up the bar of each balloon's area; a block a (world, balloon)."""
    world, balloon, thread = wp.tid()
    total = float(0.0)
    for particle in range(t.particles.offsets[balloon] + thread, t.particles.offsets[balloon + 1], wp.block_dim()):
        total += bars.of_totals[world, particle]
    found = wp.tile_sum(wp.tile(total))[0]
    if thread == 0:
        bars.totals[world, balloon] = found


@wp.func
def bar_of_face(t: Tables, bars: DirectionBars, world: wp.int32, face: wp.int32, area: wp.vec3, of_total: float):
    """Return the bar of a face's area vector."""
    size = wp.length(area)
    bar = wp.vec3()
    if size > 0.0:
        normal = area / size
        of_sums = wp.vec3()
        of_size = of_total
        for corner in range(t.faces.offsets[face], t.faces.offsets[face + 1]):
            other = t.faces.particles[corner]
            of_sums += bars.of_sums[world, other]
            if bars.nearest[world, other] == face:
                of_size += bars.of_areas[world, other]
        bar = (of_sums - wp.dot(of_sums, normal) * normal) / size + of_size * normal
    return bar


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def gather_from_faces(
    t: Tables, all_points: wp.array2d[wp.vec3], bars: DirectionBars, all_point_bar: wp.array2d[wp.vec3]
):
    """Add to the bar of each particle's place the terms of the faces around it; a thread a particle of each world."""
    world, particle = wp.tid()
    points = all_points[world]
    of_total = bars.totals[world, t.particles.balloon[particle]]
    total = wp.vec3()
    for incidence in range(t.faces.particle_offsets[particle], t.faces.particle_offsets[particle + 1]):
        face = t.faces.around_particles[incidence]
        bar = bar_of_face(t, bars, world, face, area_of(t, points, face), of_total)
        begin = t.faces.offsets[face]
        count = t.faces.offsets[face + 1] - begin
        for corner in range(count):
            if t.faces.particles[begin + corner] == particle:
                before = points[t.faces.particles[begin + (corner + count - 1) % count]]
                after = points[t.faces.particles[begin + (corner + 1) % count]]
                total += 0.5 * wp.cross(after - before, bar)
    all_point_bar[world, particle] = all_point_bar[world, particle] + total
