"""The state: what changes during a simulation."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from balloon_warp.kernels.frame import place_balloons
from balloon_warp.kernels.health import HEALTHY
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
    sphere_forces: wp.array
    """penalties since the spheres last moved [N], shape (world_count, sphere_count), vec3"""
    inflation_ramp: wp.array
    """what is keyframed, such as k_normal, at the start of the frame, and its slope [1/s], shape (world_count,
    balloon_count), vec2"""
    inflation_aims: wp.array
    """of each particle, shape (world_count, particle_count), vec3: (A_p / A_total) n, or under pressure or gas its area
    vector [m^2]"""
    inflation_loads: wp.array
    """what multiplies the aims at height 0, and its rise with height [1/m], under pressure or gas [Pa], shape
    (world_count, balloon_count), vec2"""
    pressures: wp.array
    """of balloons with pressure or gas, above the air's [Pa], shape (world_count, balloon_count), float32"""
    gas_amounts: wp.array
    """[mol], shape (world_count, balloon_count), float64"""
    first_bad: wp.array
    """of each world the lowest particle, or sphere, numbered after the particles, that was ever where it cannot be; or
    `HEALTHY`, shape (world_count,), int32"""


def initial_state(model: Model) -> State:
    """Every world at the start: at rest, in the shape of the meshes."""
    worlds, device = model.world_count, model.device

    def rows_of_worlds(rows: wp.array) -> wp.array:
        row = rows.numpy()
        return wp.array(np.broadcast_to(row, (worlds, *row.shape[1:])), dtype=rows.dtype, device=device)

    points = wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device)
    wp.launch(
        place_balloons,
        points.shape,
        inputs=[model.initial_points, model.initial_shifts, model.particle_balloon],
        outputs=[points],
        device=device,
    )
    return State(
        frame=wp.zeros(1, dtype=wp.int32, device=device),
        points=points,
        velocities=wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device),
        sphere_positions=rows_of_worlds(model.initial_sphere_positions),
        sphere_velocities=rows_of_worlds(model.initial_sphere_velocities),
        sphere_forces=wp.zeros((worlds, model.sphere_count), dtype=wp.vec3, device=device),
        inflation_ramp=wp.zeros((worlds, model.balloon_count), dtype=wp.vec2, device=device),
        inflation_aims=wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device),
        inflation_loads=rows_of_worlds(model.initial_loads),
        pressures=rows_of_worlds(model.initial_pressures),
        gas_amounts=rows_of_worlds(model.initial_gas_amounts),
        first_bad=wp.full(worlds, HEALTHY, dtype=wp.int32, device=device),
    )


def copy_of(state: State) -> State:
    """Another state that is as it is now."""
    return State(**{name: wp.clone(array) for name, array in vars(state).items()})


def overwrite(state: State, other: State) -> None:
    """Make a state what another of the same shapes is now."""
    for name, array in vars(other).items():
        wp.copy(getattr(state, name), array)
