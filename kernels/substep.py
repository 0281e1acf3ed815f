"""The substep: a list of phases, in order. It stands here alone; schedules execute it.

A scene's list has the phases of its features alone, see `Phase.when`. A phase's function declares its reads and writes,
and a schedule puts a barrier where one reads results of others. So a balloon without gas goes from `pull` to `leave` in
one go; with it, all particles wait for the pressure in between.
"""

from collections.abc import Mapping, Sequence

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.law import Parameter
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.phases.contact import (
    keep_start,
    leave,
    meet,
    meet_faces,
    meet_ridges,
    meet_spheres,
    note_unhindered,
    record_impulses,
    touch_balloons,
)
from balloon_warp.kernels.phases.forces import (
    add_area_vectors,
    add_face_forces,
    add_face_pushes,
    add_forces,
    add_hinge_forces,
    add_membrane_forces,
    add_outer_forces,
    clear,
    collect,
    evaluate_wear,
    find_skin_stress,
    find_water_load,
    jet,
    jet_of_holes,
    pull,
    pull_and_face,
    push_face,
    run,
    stretch,
    take,
    tear,
    wear,
    wear_quads,
)
from balloon_warp.kernels.phases.inflation import (
    add_up,
    burst,
    even_out,
    extend,
    find_direction,
    find_effective_mass,
    find_gas_mass,
    find_lift,
    find_load,
    find_volume_rate,
    flow,
    given_load,
    inflate,
    measure,
    note,
    predict_deflection,
    predict_velocity,
    pump,
    read_gas,
    read_lift,
    spread,
    turn,
)
from balloon_warp.kernels.phases.motion import (
    apply_body_forces,
    apply_sphere_forces,
    check_speed,
    collide,
    correct,
    expect,
    free,
    move,
    move_bodies,
    move_first,
    pull_tied_bodies,
    push,
    resist,
    respond,
    roll,
    store_start,
)

STEP: tuple[Phase, ...] = (
    # spheres and free bodies move, these also by strings that are tied to them
    roll, collide, pull_tied_bodies, move_bodies,
    # balloons that touch find each other, and push
    keep_start, touch_balloons,
    # rubber softens, and tears
    wear, find_skin_stress, run, tear, burst,
    # gas comes and goes
    pump, find_gas_mass, find_effective_mass, respond,
    # where normal forces push: once a frame, or every substep
    measure, extend, find_direction,
    # forces, the motion by them, and the pressure that follows
    push_face, find_water_load, pull, find_lift, read_lift, even_out, add_face_forces, jet, jet_of_holes,
    add_outer_forces, take, given_load, expect, resist, free, predict_velocity, predict_deflection, find_volume_rate,
    read_gas, find_load, note, flow,
    # particles move, by all forces
    store_start, inflate, move_first, push, move,
    # springs that are too long are shortened; then faces leave ridges of obstacles and bodies, and particles leave
    # spheres, obstacles and the ground
    correct, note_unhindered, meet_ridges, leave, check_speed,
    # momentum is exchanged, once all have moved
    apply_sphere_forces, apply_body_forces, meet_spheres, meet_faces, meet, record_impulses,
)  # fmt: skip

Instead = Mapping[Phase, tuple[Phase, ...]]
"""Phases that a schedule executes instead of some of the step"""
NOTHING: Instead = {}
SCATTERED: Instead = {
    push_face: (),
    add_face_forces: (),
    find_water_load: (),
    pull: (add_forces, add_area_vectors, find_water_load, pull),
}
"""Phases of `scatter`: springs, strings, hinges, triangles and faces add their forces to particles"""
FACING: Instead = {measure: (spread,), extend: (), find_direction: (), pull: (pull_and_face, turn)}
"""The loop over a particle's faces also finds the direction of normal forces"""
FILMED: Instead = {pull: (clear, stretch, collect, pull)}
"""Each face of a membrane is measured once and stores its forces at its corners"""
SHARED_PULL = (find_water_load, add_hinge_forces, add_face_pushes, add_membrane_forces, pull)
"""Phases that are `pull` where it is `SHARED`"""
SHARED: Instead = {wear: (wear_quads,), push_face: (), add_face_forces: (), find_water_load: (), pull: SHARED_PULL}
"""Hinges, faces and membranes have added their forces to particles; rubber wears eight quads at a time"""
PULLED: Instead = {push_face: (), add_face_forces: ()}
"""Phases of launches where `pull` executes those of `SHARED`, eight particles side by side"""
SETTLE = Phase("settle", "launches", lambda features, look: None, also_reads=("inflation",))
"""Local and global steps in turn, until every world has converged, see `projective`"""
PROJECTIVE_STEP = (
    measure, extend, find_direction, roll, collide, inflate, SETTLE, leave, meet_spheres,
)  # fmt: skip
"""Implicit step (Liu et al. 2013)"""
AIMING = (measure, extend, find_direction)
"""Phases that find the directions of normal forces"""
READING = (
    evaluate_wear, find_skin_stress, *AIMING, push_face, find_water_load, pull, find_lift, read_lift, even_out,
    add_face_forces, jet, jet_of_holes, add_outer_forces, given_load, inflate, add_up,
)  # fmt: skip
"""Phases that find the forces of a state, for output"""


def phases_of(features: Features, step: Sequence[Phase] = (), instead: Instead = NOTHING) -> tuple[Phase, ...]:
    """Return the phases that a scene has of a list, or of the step."""
    return tuple(each for line in step or STEP for each in instead.get(line, (line,)) if each.is_active(features))


def conditional_phases() -> tuple[Phase, ...]:
    """Return the phases of which the scene says whether it has them, and those that keep values."""
    return tuple(phase for phase in STEP if phase.wants or phase.neutral or phase.keeps)


def rows_of_phases() -> tuple[Parameter, ...]:
    """Return the rows of the parameters of all phases."""
    return tuple(row for phase in STEP for row in phase.rows)
