"""Which physics a model uses, for all its worlds and all its time."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model


def model_traits(model: Model) -> Traits:
    """What kernels of the model have to do."""
    kinds = {int(kind) for kind in model.inflation_kind.numpy()}
    scene = model.scene
    laws = tuple(law for law in model.laws if _acts(law, model))
    return Traits(
        laws=laws,
        columns=model.columns,
        balloons=model.balloon_count,
        spheres=model.sphere_count,
        springs_vary=bool((model.spring_stiffness_scale.numpy() != 1.0).any()),
        quads=bool((np.diff(model.face_offsets.numpy()) == 4).all()),
        guarded=any(law.kind == "spring" and law not in LAWS for law in laws),
        aims=int(NORMAL_FORCE) in kinds,
        pressures=kinds != {int(NORMAL_FORCE)},
        gas=int(GAS) in kinds,
        fresh_normals=scene.normals == "fresh" and int(NORMAL_FORCE) in kinds,
        corrected=scene.correction != "none",
        forward_euler=scene.solver == "forward_euler",
        impulses=scene.contact == "impulse" and model.sphere_count > 0,
        ground=scene.ground is not None,
    )


def _acts(law: Law, model: Model) -> bool:
    """Whether a law does anything in any world at any time."""
    if law.kind == "string" and not model.string_count:
        return False
    if law.wants and not law.wants(model.scene):
        return False
    return not law.neutral or any(
        (values != np.float32(neutral)).any()
        for name, neutral in law.neutral.items()
        for values in _values_over_time(model, name)
    )


def _values_over_time(model: Model, name: str) -> list[NDArray]:
    changes = [turn.values[name][1] for turn in model.turns if name in turn.values]
    return [model.parameters[name].numpy(), *(np.asarray(values, dtype=np.float32) for values in changes)]
