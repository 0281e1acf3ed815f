"""The state: what changes during a simulation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import warp as wp

from balloon_warp.kernels.frames.around import place_balloons
from balloon_warp.kernels.measure.health import HEALTHY
from balloon_warp.launching import launch
from balloon_warp.mesh.placement import rotation_matrix
from balloon_warp.model.bodies import initial_centers, initial_turns, most_touches
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.model.model import Model


@dataclass
class State:
    """Device arrays of all worlds at one time."""

    frame: wp.array
    """how many frames have passed, shape (1,), int32"""
    points: wp.array
    """[m], shape (world_count, particle_count), vec3"""
    velocities: wp.array
    """[m/s], shape (world_count, particle_count), vec3"""
    sphere_positions: wp.array
    """[m], shape (world_count, sphere_count), vec3"""
    sphere_velocities: wp.array
    """[m/s], shape (world_count, sphere_count), vec3"""
    sphere_spins: wp.array
    """[rad/s], by friction, shape (world_count, sphere_count), vec3"""
    sphere_forces: wp.array
    """penalties since the spheres last moved, which are still to act, or with what particles pressed them in the last
    substep, where they exchange momentum [N], shape (world_count, sphere_count), vec3"""
    inflation_ramp: wp.array
    """what is keyframed, such as k_normal, at the start of the frame, and its slope [1/s], shape (world_count,
    balloon_count), vec2"""
    inflation_loads: wp.array
    """under pressure or gas, the pressure at height 0 [Pa], and its rise with height [Pa/m], shape (world_count,
    balloon_count), vec2"""
    pressures: wp.array
    """of balloons with pressure or gas, above the air's [Pa], shape (world_count, balloon_count), float32"""
    pressure_slopes: wp.array
    """of balloons whose gas flows, how the pressure would rise within a substep with more of it [Pa/m^3 of free
    volume], shape (world_count, balloon_count), float32"""
    gas_amounts: wp.array
    """[mol], shape (world_count, balloon_count), float64"""
    free_volumes: wp.array
    """of gas, what it would take at one atmosphere if it got there without heat [m^3], see `kernels.laws.gas`, shape
    (world_count, balloon_count), float64"""
    air_along: wp.array
    """what moves along with a balloon of gas in the frame [kg], see `kernels.laws.added_mass`, shape (world_count,
    balloon_count), float32"""
    airs: wp.array
    """the air at balloons of gas that is pumped or flows, where air differs with height, as the frame begins: its
    pressure [Pa], temperature [K] and density [kg/m^3], shape (world_count, balloon_count), vec3"""
    tube_flows: wp.array
    """from a tube's first balloon to its second in the last substep [mol/s], shape (world_count, tube_count),
    float32"""
    vent_flows: wp.array
    """out of a balloon through its neck and its leak in the last substep, negative inwards [mol/s], shape (world_count,
    balloon_count), float32"""
    thrusts: wp.array
    """with which the jet of a balloon's neck pushes it by the pressure of the last substep [N], shape (world_count,
    balloon_count), float32"""
    holds: wp.array
    """of particles where balloons touch: how far they have slipped from where they took hold of another surface [m],
    and how much of their overlap with it pushes [m], negative if they are behind it, 0 if they touch none;
    shape (world_count, particle_count), vec4, or (world_count, 0) where balloons do not touch"""
    deep: wp.array
    """1 of particles that may be deep in another balloon, where nothing is near them: at the start that is not known of
    any; of that shape, int8"""
    peaks: wp.array
    """of triangles of rubber that softens: the greatest energy density that each has had [Pa], shape (world_count,
    triangle_count), float32, or (world_count, 0) where none softens"""
    torn: wp.array
    """of faces: how far a tear may have run from there, at rest [m], negative where the face is whole, shape
    (world_count, face_count), float32, or (world_count, 0) where none may tear"""
    bursts: wp.array
    """of balloons: when each burst [s], or negative; the area of its hole [m^2], or negative once nothing encloses its
    gas any more; the face where it burst, and the stress there [Pa]; shape (world_count, balloon_count), vec4, or
    (world_count, 0)"""
    tear_planes: wp.array
    """of torn faces, the planes along which their tears run, see `laws.tearing`: unit normal and distance from the
    origin [m] on the unstretched skin, shape (world_count, face_count), vec4, or (world_count, 0)"""
    contact_pushes: wp.array
    """of each thing that balloons may touch, and each particle, in the last frame: the impulse [N s], and for how long
    they touched [s], shape (world_count, thing_count, particle_count), vec4, or (world_count, 0, particle_count) unless
    the scene asks for `contacts`"""
    contact_forces: wp.array
    """of each thing on each balloon, the net force on average over the last frame [N], shape (world_count,
    balloon_count, thing_count), vec3; things are numbered as `balloon_warp.contacts.things_of` names them"""
    contact_torques: wp.array
    """the same about the mean of the balloon's points [N m], of that shape, vec3"""
    contact_areas: wp.array
    """of the balloon that touches the thing [m^2], of that shape, float32"""
    contact_pressures: wp.array
    """the largest of any particle, its force over its own area, of two balloons both added up [Pa], of that shape,
    float32"""
    contact_places: wp.array
    """the mean of the places that are pressed, by how hard [m], of that shape, vec3"""
    body_positions: wp.array
    """centers of mass [m], shape (world_count, body_count), vec3"""
    body_turns: wp.array
    """shape (world_count, body_count), quat"""
    body_velocities: wp.array
    """[m/s], shape (world_count, body_count), vec3"""
    body_momenta: wp.array
    """angular, about their centers of mass [kg m^2/s], shape (world_count, body_count), vec3"""
    body_touches: wp.array
    """which of their points touched what in the last substep, in ascending order until the first -1, see
    `kernels.loops.holding`, shape (world_count, most_touches), int32"""
    body_impulses: wp.array
    """by which they were held out of it, and by friction [N s], of that shape, vec3"""
    unsettled: wp.array
    """of the projective solver: the frame whose iterations were the farthest from settled of those that are worth
    telling, 0 if there is none, and how much the last one changed of what springs moved, shape (world_count,), vec2"""
    overstretched: wp.array
    """of rubber that locks: the first frame, 0 if there is none, after which a face was stretched beyond its
    `most_stretch`, shape (world_count,), int32"""
    first_bad: wp.array
    """of each world the lowest particle, or sphere, numbered after the particles, that was ever where it cannot be; or
    `HEALTHY`, shape (world_count,), int32"""

    def of_world(self, world: int) -> Self:
        """The state of one world, as views."""
        return replace(
            self,
            **{
                name: array[world : world + 1]
                for name, array in vars(self).items()
                if name != "frame" and array.size and array.shape[0] > 1
            },
        )


