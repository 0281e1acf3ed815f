"""Particles of a world as kernels read them."""

from typing import Any

import warp as wp

from balloon_warp.kernels.tables import ParticleTable
from balloon_warp.model import Model


def particle_table(model: Model) -> Any:
    """Return each particle's balloon and share of its mass, and where each balloon's particles begin."""
    table = ParticleTable()
    table.balloon, table.mass_share = model.particle_balloon, model.particle_mass_share
    table.offsets = wp.array(model.particle_offsets, dtype=wp.int32, device=model.device)
    return table
