"""Balloons that may burst: defaults of their tears, and features that they cannot be joined with yet."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS
from balloon_warp.kernels.laws.tearing import BRANCHING, RAYLEIGH, TEARING
from balloon_warp.scene import Scene

GAMMA_OF_AIR = 1.4
Values = NDArray[np.float64]


def settle_tears(scene: Scene, parameters: Mapping[str, Values]) -> dict[str, Values]:
    """Return the defaults of tears: stresses at which they advance and branch, and their speed.

    Also the gas that leaves a balloon with a given pressure: air, adiabatic.

    Raises:
        InputError: a balloon that may burst has something that would not burst with it.
    """
    _require_bursting_alone(scene, parameters)
    strength, density = parameters["film_strength"], parameters["initial_density"]
    shear = parameters["shear_modulus"]
    of_terms = 0.5 * (parameters["ogden_moduli"] * parameters["ogden_exponents"]).sum(axis=-1)
    is_ogden = np.array([balloon.material.law == "ogden" for balloon in scene.balloon])
    speed = RAYLEIGH * np.sqrt(np.where(is_ogden, of_terms, shear) / density)
    automatic = {"tear_strength": TEARING * strength, "branching_stress": BRANCHING * strength, "tear_speed": speed}
    settled = {name: np.where(np.isnan(parameters[name]), values, parameters[name])
               for name, values in automatic.items()}  # fmt: skip
    given = np.array([balloon.inflation.kind != "gas" and balloon.material.strength is not None
                      for balloon in scene.balloon])  # fmt: skip
    for name, of_air in {"molar_mass": DRY_AIR_MOLAR_MASS, "gamma": GAMMA_OF_AIR}.items():
        settled[name] = np.where(given, of_air, parameters[name])
    return settled


def _require_bursting_alone(scene: Scene, parameters: Mapping[str, Values]) -> None:
    may_burst = {number for number, balloon in enumerate(scene.balloon) if balloon.material.strength is not None}
    for number in may_burst:
        balloon = scene.balloon[number]
        named = f"balloon.{number}.material.strength: a balloon that may burst"
        if balloon.stiffness.torsion:
            raise InputError(f"{named} cannot have torsion springs, which hold tears together (got stiffness.torsion)")
        if balloon.material.springs:
            _require_struts(scene, number, parameters["yield_stretch"][:, number])
        if balloon.neck:
            raise InputError(f"{named} cannot have an open neck (got neck); expected one or the other")
        if balloon.inflation.kind == "normal_force":
            raise InputError(f'{named} needs a pressure or gas (got inflation.kind = "normal_force")')
    for number, tube in enumerate(scene.tube):
        if joined := may_burst & set(tube.balloons):
            raise InputError(f"tube.{number}: joins balloon {min(joined)}, which may burst; expected one or the other")
    if may_burst and scene.touches:
        raise InputError(
            "touch: balloons that may burst (material.strength) cannot touch others; expected one or the other"
        )
    if may_burst and scene.water:
        raise InputError("water: balloons that may burst (material.strength) cannot float; expected one or the other")


def _require_struts(scene: Scene, number: int, yield_stretches: Values) -> None:
    """Refuse springs that pull in a balloon that may tear, since they would go on across a tear."""
    if yield_stretches.max() > 1.0:
        raise InputError(
            f"balloon.{number}.material.springs: pull, and would hold a tear together; expected "
            "stiffness.yield_stretch = 1, so that they only push, or no springs beside a strength"
        )
    if scene.correction != "none":
        raise InputError(
            f"correction: shortens springs of balloon {number}, whose material tears, and would hold a tear together "
            f'(got "{scene.correction}"); expected "none"'
        )
