"""The most pressure that a round balloon bears: beyond its limit point it swells without end, at any step."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.mesh.geometry import total_area
from balloon_warp.model.materials import law_of, numbers_of
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.pressure import pressures_of_membrane, pressures_of_springs
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

SOFTEST_SPRINGS = 8.0
"""Largest stretch of springs in the search for the limit point, whose pressure peaks at 2"""
STATES = 2000
CLOSE = 0.98
"""Margin on the limit pressure, since a mesh's differs from that of a sphere"""


@dataclass(frozen=True)
class LimitPoint:
    """Limit point of a balloon, the first peak of its pressure over stretch, and the pressure that it is given."""

    material: str
    stretch: float
    """Equibiaxial stretch at the limit point"""
    most: float
    """Pressure at the limit point [Pa]"""
    given: float
    """Pressure that the balloon is given [Pa]"""

    held_again: float | None = None
    """Larger stretch at which the given pressure is in equilibrium, if there is one"""

    def __str__(self) -> str:
        again = self.held_again
        beyond = f"at once, to a stretch of {again:.3g}" if again else "without end"
        return (
            f"its pressure of {self.given:.4g} Pa exceeds the {self.most:.4g} Pa that {self.material} of its area "
            f"bears at the limit point, a stretch of {self.stretch:.3g}; beyond, it swells {beyond}: less pressure "
            'helps, or a gas (inflation.kind = "gas"), whose pressure falls as it swells'
        )


def borne_pressures(
    scene: Scene, number: int, shape: BalloonShape, parameters: Parameters
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stretches, and the pressures of a sphere of the balloon's area at these [Pa], in its first world."""
    first = {name: values[:1] for name, values in parameters.items()}
    if law := law_of(scene, number):
        told = numbers_of(first, number)
        stretches = np.linspace(1.0, max(float(told["most_stretch"].item()), 1.01), STATES)
        return stretches, pressures_of_membrane(shape, law, told, stretches)[0]
    stretches = np.linspace(1.0, SOFTEST_SPRINGS, STATES)
    constants = np.array([first[row.name][0, number] for row in KINDS])
    return stretches, float(constants @ pressures_of_springs(shape)) * (stretches - 1.0) / stretches**2


def passed_limit_point(
    scene: Scene,
    number: int,
    shape: BalloonShape,
    parameters: Parameters,
    given: float,
    points: NDArray[np.float64] | None = None,
) -> LimitPoint | None:
    """Return the limit point that a balloon under a given pressure has passed.

    None if it has not, or its gas is controlled by volume.

    Args:
        parameters: of one world.
        given: its pressure [Pa].
        points: where its particles are [m], shape (particle_count, 3); without them it has passed if it bears that
            pressure at no stretch.
    """
    if scene.balloon[number].inflation.kind != "pressure" or not np.isfinite(given) or given <= 0.0:
        return None
    stretches, pressures = borne_pressures(scene, number, shape, parameters)
    if pressures.max() <= 0.0:
        return None
    falls = np.flatnonzero(np.diff(pressures) < 0.0)
    if not len(falls):
        return None
    peak = int(falls[0])
    past = given > pressures.max() / CLOSE
    if points is not None:
        past = given > CLOSE * pressures[peak]
        area = total_area(replace(shape.mesh, points=points))
        stretch = np.sqrt(area / total_area(shape.mesh))
        past = past or bool(stretch > stretches[peak] and given > np.interp(stretch, stretches, pressures))
    if not past:
        return None
    law = scene.balloon[number].material.law
    ball = "a ball of springs" if law_of(scene, number) is None else f"a ball of {law.replace('_', '-')} rubber"
    again = np.flatnonzero(pressures[peak:] > given)
    held_again = float(stretches[peak + again[0]]) if len(again) and given > pressures[peak] else None
    return LimitPoint(ball, float(stretches[peak]), float(pressures[peak]), given, held_again)


def pressures_too_high(scene: Scene, shapes: list[BalloonShape], parameters: Parameters) -> list[str]:
    """Return a sentence for each balloon of rubber under a pressure that it bears at no stretch, in any world."""
    sentences = []
    values = parameters["keyframe_values"]
    for number, shape in enumerate(shapes):
        if law_of(scene, number) and scene.balloon[number].inflation.kind == "pressure":
            given = float(np.nanmax(values[:, number]))
            if limit := passed_limit_point(scene, number, shape, parameters, given):
                sentences.append(f"{shape.name}: {limit}")
    return sentences
