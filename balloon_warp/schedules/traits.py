"""Which physics a model uses, for all its worlds."""

from collections.abc import Callable

from numpy.typing import NDArray

from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model
from balloon_warp.model.parameters import NEVER_YIELDS


def model_traits(model: Model) -> Traits:
    """What kernels of the model have to do, at any time of the simulation."""

    def ever(name: str, used: Callable[[NDArray], NDArray]) -> bool:
        values = [getattr(model, name).numpy(), *(turn.values[name][1] for turn in model.turns if name in turn.values)]
        return any(used(value).any() for value in values)

    return Traits(
        springs_vary=bool((model.spring_stiffness_scale.numpy() != 1.0).any()),
        rubber=model.scene.correction == "tarantino"
        or ever("viscosity", lambda t: t > 0.0)
        or ever("yield_stretch", lambda stretch: stretch < NEVER_YIELDS),
        torsion=ever("torsion", lambda stiffness: stiffness > 0.0),
        corrected=model.scene.correction != "none",
        in_water=model.has_water,
        in_air=model.in_air,
        forward_euler=model.scene.solver == "forward_euler",
        impulses=model.scene.contact == "impulse" and model.sphere_count > 0,
    )


def beyond_basics(model: Model) -> str | None:
    """What of a model the fastest kernels do not simulate, in words, or None: they have Hookean springs, inflation,
    contacts, strings and symplectic Euler."""
    traits = model_traits(model)
    if traits.in_water:
        return "water"
    if traits.in_air:
        return "pressure, gas or drag in air"
    if traits.corrected:
        return "position correction"
    if traits.torsion:
        return "torsion springs"
    if traits.rubber:
        return "springs that are viscous or yield"
    if traits.forward_euler:
        return "forward Euler"
    return None