def new_state(model: Model, room: Room) -> State:
    """A state of zeros, taken of a room."""
    worlds = model.world_count
    particles, spheres = (worlds, model.particle_count), (worlds, model.sphere_count)
    touching = (worlds, model.particle_count if model.scene.touches else 0)
    balloons, bodies = (worlds, model.balloon_count), (worlds, model.body_count)
    touches = (worlds, most_touches(model.bodies))
    pairs = (worlds, model.balloon_count, contact_shape(model)[1])
    softening = (worlds, model.triangle_count if model.softens else 0)
    bursting = (worlds, model.balloon_count if model.bursts else 0)
    return State(
        frame=room.array(1, wp.int32),
        points=room.array(particles, wp.vec3),
        velocities=room.array(particles, wp.vec3),
        sphere_positions=room.array(spheres, wp.vec3),
        sphere_velocities=room.array(spheres, wp.vec3),
        sphere_spins=room.array(spheres, wp.vec3),
        sphere_forces=room.array(spheres, wp.vec3),
        inflation_ramp=room.array(balloons, wp.vec2),
        inflation_loads=room.array(balloons, wp.vec2),
        pressures=room.array(balloons, wp.float32),
        pressure_slopes=room.array(balloons, wp.float32),
        gas_amounts=room.array(balloons, wp.float64),
        free_volumes=room.array(balloons, wp.float64),
        air_along=room.array(balloons, wp.float32),
        airs=room.array(balloons, wp.vec3),
        tube_flows=room.array((worlds, model.tube_count), wp.float32),
        vent_flows=room.array(balloons, wp.float32),
        thrusts=room.array(balloons, wp.float32),
        holds=room.array(touching, wp.vec4),
        deep=room.array(touching, wp.int8),
        peaks=room.array(softening, wp.float32),
        torn=room.array((worlds, model.face_count if model.bursts else 0), wp.float32),
        bursts=room.array(bursting, wp.vec4),
        tear_planes=room.array((worlds, model.face_count if model.bursts else 0), wp.vec4),
        contact_pushes=room.array(contact_shape(model), wp.vec4),
        contact_forces=room.array(pairs, wp.vec3),
        contact_torques=room.array(pairs, wp.vec3),
        contact_areas=room.array(pairs, wp.float32),
        contact_pressures=room.array(pairs, wp.float32),
        contact_places=room.array(pairs, wp.vec3),
        body_positions=room.array(bodies, wp.vec3),
        body_turns=room.array(bodies, wp.quat),
        body_velocities=room.array(bodies, wp.vec3),
        body_momenta=room.array(bodies, wp.vec3),
        body_touches=room.array(touches, wp.int32),
        body_impulses=room.array(touches, wp.vec3),
        unsettled=room.array(worlds, wp.vec2),
        overstretched=room.array(worlds, wp.int32),
        first_bad=room.array(worlds, wp.int32),
    )


