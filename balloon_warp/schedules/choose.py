"""Choice of the schedule that simulates a model."""

from importlib import import_module
from typing import Protocol

from balloon_warp.errors import InputError
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.outer import GAS
from balloon_warp.model import Model, State
from balloon_warp.model.touch import is_in_layers
from balloon_warp.schedules.framing import looks_at_parts
from balloon_warp.schedules.layouts import fits_in_block, thread_a_particle
from balloon_warp.schedules.touch_table import ContactLists, small_spheres


class Schedule(Protocol):
    """Advances states of a model by whole frames."""

    name: str
    capturable: bool
    """Whether a frame consists of launches only, so that it can be recorded once and replayed"""

    def __init__(self, model: Model):
        """Allocate the schedule's memory."""

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        ...

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters after whose change it must be made anew."""
        ...

    @property
    def overflow(self) -> int:
        """Number of contacts in all worlds that were ignored, since lists had no place for them and could not grow."""
        ...

    @property
    def contact_lists(self) -> ContactLists | None:
        """Lists of contacts that may have to grow, if there are any."""
        ...

    def advance_frame(self, state: State) -> None:
        """Advance every world by one frame, in place.

        It counts the frame in `state.frame`, and lowers `state.first_bad` of a world where a particle or sphere has
        come to where it cannot be.
        """


SCHEDULES = {
    "scatter": ("gather", "ScatterSchedule"),
    "gather": ("gather", "GatherSchedule"),
    "block": ("one_launch", "BlockSchedule"),
    "lanes": ("one_launch", "LanesSchedule"),
    "octets": ("one_launch", "OctetsSchedule"),
}
"""Module and class of each schedule; modules load when first needed, since Warp takes a while to read their kernels"""

AS_OCTETS = "lanes as octets"
"""Schedule of gradients alone: many worlds in lanes move as one does in `octets`, to the bit"""
OF_GRADIENTS = {AS_OCTETS: ("one_launch", "LanesAsOctetsSchedule")}

IN_FREE_PATCHES = ("one_launch", "PatchedSchedule")
"""Module and class of `gather` where only free frames are moved in patches"""
BETWEEN_SEARCHES = ("one_launch", "SearchedSchedule")
"""Module and class of `block` where searches tell which worlds are clear"""
NEVER_FREE = ("gather", "PullingOctets")
"""Module and class of `octets` where no frame is free"""

LAUNCHED = ("scatter", "gather")
"""Schedules that launch a kernel for each piece of a substep: in these alone rubber tears"""
FEW_PARTICLES = 3072
"""Number of particles that a block moves in the time of the launches for a substep"""


def make_schedule(model: Model, name: str = "auto") -> Schedule:
    """Return the schedule of that name, or the fastest for the model.

    Raises:
        InputError: there is no such schedule, or it cannot simulate this model.
    """
    return schedule_named(name, model)(model)


def schedule_named(name: str, model: Model) -> type[Schedule]:
    """Return the schedule of that name, or the fastest for the model, not made yet.

    Raises:
        InputError: there is no such schedule, or it cannot simulate this model.
    """
    if name == "auto":
        name = fastest_schedule(model, model.world_count)
    if name not in SCHEDULES | OF_GRADIENTS:
        raise InputError(f"schedule {name}: no such schedule; known are auto, {', '.join(SCHEDULES)}")
    if name not in LAUNCHED and (what := only_launched(model)):
        raise InputError(f"schedule {name}: does not support {what}; auto, {' and '.join(LAUNCHED)} do")
    module, schedule = (SCHEDULES | OF_GRADIENTS)[name]
    if name == "gather" and (features := _in_patches(model)) and features.watched:
        module, schedule = IN_FREE_PATCHES
    elif name == "block" and _clears(model):
        module, schedule = BETWEEN_SEARCHES
    elif name == "octets" and model.device.is_cpu and _never_free(model):
        module, schedule = NEVER_FREE
    return getattr(import_module(f"balloon_warp.schedules.{module}"), schedule)


def only_launched(model: Model) -> str | None:
    """Return the feature of a model that only launched schedules have, in words, or None."""
    if model.bursts:
        return "balloons that burst"
    return "contact forces (contacts = true)" if model.scene.contacts else None


def resolved_schedule(name: str, model: Model, world_count: int) -> str:
    """Return `name`, with `auto` settled for a batch of a number of worlds.

    The model may be any part of the batch: a world's result does not depend on how many others it is simulated with.
    """
    return fastest_schedule(model, world_count) if name == "auto" else name


def fastest_schedule(model: Model, world_count: int) -> str:
    """Return the fastest schedule by device, size and number of worlds.

    On a GPU, a block a world, if it fits in one: where each particle has a thread; where there are enough worlds to
    give each multiprocessor one, with spheres a quarter of them, or where they could be moved in patches half of them,
    with fresh normals a third. Else, where they could not: with gas or corrections, when a substep would be many
    launches otherwise; and where it would be some, with spheres or fresh normals, which a block is done with sooner if
    it has few particles. Where the scene says how balloons touch, only where there are enough worlds; where they touch
    themselves, also where a world has few particles, if nothing else is left to launches. On the CPU, eight worlds side
    by side, or eight particles of a world that is alone or that is free in no frame.
    `python -m balloon_warp.benchmarks.auto` measures whether that is right.
    """
    if only_launched(model):
        return "gather"
    if model.device.is_cpu:
        return "octets" if world_count == 1 or _never_free(model) else "lanes"
    if _clears(model):
        many = world_count >= model.device.sm_count or model.particle_count <= FEW_PARTICLES
        return "block" if many and fits_in_block(model) else "gather"
    if _never_free(model):
        return "gather"
    if features := _in_patches(model):
        enough = model.device.sm_count // (3 if features.fresh_normals else 2)
        return "block" if world_count >= enough and fits_in_block(model) else "gather"
    if not fits_in_block(model):
        return "gather"
    from balloon_warp.schedules.tables import model_features

    many_launches = GAS in model.inflation_kind.numpy() or model.scene.correction != "none"
    some_launches = model.sphere_count > 0 or model_features(model).directions_on_the_way
    enough_worlds = world_count >= model.device.sm_count // (4 if model.sphere_count else 1)
    few_particles = thread_a_particle(model) or (some_launches and model.particle_count <= FEW_PARTICLES)
    pays = enough_worlds or (not model.scene.touch and (few_particles or many_launches))
    return "block" if pays else "gather"


def _never_free(model: Model) -> bool:
    """Return whether something may touch in every frame.

    So it is with bodies and small spheres, and with balloons that touch themselves, but for those of parts that no
    layers are.
    """
    if model.bodies or any(small_spheres(model)):
        return True
    comes_free = looks_at_parts(model) and not any(is_in_layers(shape.mesh) for shape in model.shapes)
    return bool(model.scene.touches_itself) and not comes_free


def _clears(model: Model) -> bool:
    """Return whether searches tell which worlds may go on without contact."""
    if not model.scene.touches_itself:
        return False  # so that nothing of tables need be imported
    from balloon_warp.schedules.tables import model_features

    return model_features(model).clears


def _in_patches(model: Model) -> Features | None:
    """Return the features with which `gather` moves a model in patches, maybe in free frames alone, or None."""
    if model.device.is_cpu or thread_a_particle(model) or only_launched(model):
        return None  # so that nothing of patches need be imported
    from balloon_warp.schedules.framing import free_features, has_free_frames
    from balloon_warp.schedules.gather import cut_into_patches
    from balloon_warp.schedules.one_launch import busy_in_blocks
    from balloon_warp.schedules.tables import model_features

    features = model_features(model)
    is_near = features.always_busy or features.touches_itself
    if has_free_frames(features) and not is_near and not busy_in_blocks(model, features):
        features = free_features(features)
    return features if cut_into_patches(model, features) else None
