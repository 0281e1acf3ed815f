"""Frames of large worlds on a GPU, in one launch: each block has a patch of a world."""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.block_names import Layout, look_of
from balloon_warp.kernels.schedules.patches import PatchMemory, arguments_of_patches, kernel_of_patches
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import FACING, NOTHING, phases_of
from balloon_warp.launching import launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.block_layout import MOST_REGISTERS, REGISTERS
from balloon_warp.schedules.block_room import MOST_THREADS, thread_a_particle
from balloon_warp.schedules.patching import Patches, patch_table, patches_of, slots_in_patches, tables_in_patches
from balloon_warp.schedules.slices import kind_slots, quad_rings, spring_ends
from balloon_warp.schedules.tables import kept_arguments, world_state

BYTES_OF_PLACE = 12
"""Bytes of a point in shared memory"""
SUM_BYTES = 8192
"""Shared memory besides points [bytes]"""
PARAMS_REGISTERS, SUM_REGISTERS, MEMBRANE_REGISTERS = 56, 24, 32
"""Registers of a thread, besides those of its springs: always, where something is summed over balloons, and with
membranes"""
FEWER_REGISTERS = 32
"""Registers that may be spilled to local memory"""


def cut_into_patches(model: Model, features: Features) -> Patches | None:
    """Return the patches that worlds are moved in, or None.

    Worlds that fit a block's threads need none, and models whose particles need more of others than positions go launch
    by launch.
    """
    needs_others = (
        features.looks_at_velocities
        or bool(features.acting)
        or features.has("hinge")
        or features.has("face")
        or features.in_water
    )
    fixtures = features.stands_on_fixtures
    meets_others = features.spheres > 0 or fixtures or features.touches or features.meets_solids
    in_rounds = (
        features.corrected or features.gas_changes or (features.fresh_normals and (features.gas or not features.rings))
    )
    if model.device.is_cpu or thread_a_particle(model) or model.substeps < 2:
        return None
    if needs_others or meets_others or in_rounds or features.guarded or features.acting:
        return None
    patches = patches_of(model, features.gas)
    if patches is None or patches.largest_halo > patches.threads:
        return None
    fits = bytes_of_block(patches) <= model.device.max_shared_memory_per_block
    return patches if fits and _registers(model, features, patches) else None


def _registers(model: Model, features: Features, patches: Patches) -> int:
    """Return the registers of a thread; 0 if there are too few for it."""
    springs = sum(kind_slots(spring_ends(model))) * (3 if features.springs_vary else 2)
    sums = features.gas or features.fresh_normals
    own = PARAMS_REGISTERS + (SUM_REGISTERS if sums else 0) + (MEMBRANE_REGISTERS if features.membranes else 0)
    wanted, most = -(-(springs + own) // 8) * 8, REGISTERS // patches.threads // 8 * 8
    return min(wanted, most) if wanted - most <= FEWER_REGISTERS and wanted <= MOST_REGISTERS else 0


def worlds_at_once(model: Model, features: Features, patches: Patches) -> int:
    """Return the number of worlds for which all blocks of patches are co-resident.

    Each multiprocessor runs at least as many threads as a block may have, whatever the GPU.
    """
    blocks = min(
        REGISTERS // (patches.threads * _registers(model, features, patches)),
        MOST_THREADS // patches.threads,
        model.device.max_shared_memory_per_block // bytes_of_block(patches),
    )
    return min(model.world_count, blocks * model.device.sm_count // patches.count)


def bytes_of_block(patches: Patches) -> int:
    """Return the shared memory of a block [bytes]."""
    return BYTES_OF_PLACE * (patches.threads + patches.largest_halo) + SUM_BYTES


def step_of_patches(features: Features, layout: Layout) -> Step:
    """Return the step that patches execute, in pieces, without phases that happen only as a frame begins."""
    instead = FACING if features.directions_on_the_way else NOTHING
    phases = [phase for phase in phases_of(features, instead=instead) if phase.light or not phase.once(features)]
    return cut(phases, features, look_of(layout, features.spheres), doubles=False, sums_along=True)


def first_phases(features: Features) -> tuple[Phase, ...]:
    """Return the phases that happen only as a frame begins."""
    return tuple(phase for phase in phases_of(features) if phase.once(features) and not phase.light)


class PatchLaunch:
    """Launch that advances all worlds by a frame, as many at a time as multiprocessors allow.

    Blocks wait for each other, and so must all be co-resident.

    Args:
        working: Working memory of launches beside the state.
    """

    def __init__(
        self, model: Model, features: Features, tables: Any, patches: Patches, arrays: dict[str, Any], working: Any
    ):
        self.model, self._patches = model, patches
        rings = quad_rings(model) if features.measures_areas or features.directions_on_the_way else None
        self._layout = layout_of_patches(model, features, patches, rings is not None)
        self._step = step_of_patches(features, self._layout)
        self._at_once = worlds_at_once(model, features, patches)
        self.memory = PatchMemory()
        for name, array in arrays.items():
            setattr(self.memory, name, array)
        self._given = {
            "t": tables_in_patches(model, patches, tables, features.directions_on_the_way),
            "slots": slots_in_patches(model, patches, rings),
            "patches": patch_table(model, patches, features.directions_on_the_way),
            "memory": self.memory,
            "working": working,
        }

    @staticmethod
    def arrays(model: Model, features: Features, patches: Patches, room: Room) -> dict[str, Any]:
        """Return the memory of `PatchMemory`."""
        worlds = worlds_at_once(model, features, patches)
        return {
            "points": room.array((2 * worlds * model.particle_count,), wp.vec4),
            "sums": room.array(
                (2 * 2 * worlds * patches.count if features.gas or features.fresh_normals else 0,), wp.vec4
            ),
        }

    def advance(self, state: State, inflation_directions: wp.array | None) -> None:
        """Run the substeps of a frame."""
        kernel = kernel_of_patches(self._step, self._layout)
        for first in range(0, self.model.world_count, self._at_once):
            worlds = min(self._at_once, self.model.world_count - first)
            self.memory.points.zero_()
            self.memory.sums.zero_()
            given = {
                **self._given, **kept_arguments(state), "state": world_state(state), "first_world": first,
                "worlds_at_work": worlds, "inflation_directions": inflation_directions,
            }  # fmt: skip
            launch_tiled(
                kernel,
                dim=[worlds, self._patches.count],
                inputs=[given[name] for name in arguments_of_patches(self._step, self._layout)],
                block_dim=self._patches.threads,
                device=self.model.device,
            )


def layout_of_patches(model: Model, features: Features, patches: Patches, rings: bool) -> Layout:
    """Return a particle a thread, with a tile for those of the rim, too."""
    return Layout(
        threads=patches.threads,
        capacity=patches.threads + max(patches.largest_halo, 1),
        held=1,
        slots=kind_slots(spring_ends(model)),
        rings=int(rings),
        registers=_registers(model, features, patches),
    )
