"""Upper bound on a GPU's rate, by the instructions and bytes of a schedule."""

import time
from typing import Any

import warp as wp

from balloon_warp.model import Model
from balloon_warp.schedules.gather import cut_into_patches
from balloon_warp.schedules.tables import model_features

ISSUE_RATE = 4 * 32 * 1.98e9
"""thread instructions a second and multiprocessor of an H100 or H200 at its highest clock"""
L2_RATE = 5120 * 1.98e9
"""bytes a second from the L2 cache: 5,120 a clock, as NVIDIA says of the A100 and nothing of its successors"""
DRAM_RATE = 4.8e12
"""bytes a second of an H200"""
L2_BYTES = 50e6

BLOCK_INSTRUCTIONS = 191
BLOCK_OBSTACLE_INSTRUCTIONS = 100

GATHER_INSTRUCTIONS = 764
GATHER_OBSTACLE_INSTRUCTIONS = 105
GATHER_TABLE_BYTES = 12 * 8 + 16
GATHER_STATE_BYTES = 12 * 5
LAUNCHES = 64


def bound(model: Model, schedule: str) -> float | None:
    """Particle-substeps a second that the GPU could do at most; None where nobody has counted.

    Raises:
        RuntimeError: raised by Warp if the GPU is lost.
    """
    kinds = {balloon.inflation.kind for balloon in model.scene.balloon}
    if not model.device.is_cuda or kinds != {"normal_force"} or model.parameters["drag_coefficient"].numpy().any():
        return None
    if schedule == "block":
        multiprocessors = min(model.device.sm_count, model.world_count)  # a world runs on one
        return block_bound(multiprocessors, obstacles=model.sphere_count > 0)
    if schedule == "gather" and (patches := cut_into_patches(model, model_features(model))):
        blocks = min(model.device.sm_count, model.world_count * patches.count)
        return block_bound(blocks, obstacles=False)  # by the same code; messages between blocks are not counted
    if schedule == "gather":
        particles = model.world_count * model.particle_count
        launches = launch_seconds(model.device, particles) * (2 if model.sphere_count else 1)
        return gather_bound(particles, model.device.sm_count, launches, obstacles=model.sphere_count > 0)
    return None


def block_bound(multiprocessors: int, obstacles: bool) -> float:
    """Return the bound by instructions: all that moves is in shared memory and registers.

    Counted in its machine code for sm_90, for 12 springs a particle: 14 a spring (3 loads, 3 differences, 3 for the
    squared length, 1 root, 1 for the coefficient, 3 for the force) and 23 for inflation, damping, the step, the store
    and the barrier. With obstacles the profiler counts 100 more on average: 33 to add the penalties and move the
    sphere, 26 to look for contact, the rest in warps with a particle that touches. Shared memory allows about as much:
    39 wavefronts a warp without bank conflicts, at one a cycle.
    """
    instructions = BLOCK_INSTRUCTIONS + (BLOCK_OBSTACLE_INSTRUCTIONS if obstacles else 0)
    return multiprocessors * ISSUE_RATE / instructions


def gather_bound(particles: int, multiprocessors: int, launch_seconds: float, obstacles: bool) -> float:
    """Return the lower bound of a substep's time: its launch, and the slowest of issue, L2 cache and memory.

    Instructions, counted in its machine code for sm_90, for 12 springs a particle in three chunks of four: 108 a chunk,
    of which 20 are its loads and 48 the law's; 440 more for a particle's own numbers, whose addresses allow for
    strides and negative indices, the step and the ground's test; a sphere's test is some 105.

    Bytes from the L2 cache: 8 a spring (the other end and the rest length), 16 of valence, balloon and mass, and the
    vectors that are read (point, velocity, aim) and written (point, velocity). A neighbor's point is in the L1 cache
    where particles are numbered so that neighbors are near, so that it counts no more.

    Bytes from memory: the vectors alone, where they do not fit in the L2 cache; all worlds share the springs.

    Args:
        particles: in all worlds.
        launch_seconds: of a substep's launches, when their kernels do nothing.
    """
    instructions = GATHER_INSTRUCTIONS + (GATHER_OBSTACLE_INSTRUCTIONS if obstacles else 0)
    from_memory = GATHER_STATE_BYTES if particles * GATHER_STATE_BYTES > L2_BYTES else 0
    seconds = max(
        instructions / (multiprocessors * ISSUE_RATE),
        (GATHER_TABLE_BYTES + GATHER_STATE_BYTES) / L2_RATE,
        from_memory / DRAM_RATE,
    )
    return particles / (launch_seconds + particles * seconds)


@wp.kernel(enable_backward=False)
def do_nothing(unused: wp.int32):
    """Launch a thread a particle that does nothing."""


def launch_seconds(device: wp.Device, threads: int) -> float:
    """Return the time from one empty launch of a graph to the next that waits for it."""
    with wp.ScopedDevice(device), wp.ScopedCapture(device) as capture:
        for _ in range(LAUNCHES):
            wp.launch(do_nothing, threads, inputs=[0], device=device)
    graph: Any = capture.graph
    times = []
    for _ in range(5):
        wp.synchronize_device(device)
        began = time.perf_counter()
        for _ in range(10):
            wp.capture_launch(graph)
        wp.synchronize_device(device)
        times.append((time.perf_counter() - began) / (10 * LAUNCHES))
    return min(times)
