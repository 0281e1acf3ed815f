"""What schedules have to do for a model, in words, and which of some scenes show all of it between them."""

from functools import cache
from itertools import combinations

import numpy as np

from balloon_warp.kernels.laws import LAWS
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model, build_model
from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.schedules.outlook import has_free_frames
from balloon_warp.schedules.traits import model_traits


def features(model: Model) -> set[str]:
    """Its laws, its traits, and what stands in tables."""
    traits = model_traits(model)
    found = {law.name if law in LAWS else f"own {law.kind} law" for law in traits.laws}
    found |= {f"membrane {law.name}" for law in traits.membranes}
    found |= {
        f"{law.name} by {name}"
        for law in traits.laws
        for name, neutral in law.neutral.items()
        if (model.parameters[name].numpy() != np.float32(neutral)).any()
    }
    found |= {f"phase {name}" for name in traits.acting}
    found |= {"spheres that meet"} if traits.spheres_meet else set()
    found |= {"free frames"} if has_free_frames(traits) else set()
    found |= {f"{name} {bool(value > 1 if name == 'balloons' else value)}" for name, value in switches(traits).items()}
    return found | ({"fixed"} if any(balloon.fixed for balloon in model.scene.balloon) else set())


def switches(traits: Traits) -> dict[str, int]:
    """All but the laws, on or off, or how many."""
    return {name: value for name, value in traits._asdict().items() if isinstance(value, int)}


def meetings(found: set[str]) -> set[tuple[str, ...]]:
    """Features, and each two of them that a model has, and not only lacks."""
    there = sorted(name for name in found if not name.endswith("False"))
    return {(name,) for name in found} | set(combinations(there, 2))


def some_with_all(shown: dict[str, set]) -> list[str]:
    """Names of some that show everything that all show between them: always the one next that adds most."""
    left, found = set().union(*shown.values()), []
    while left:
        found.append(max(shown, key=lambda name: len(shown[name] & left)))
        left -= shown[found[-1]]
    return found


@cache
def some_bundled_scenes() -> list[str]:
    """Some with all that all of them have."""
    return some_with_all({name: features(build_model(load_scene(name), "cpu")) for name in bundled_scenes()})