def contact_shape(model: Model) -> tuple[int, int, int]:
    """Say for how many things it is told what they do to particles, in how many worlds: for the ground, obstacles,
    spheres, bodies and balloons."""
    things = 1 + len(model.obstacles) + model.sphere_count + model.body_count + model.balloon_count
    return model.world_count, things if model.scene.contacts else 0, model.particle_count


def initial_state(model: Model) -> State:
    """Every world at the start: in the shape of the meshes, each balloon as fast as the scene says, as a rigid body."""
    state, parameters = new_state(model, Allocating(model.device)), model.parameters
    launch(
        place_balloons,
        state.points.shape,
        inputs=[
            *(model.initial_points, model.particle_balloon, model.particle_mass_share, model.balloon_origins),
            *(parameters[f"initial_{name}"] for name in ("turns", "shifts", "centers", "velocities", "spins")),
        ],
        outputs=[state.points, state.velocities],
        device=model.device,
    )
    for array, name in (
        (state.sphere_positions, "initial_sphere_positions"),
        (state.sphere_velocities, "initial_sphere_velocities"),
        (state.sphere_spins, "initial_sphere_spins"),
        (state.inflation_loads, "initial_loads"),
        (state.pressures, "initial_pressures"),
        (state.gas_amounts, "initial_gas_amounts"),
        (state.free_volumes, "initial_free_volumes"),
    ):
        row = parameters[name].numpy()
        array.assign(np.broadcast_to(row, (model.world_count, *row.shape[1:])))
    state.deep.fill_(1)
    state.torn.fill_(-1.0)
    state.bursts.fill_(wp.vec4(-1.0, 0.0, 0.0, 0.0))
    if model.bodies:
        _place_bodies(model, state)
    state.body_touches.fill_(-1)
    state.first_bad.fill_(HEALTHY)
    return state


def _place_bodies(model: Model, state: State) -> None:
    """Where the scene puts them, with the angular momenta of the spins that it says."""
    positions, velocities, spins, masses = (
        np.asarray(model.parameters[name].numpy(), dtype=np.float64)
        for name in ("initial_body_positions", "initial_body_velocities", "initial_body_spins", "body_mass")
    )
    matrices = [rotation_matrix(body.rotation) for body in model.scene.body]
    tensors = np.array(
        [turn @ shape.inertia @ turn.T for turn, shape in zip(matrices, model.bodies, strict=True)]
    ).reshape(-1, 3, 3)
    for array, rows in (
        (state.body_positions, initial_centers(model.scene, model.bodies, positions)),
        (state.body_turns, initial_turns(model.scene)[None]),
        (state.body_velocities, velocities),
        (state.body_momenta, masses[..., None] * np.einsum("bij,wbj->wbi", tensors, spins)),
    ):
        array.assign(np.broadcast_to(rows, (model.world_count, *rows.shape[1:])).astype(np.float32))


def carried_over(model: Model, before: State, spheres: Sequence[int | None]) -> State:
    """Return a state of a model that goes on from another of the same balloons.

    Args:
        spheres: for each sphere of the model its number in the one before, or None if the model says where it starts.
    """
    state = initial_state(model)
    for name, array in vars(before).items():
        if name.startswith("contact_"):
            continue  # of the frame before, in which there were other things
        if not name.startswith("sphere_"):
            wp.copy(getattr(state, name), array)
            continue
        for now, until_now in enumerate(spheres):
            if until_now is not None:
                wp.copy(getattr(state, name)[:, now], array[:, until_now])
    return state


def world_bytes(model: Model) -> int:
    """Device memory of one world's state."""
    room = Counting()
    new_state(replace(model, world_count=1), room)
    return room.bytes


def copy_of(state: State) -> State:
    """Another state that is as it is now."""
    return State(**{name: wp.clone(array) for name, array in vars(state).items()})


def overwrite(state: State, other: State) -> None:
    """Make a state what another of the same shapes is now."""
    for name, array in vars(other).items():
        wp.copy(getattr(state, name), array)
