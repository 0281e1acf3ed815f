"""The state: what changes during a simulation."""

from dataclasses import dataclass

import warp as wp

from balloon_warp.kernels.worlds import spread_over_worlds
from balloon_warp.model.model import Model


@dataclass
class State:
    """Device arrays of all worlds at one time."""

    frame: wp.array[wp.int32]
    """how many frames have passed, shape (1,)"""
    points: wp.array2d[wp.vec3]
    """[m], shape (world_count, particle_count)"""
    velocities: wp.array2d[wp.vec3]
    """[m/s], shape (world_count, particle_count)"""
    sphere_positions: wp.array2d[wp.vec3]
    """[m], shape (world_count, sphere_count)"""
    sphere_velocities: wp.array2d[wp.vec3]
    """[m/s], shape (world_count, sphere_count)"""
    sphere_forces: wp.array2d[wp.vec3]
    """penalties since the spheres last moved [N], shape (world_count, sphere_count)"""
    inflation_ramp: wp.array2d[wp.vec2]
    """k_normal at the start of the frame and its slope [1/s], shape (world_count, balloon_count)"""
    inflation_aims: wp.array2d[wp.vec3]
    """(A_p / A_total) n of each particle, shape (world_count, particle_count)"""


def initial_state(model: Model) -> State:
    """Every world at the start: at rest, in the shape of the meshes."""
    worlds, device = model.world_count, model.device

    def in_every_world(rows: wp.array2d[wp.vec3]) -> wp.array2d[wp.vec3]:
        every = wp.empty((worlds, rows.shape[1]), dtype=wp.vec3, device=device)
        wp.launch(spread_over_worlds, every.shape, inputs=[rows], outputs=[every], device=device)
        return every

    return State(
        frame=wp.zeros(1, dtype=wp.int32, device=device),
        points=in_every_world(model.initial_points),
        velocities=wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device),
        sphere_positions=in_every_world(model.initial_sphere_positions),
        sphere_velocities=in_every_world(model.initial_sphere_velocities),
        sphere_forces=wp.zeros((worlds, model.sphere_count), dtype=wp.vec3, device=device),
        inflation_ramp=wp.zeros((worlds, model.balloon_count), dtype=wp.vec2, device=device),
        inflation_aims=wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device),
    )
