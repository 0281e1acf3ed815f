"""Failures that docs/LIMITS.md lists under "Found by the fuzzer, not mended yet", each by a narrow condition.

The fuzzer counts them, and goes on. Whoever mends one removes its line there and here, and keeps its scene in
tests/found/.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from balloon_warp.benchmarks.physics_energy import Energies
from balloon_warp.benchmarks.physics_runs import Case

FLAT = 0.3
"""Height over that at the start, below which a gas balloon is pressed flat"""


class Known(NamedTuple):
    """A failure that is known."""

    line: str
    """Beginning of its line in docs/LIMITS.md"""
    properties: tuple[str, ...]
    """Names of the properties that fail"""
    meets: Callable[[Case], bool]
    """Condition that a scene meets"""


def is_pressed_flat(case: Case) -> bool:
    """Return whether something that moves has pressed a gas balloon flat."""
    if not any(obstacle.motion for obstacle in case.scene.obstacle):
        return False
    offsets, up = case.run.model.particle_offsets, np.array(case.scene.up)
    for number, balloon in enumerate(case.scene.balloon):
        points = case.run.states["points"][:, offsets[number] : offsets[number + 1]]
        heights = np.ptp(points @ up, axis=1)
        if balloon.inflation.kind == "gas" and (~(heights > FLAT * heights[0])).any():
            return True
    return False


def balloons_touch(case: Case) -> bool:
    """Return whether balloons may have touched."""
    return case.scene.touches


def is_heavy_gas(case: Case) -> bool:
    """Return whether a gas falls that weighs a hundredth of its skin or more."""
    amounts = case.run.states["gas_amounts"][0]
    pairs = zip(case.scene.balloon, amounts, strict=True)
    return case.scene.gravity != 0.0 and any(
        balloon.inflation.kind == "gas" and amount * balloon.inflation.molar_mass > 0.01 * balloon.mass
        for balloon, amount in pairs
    )


def swings_with_the_step(case: Case) -> bool:
    """Return whether the energy that a gas balloon gains, without contact, falls fourfold or more at half the step."""
    if not any(balloon.inflation.kind == "gas" for balloon in case.scene.balloon):
        return False
    coarse, fine = (Energies(case.finer(times)) for times in (4, 8))
    gains = [(each.total() - each.total()[0]).max() for each in (coarse, fine)]
    return bool(coarse.is_smooth and gains[1] < 0.25 * gains[0])


def has_torn(case: Case) -> bool:
    """Return whether a face has torn."""
    return bool((case.run.states["torn"] >= 0.0).any())


ALIKE = ("is_alike_in_schedules", "is_alike_turned", "is_alike_mirrored", "is_alike_moved", "is_alike_scaled")
"""Properties of motions that are not chaotic, as crumpling is"""
KNOWN = (
    Known("A heavy gas that falls", ("stays_finite", "keeps_volume"), is_heavy_gas),
    Known(
        "A gas balloon that is pressed flat",
        ("is_alike_relisted", *ALIKE),
        is_pressed_flat,
    ),
    Known("Coarse balloons that touch", ("is_as_in_reference",), balloons_touch),
    Known("A gas balloon that spins", ("gains_no_energy",), swings_with_the_step),
    Known("A tear that has both its neighbors to go to", ("is_alike_mirrored", "is_alike_relisted"), has_torn),
)


def known(case: Case, name: str) -> str | None:
    """Return the line of a failure that is known, or None."""
    return next((each.line for each in KNOWN if name in each.properties and each.meets(case)), None)
