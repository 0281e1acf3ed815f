"""Features of a model in words, and a choice of scenes that covers all of them."""

from functools import cache

import numpy as np

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws import LAWS
from balloon_warp.model import Model, build_model
from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.outlook import has_free_frames


def features(model: Model) -> set[str]:
    """Return the laws and features of a model, and the contents of its tables."""
    features = model_features(model)
    found = {law.name if law in LAWS else f"own {law.kind} law" for law in features.laws}
    found |= {f"membrane {law.name}" for law in features.membranes}
    found |= {
        f"{law.name} by {name}"
        for law in features.laws
        for name, neutral in law.neutral.items()
        if (model.parameters[name].numpy() != np.float32(neutral)).any()
    }
    found |= {f"phase {name}" for name in features.acting}
    found |= {"spheres that meet"} if features.spheres_meet else set()
    found |= {"free frames"} if has_free_frames(features) else set()
    found |= {
        f"{name} {bool(value > 1 if name == 'balloons' else value)}" for name, value in switches(features).items()
    }
    return found | ({"fixed"} if any(balloon.fixed for balloon in model.scene.balloon) else set())


def switches(features: Features) -> dict[str, int]:
    """Return all features but the laws: whether each is on, or how many there are."""
    return {name: value for name, value in features._asdict().items() if isinstance(value, int)}


@cache
def some_bundled_scenes() -> list[str]:
    """Return names of a few bundled scenes that have between them all features of all, by greedy cover."""
    shown = {name: features(build_model(load_scene(name), "cpu")) for name in bundled_scenes()}
    left, found = set().union(*shown.values()), []
    while left:
        found.append(max(shown, key=lambda name: len(shown[name] & left)))
        left -= shown[found[-1]]
    return found
