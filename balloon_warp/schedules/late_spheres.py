"""Spheres that appear later, on the host's side."""

import warp as wp

from balloon_warp.kernels.frames.timeline import hold_spheres
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.state import frames_of
from balloon_warp.scene.timeline import frame_at


class LateSpheres:
    """Spheres that appear during the simulation: until then, they stay at their place."""

    def __init__(self, model: Model):
        self._model = model
        frames = [frame_at(model.scene, sphere.start) for sphere in model.scene.sphere]
        self._first_frames = wp.array(frames, dtype=wp.int32, device=model.device) if any(frames) else None
        """Frame at which each sphere appears, shape (sphere_count,); None where all exist from the start"""

    def hold(self, state: State) -> None:
        """Reset spheres that have not appeared, at the end of a frame."""
        if self._first_frames is None:
            return
        starts = [self._model.parameters[f"initial_sphere_{name}"] for name in ("positions", "velocities", "spins")]
        launch(
            hold_spheres,
            state.sphere_positions.shape,
            inputs=[self._first_frames, *starts, frames_of(self._model, state)],
            outputs=[state.sphere_positions, state.sphere_velocities, state.sphere_spins],
            device=self._model.device,
        )
