"""Position correction of all worlds, a launch a color of springs."""

import numpy as np
import warp as wp

from balloon_warp.kernels.correction import correct_color
from balloon_warp.model import Model
from balloon_warp.schedules.tables import body_table, correction_table


class Corrector:
    """Shortens springs that are too long after a step; does nothing where the scene does not ask for it."""

    def __init__(self, model: Model):
        self.model = model
        self._bodies = body_table(model)
        self._table = correction_table(model)
        offsets = np.asarray(self._table.color_offsets.numpy())
        self._colors = list(zip(offsets[:-1].tolist(), np.diff(offsets).tolist(), strict=True))

    def correct(self, points: wp.array, velocities: wp.array) -> None:
        """Move `points`, and change `velocities` accordingly, both of shape (world_count, particle_count)."""
        model = self.model
        for _ in range(self._table.sweeps if self._colors else 0):
            for first_spring, count in self._colors:
                wp.launch(
                    correct_color,
                    (model.world_count, count),
                    inputs=[self._bodies, self._table, first_spring, model.step_seconds, points, velocities],
                    device=model.device,
                )
