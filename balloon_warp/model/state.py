"""The state: what changes during a simulation."""

from dataclasses import dataclass
from typing import Any

import warp as wp

from balloon_warp.kernels.worlds import place_balloons, spread_over_worlds
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
    """k_normal at the start of the frame and its slope [1/s], shape (world_count, balloon_count), vec2"""
    inflation_aims: wp.array
    """(A_p / A_total) n of each particle, shape (world_count, particle_count), vec3"""


def initial_state(model: Model) -> State:
    """Every world at the start: at rest, in the shape of the meshes."""
    worlds, device = model.world_count, model.device

    def of_worlds(count: int, kernel: Any, *inputs: wp.array) -> wp.array:
        every = wp.zeros((worlds, count), dtype=wp.vec3, device=device)
        wp.launch(kernel, every.shape, inputs=inputs, outputs=[every], device=device)
        return every

    return State(
        frame=wp.zeros(1, dtype=wp.int32, device=device),
        points=of_worlds(
            model.particle_count, place_balloons, model.initial_points, model.initial_shifts, model.particle_balloon
        ),
        velocities=wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device),
        sphere_positions=of_worlds(model.sphere_count, spread_over_worlds, model.initial_sphere_positions),
        sphere_velocities=of_worlds(model.sphere_count, spread_over_worlds, model.initial_sphere_velocities),
        sphere_forces=wp.zeros((worlds, model.sphere_count), dtype=wp.vec3, device=device),
        inflation_ramp=wp.zeros((worlds, model.balloon_count), dtype=wp.vec2, device=device),
        inflation_aims=wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device),
    )
