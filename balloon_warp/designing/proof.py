"""Proof of a design: simulation from rest with a sealed gas until nothing moves."""

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
"""Speed that counts as rest [sizes a second]"""
SLOW_FOIL = 0.05
"""Speed of foil that counts as rest [sizes a second]: foil is so stiff that it trembles in float32"""
MOST_SECONDS = 30.0
FILL_SECONDS = 1.0
DAMPING_RATE = 12.0
"""Damping rate [1/s], with which it comes to rest within seconds"""
MORE_FRAMES = 30
"""Number of a scene's frames beyond rest"""


@dataclass(frozen=True)
class Simulated:
    """A design at rest."""

    points: NDArray[np.float64]
    """Points of the particles [m], shape (n, 3)"""
    pressure: float
    """Pressure [Pa]"""
    frames: int
    """Number of frames until it was at rest"""


def filled(gas: SealedGas, start_volume: float, molar_mass: float | None = None) -> Inflation:
    """Return the inflation that brings a balloon that begins at the air's pressure to that amount of gas.

    Args:
        molar_mass: of the gas [kg/mol], where its weight counts.
    """
    begins = gas.air_pressure * start_volume / (GAS_CONSTANT * gas.temperature)
    weight = {} if molar_mass is None else {"molar_mass": molar_mass}
    return Inflation(moles=gas.amount - begins, fill_time=FILL_SECONDS, added_mass=0.0, **weight)


def scene_of(balloon: Balloon, description: str, frames: int, gravity: float = 0.0) -> Scene:
    """Return the balloon alone; it passes through itself, since designs are at rest without contact, too."""
    return Scene(description=description, balloon=[balloon], gravity=gravity, frames=frames, touch=False)


def common_fields(mesh: Path | Any, inflation: Inflation) -> dict[str, Any]:
    """Return the fields that balloons of all designs share."""
    return {"mesh": mesh, "parts": "free", "holes": "keep", "weld": False, "inflation": inflation}


def simulate_from_rest(scene: Scene, size: float, device: str | None, slow: float = SLOW) -> Simulated | str:
    """Simulate the scene's balloon; or return why that fails, in a sentence.

    Args:
        size: Size of the target [m].
        device: As for `simulate`.
        slow: Speed that counts as rest [sizes a second].
    """
    try:
        simulator = Simulator(scene, device)
        frame = simulator.relax(slow * size, MOST_SECONDS)
    except (BlowUpError, InputError) as failure:
        return str(failure)
    return Simulated(frame.points[0].astype(np.float64), float(frame.pressures[0]), frame.number)
