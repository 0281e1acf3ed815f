"""Places and velocities of particles at the start."""

import warp as wp

from balloon_warp.kernels.frame import place_balloons
from balloon_warp.launching import launch
from balloon_warp.model.model import Model

THREADS = 128
"""Number of threads that place the particles of a chosen world on a GPU"""


def place_particles(model: Model, points: wp.array, velocities: wp.array, mask: wp.array | None = None) -> None:
    """Place the particles of all worlds where they start, or of those for which a mask is not 0."""
    parameters = model.parameters
    world_count, particles = points.shape
    threads = 1 if model.device.is_cpu else particles if mask is None else THREADS
    launch(
        place_balloons,
        (world_count, threads),
        inputs=[
            *(model.initial_points, model.particle_balloon, model.particle_mass_share, model.balloon_origins),
            *(parameters[f"initial_{name}"] for name in ("turns", "shifts", "centers", "velocities", "spins")),
            *(mask, threads),
        ],
        outputs=[points, velocities],
        device=model.device,
    )
