"""What a design becomes: simulated from rest by the product, with a sealed gas, until nothing moves."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.kernels.laws.air import GAS_CONSTANT
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.statics.volume import SealedGas

SLOW = 0.005
"""of its size a second is at rest"""
SLOW_FOIL = 0.05
"""the same of foil, so stiff that float32 lets it tremble"""
MOST_SECONDS = 30.0
FILL_SECONDS = 1.0
DAMPING_RATE = 12.0
"""[1/s], with which it comes to rest within seconds"""
MORE_FRAMES = 30
"""that a scene has beyond rest"""


@dataclass(frozen=True)
class Simulated:
    """A design at rest."""

    points: NDArray[np.float64]
    """of its particles [m], shape (n, 3)"""
    pressure: float
    """[Pa]"""
    frames: int
    """until it was at rest"""


def filled(gas: SealedGas, start_volume: float) -> Inflation:
    """The inflation that brings a balloon that begins at the air's pressure to that amount of gas."""
    begins = gas.air_pressure * start_volume / (GAS_CONSTANT * gas.temperature)
    return Inflation(moles=gas.amount - begins, fill_time=FILL_SECONDS, added_mass=0.0)


def scene_of(balloon: Balloon, description: str, frames: int) -> Scene:
    """The balloon alone, without gravity."""
    return Scene(description=description, balloon=[balloon], gravity=0.0, frames=frames)


def common_fields(mesh: Path | Any, inflation: Inflation) -> dict[str, Any]:
    """What balloons of all designs have."""
    return {"mesh": mesh, "parts": "free", "holes": "keep", "weld": False, "inflation": inflation}


def simulate_from_rest(scene: Scene, size: float, device: str | None, slow: float = SLOW) -> Simulated | str:
    """What becomes of the scene's balloon; or why nothing does, in a sentence.

    Args:
        size: of what is wanted [m].
        slow: of the size a second is at rest.
    """
    try:
        simulator = Simulator(scene, device)
        frame = simulator.relax(slow * size, MOST_SECONDS)
    except (BlowUpError, InputError) as failure:
        return str(failure)
    return Simulated(frame.points[0].astype(np.float64), float(frame.pressures[0]), frame.number)
