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
    add_forces,
    bear,
    bend,
    blow,
    clear,
    collect,
    drive,
    jet,
    jet_of_holes,
    look_at_wear,
    pull,
    pull_and_face,
    push_face,
    run,
    share_out,
    soak,
    stretch,
    take,
    tear,
    wear,
    wear_out,
    weigh_skin,
)
from balloon_warp.kernels.phases.inflation import (
    add_up,
    burden,
    burst,
    even_out,
    extend,
    find_direction,
    find_lift,
    find_load,
    find_volume_rate,
    flow,
    foresee,
    given_load,
    head,
    hold,
    inflate,
    measure,
    note,
    pump,
    read_lift,
    spread,
    turn,
    weigh,
)
from balloon_warp.kernels.phases.motion import (
    collide,
    correct,
    expect,
    free,
    move,
    move_first,
    push,
    resist,
    respond,
    roll,
    set_off,
    shove,
    shove_bodies,
    tie,
    tumble,
    watch,
)

STEP: tuple[Phase, ...] = (
    # spheres and free bodies move, these also by strings that are tied to them
    roll, collide, tie, tumble,
    # balloons that touch find each other, and push
    keep_start, touch_balloons,
    # rubber softens, and tears
    wear, weigh_skin, run, tear, burst,
    # gas comes and goes
    pump, weigh, burden, respond,
    # where normal forces push: once a frame, or every substep
    measure, extend, find_direction,
    # forces, the motion by them, and the pressure that follows
    push_face, soak, pull, find_lift, read_lift, even_out, bear, jet, jet_of_holes, drive, take, given_load, expect,
    resist, free, head, foresee, find_volume_rate, hold, find_load, note, flow,
    # particles move, by all forces
    set_off, inflate, move_first, push, move,
    # springs that are too long are shortened; then faces leave ridges of obstacles and bodies, and particles leave
    # spheres, obstacles and the ground
    correct, note_unhindered, meet_ridges, leave, watch,
    # momentum is exchanged, once all have moved
    shove, shove_bodies, meet_spheres, meet_faces, meet, record_impulses,
)  # fmt: skip

Instead = Mapping[Phase, tuple[Phase, ...]]
"""Phases that a schedule executes instead of some of the step"""
NOTHING: Instead = {}
SCATTERED: Instead = {push_face: (), bear: (), soak: (), pull: (add_forces, add_area_vectors, soak, pull)}
"""Phases of `scatter`: springs, strings, hinges, triangles and faces add their forces to particles"""
FACING: Instead = {measure: (spread,), extend: (), find_direction: (), pull: (pull_and_face, turn)}
"""The loop over a particle's faces also finds the direction of normal forces"""
FILMED: Instead = {pull: (clear, stretch, collect, pull)}
"""Each face of a membrane is measured once and stores its forces at its corners"""
SHARED_PULL = (soak, bend, blow, share_out, pull)
"""Phases that are `pull` where it is `SHARED`"""
SHARED: Instead = {wear: (wear_out,), push_face: (), bear: (), soak: (), pull: SHARED_PULL}
"""Hinges, faces and membranes have added their forces to particles; rubber wears eight quads at a time"""
PULLED: Instead = {push_face: (), bear: ()}
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
    look_at_wear, weigh_skin, *AIMING, push_face, soak, pull, find_lift, read_lift, even_out, bear, jet, jet_of_holes,
    drive, given_load, inflate, add_up,
)  # fmt: skip
"""Phases that find the forces of a state, for output"""


def phases_of(features: Features, step: Sequence[Phase] = (), instead: Instead = NOTHING) -> tuple[Phase, ...]:
    """Return the phases that a scene has of a list, or of the step."""
    return tuple(each for line in step or STEP for each in instead.get(line, (line,)) if each.acts(features))


def asking_phases() -> tuple[Phase, ...]:
    """Return the phases of which the scene says whether it has them, and those that keep values."""
    return tuple(phase for phase in STEP if phase.wants or phase.neutral or phase.keeps)


def rows_of_phases() -> tuple[Parameter, ...]:
    """Return the rows of the parameters of all phases."""
    return tuple(row for phase in STEP for row in phase.rows)
