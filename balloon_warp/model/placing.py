"""Places and velocities of particles at the start."""

import warp as wp

from balloon_warp.kernels.frames.around import place_balloons
from balloon_warp.launching import launch
from balloon_warp.model.model import Model


def place_particles(model: Model, points: wp.array, velocities: wp.array, mask: wp.array | None = None) -> None:
    """Place the particles of all worlds where they start, or of those for which a mask is not 0."""
    parameters = model.parameters
    launch(
        place_balloons,
        points.shape,
        inputs=[
            *(model.initial_points, model.particle_balloon, model.particle_mass_share, model.balloon_origins),
            *(parameters[f"initial_{name}"] for name in ("turns", "shifts", "centers", "velocities", "spins")),
            mask,
        ],
        outputs=[points, velocities],
        device=model.device,
    )
