"""Features of a model, for all its worlds and all its time."""

import numpy as np

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.air import VARYING
from balloon_warp.kernels.laws.outer import GAS, NORMAL_FORCE
from balloon_warp.kernels.laws.springs import HOOKE, RUBBER, RUBBER_AT_LIMIT
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.model import Model
from balloon_warp.model.starts import may_be_crushed
from balloon_warp.model.timeline import active_laws, active_phases, kept_values, values_over_time
from balloon_warp.model.touch import edges_meet
from balloon_warp.schedules.membranes import membrane_laws
from balloon_warp.schedules.slices import quad_rings
from balloon_warp.schedules.touch_table import round_ridges, small_spheres

FILLS = ("fill_breaths", "fill_litres", "fill_moles", "fill_to_pressure", "fill_to_diameter")
"""Parameters of fills that need more than a pump"""
FINITE_AT_NO_LENGTH = (HOOKE, RUBBER, RUBBER_AT_LIMIT)
"""Laws of springs whose force is zero at zero length; any other may give NaN for a spring from a particle to itself"""
CHOOSE_FEATURES = frozenset(
    {"breathing_damping", "added_mass", "leak", "neck_diameter", "sphere_friction", "force_newtons", *VARYING, *FILLS}
)
"""Parameters that kernels are chosen by, and that replace them when they change"""


def choosing_parameters(features: Features) -> frozenset[str]:
    """Return the parameters that kernels are chosen by, and that replace them when they change.

    Once gas is pumped, it may stop and begin again.
    """
    may_begin = (features.gas and not features.pumps) or (features.pressures and not features.crushes)
    return CHOOSE_FEATURES | ({"keyframe_values"} if may_begin else frozenset())


def model_features(model: Model) -> Features:
    """Return the features of a model's kernels."""
    kinds = {int(kind) for kind in model.inflation_kind.numpy()}
    scene = model.scene
    laws = active_laws(model)
    viscosities = values_over_time(model, "film_viscosity")
    crushes = may_be_crushed(scene, model.shapes, list(values_over_time(model, "keyframe_values")))
    features = Features(
        laws=laws,
        columns=model.columns,
        active=tuple(phase.name for phase in active_phases(model)),
        keeps=kept_values(model),
        membranes=membrane_laws(model),
        viscous=any(values.any() for values in viscosities),
        softens=model.softens,
        bursts=model.bursts,
        balloons=model.balloon_count,
        spheres=model.sphere_count,
        springs_vary=bool((model.spring_stiffness_scale.numpy() != 1.0).any()),
        quads=bool((np.diff(model.face_offsets.numpy()) == 4).all()),
        revisits=len(model.particle_faces) < len(model.face_particles),
        rings=quad_rings(model) is not None and not model.bursts,  # holes are faces of their own
        guarded=any(law.kind == "spring" and law not in FINITE_AT_NO_LENGTH for law in laws),
        inflation_directions=int(NORMAL_FORCE) in kinds,
        pressures=kinds != {int(NORMAL_FORCE)},
        gas=int(GAS) in kinds or model.bursts or crushes,
        crushes=crushes,
        air_varies=_air_varies(model),
        takes_air_along=int(GAS) in kinds and _takes_air_along(model),
        breathes_on=int(GAS) in kinds and scene.solver != "forward_euler" and _breathes_on(model),
        pumps=int(GAS) in kinds and (_pumps(model) or _fills(model)),
        fills=_fills(model),
        tubes=model.tube_count > 0,
        vents=_ever(model, "neck_diameter") or _ever(model, "leak") or model.bursts,
        jets=_ever(model, "neck_diameter"),
        fresh_normals=scene.normals == "fresh" and int(NORMAL_FORCE) in kinds,
        corrected=scene.correction != "none",
        driven=_ever(model, "force_newtons"),
        forward_euler=scene.solver == "forward_euler",
        impulses=scene.contact == "impulse" and model.sphere_count > 0,
        spheres_rub=model.sphere_count > 0 and _ever(model, "sphere_friction"),
        small_spheres=any(small_spheres(model)),
        ground=scene.ground is not None,
        fixtures=bool(scene.obstacle),
        fixture_meshes=any(obstacle.shape == "mesh" for obstacle in scene.obstacle),
        anchors_move=model.anchor_motion.shape[0] > 1,
        ties=any(string.body is not None for string in scene.string),
        fixtures_move=model.obstacle_motion.shape[0] > 1,
        fixtures_steered=model.is_steered,
        bodies=model.body_count,
        body_meshes=any(body.shape == "mesh" for body in scene.body),
        tells_contacts=scene.contacts,
        ridges=model.faces_meet or any(round_ridges(model)),
        round_ridges=any(round_ridges(model)),
        touches=scene.touches,
        touches_itself=scene.touches_itself,
        edges_meet=edges_meet(scene, model.shapes),
    )
    changed = {
        name
        for phase in active_phases(model)
        if phase.is_active(features)
        for name in phase.changes(features, GATHERED)
    }
    return features._replace(changes=tuple(sorted(changed)))


def _pumps(model: Model) -> bool:
    """Return whether gas is pumped, in any world at any time, or may be by changes."""
    at_start, *changed = values_over_time(model, "keyframe_values")
    of_gas = model.inflation_kind.numpy() == int(GAS)
    return bool(at_start[:, of_gas].any()) or any(values.any() for values in changed)


def _takes_air_along(model: Model) -> bool:
    """Return whether a balloon with gas has added mass, in any world at any time."""
    at_start, *changed = values_over_time(model, "added_mass")
    of_gas = model.inflation_kind.numpy() == int(GAS)
    return bool(at_start[:, of_gas].any()) or any(values.any() for values in changed)


def _air_varies(model: Model) -> bool:
    """Return whether the air differs from place to place, in any world at any time."""
    return any(
        (values != np.float32(alike)).any()
        for name, alike in VARYING.items()
        for values in values_over_time(model, name)
    )


def _fills(model: Model) -> bool:
    """Return whether a balloon is filled by more than a pump."""
    curves = any(balloon.inflation.pump_curve for balloon in model.scene.balloon)
    return curves or any(_ever(model, name) for name in FILLS)


def _ever(model: Model, name: str) -> bool:
    """Return whether a parameter is not 0 in any world at any time."""
    return any(values.any() for values in values_over_time(model, name))


def _breathes_on(model: Model) -> bool:
    """Return whether a gas's breathing is damped less than by backward Euler, in any world at any time."""
    return any((values != 1.0).any() for values in values_over_time(model, "breathing_damping"))
