"""A list of phases as one kernel of patches: blocks of a GPU with a part of a world each, which exchange halos.

Patches are for few large worlds: parts that blocks of a GPU move at once, for all of a frame. Each particle stays in
the registers of a thread, and the points of its patch in the block's shared memory, with a rim of those outside that
its springs and faces lead to. After each substep a block tells others where those of its particles are that they need,
and hears where its rim is. So a substep takes no launch. All blocks must run at once: no more are launched than the
multiprocessors have registers for.

An entry of the halo exchange has four words, the last of which is its round. It is written and read as a whole, so that
no other synchronization is needed. Should blocks not be co-resident after all, the kernel ends with an error after some
ten seconds.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.compose import kernel_from
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.block import BlockWriter
from balloon_warp.kernels.schedules.block_items import WORDS
from balloon_warp.kernels.schedules.block_names import Layout
from balloon_warp.kernels.schedules.writer import Piece, Step
from balloon_warp.kernels.warps import WARP_THREADS, Five, block_barrier, put_warp_sums, shared_words, sum_of_warp_sums


@wp.struct
class PatchTable:
    """Patches of a world, each of one balloon.

    In a patch's tables and tiles an own particle has the index of its thread, and a halo particle comes after all
    threads. There are at most as many halo particles as threads.
    """

    numbers: wp.array2d[wp.int32]
    """Particle of each thread; the particle count where there is none, shape (patches, threads)"""
    halos: wp.array2d[wp.int32]
    """Halo particle that each thread reads, -1 where there is none, shape (patches, threads)"""
    in_halos: wp.array[wp.int32]
    """1 for a particle that is in the rim of another patch"""
    origins: wp.array[wp.int32]
    """Index of the particle about which a balloon's volume is summed"""
    balloons: wp.array[wp.int32]
    """Balloon of each patch"""
    firsts: wp.array[wp.int32]
    """Begin of each balloon's patches, and the end of the last"""
    face_offsets: wp.array[wp.int32]
    """Begin of each patch's faces, and the end of the last, where normals are fresh: a face belongs to the patch of its
    first corner"""


@wp.struct
class PatchMemory:
    """Global memory of patches; arrays that a scene does not need are empty.

    Even and odd substeps have separate entries: a block that publishes has received the entries of others of the
    substep before.
    """

    points: wp.array[wp.vec4]
    """Positions of halo particles of the worlds at work"""
    sums: wp.array[wp.vec4]
    """Sums over the part of a balloon in each patch, in two entries: its swelling, or its area"""


@wp.struct
class PatchSeat:
    """Patch of a thread, and the blocks that it listens to."""

    slot: wp.int32  # of the world, among those at work
    slots: wp.int32  # how many there are
    patches: wp.int32  # of a world
    patch: wp.int32
    thread: wp.int32
    halo: wp.int32  # the particle that it reads, or -1
    is_published: bool  # its own particle is read by others
    begin: wp.int32  # first patch of the balloon
    count: wp.int32  # patches of the balloon


@wp.func
def take_patch(patches: PatchTable, count: wp.int32, slot: wp.int32, patch: wp.int32, thread: wp.int32):
    """Take a patch as a frame begins.

    Args:
        count: Number of worlds at work.
        slot: Index of the world among these.
    """
    seat = PatchSeat()
    seat.slot = slot
    seat.slots = count
    seat.patches = patches.balloons.shape[0]
    seat.patch = patch
    seat.thread = thread
    seat.halo = patches.halos[patch, thread]
    number = patches.numbers[patch, thread]
    if number < patches.in_halos.shape[0]:
        seat.is_published = patches.in_halos[number] != 0
    seat.begin = patches.firsts[patches.balloons[patch]]
    seat.count = patches.firsts[patches.balloons[patch] + 1] - seat.begin
    return seat


Six = wp.types.vector(length=6, dtype=wp.float32)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const unsigned long long low = (unsigned long long)__float_as_uint(v[1]) << 32 | __float_as_uint(v[0]);
    const unsigned long long high = (unsigned long long)(unsigned)round << 32 | __float_as_uint(v[2]);
    asm volatile("{ .reg .b128 entry; mov.b128 entry, {%1, %2}; st.relaxed.gpu.global.b128 [%0], entry; }"
        :: "l"(entries.data + place), "l"(low), "l"(high) : "memory");
#endif
""")
def publish(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, v: wp.vec3):
    """Publish a vector."""
    ...


def _listening(count: int) -> str:
    """Return the source of a wait for entries, one after the other: their vectors, or zeros for an idle thread.

    The threads of a warp stay together until the last has its entry. With a loop for each, which ends sooner for some
    than for others, a compiler lets the first ones proceed alone to work that only all may do.
    """
    return f"""
#if defined(__CUDA_ARCH__)
    unsigned long long low[{count}] = {{}}, high[{count}] = {{}};
    unsigned looks = 0;
    bool waits = is_needed;
    do {{
        if (++looks == 1u << 25) {{
            __trap();
        }}
        if (waits) {{
            waits = false;
            for (int n = 0; n < {count}; ++n) {{
                asm volatile(
                    "{{ .reg .b128 entry; ld.relaxed.gpu.global.b128 entry, [%2]; mov.b128 {{%0, %1}}, entry; }}"
                    : "=l"(low[n]), "=l"(high[n]) : "l"(entries.data + place + n) : "memory");
                waits |= (int)(high[n] >> 32) < round;
            }}
        }}
    }} while (__any_sync(0xffffffffu, waits));
    wp::vec_t<{3 * count}, float> heard;
    for (int n = 0; n < {count}; ++n) {{
        heard[3 * n] = __uint_as_float((unsigned)low[n]);
        heard[3 * n + 1] = __uint_as_float((unsigned)(low[n] >> 32));
        heard[3 * n + 2] = __uint_as_float((unsigned)high[n]);
    }}
    return heard;
#else
    return wp::vec_t<{3 * count}, float>();
#endif
"""


@wp.func_native(_listening(1))
def wait_for(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, is_needed: bool) -> wp.vec3:
    """Wait for another block's entry of a round, or of a later one; called by all threads of a warp."""
    ...


@wp.func_native(_listening(2))
def wait_for_two(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, is_needed: bool) -> Six:
    """Wait for two entries of another block."""
    ...


@wp.func
def publish_sums(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, sums: Five):
    """Publish five numbers, in two entries."""
    publish(entries, 2 * place, round, wp.vec3(sums[0], sums[1], sums[2]))
    publish(entries, 2 * place + 1, round, wp.vec3(sums[3], sums[4], 0.0))


@wp.func
def wait_for_sums(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, is_needed: bool):
    """Wait for the sums of another block; called by all threads of a warp."""
    heard = wait_for_two(entries, 2 * place, round, is_needed)
    return Five(heard[0], heard[1], heard[2], heard[3], heard[4])


@wp.func
def exchange(
    memory: PatchMemory,
    seat: PatchSeat,
    substep: wp.int32,
    count: wp.int32,
    particle: wp.int32,
    point: wp.vec3,
    points: Any,
    threads: wp.int32,
):
    """Exchange the positions of halo particles with the blocks around, after a substep."""
    row = ((substep & 1) * seat.slots + seat.slot) * count
    if seat.is_published:
        publish(memory.points, row + particle, substep + 1, point)
    at_halo = wait_for(memory.points, row + seat.halo, substep + 1, seat.halo >= 0)
    if seat.halo >= 0:
        put_in_tile(points, threads + seat.thread, at_halo)


@cache
def sums_of(name: str, dtype: Any, warps: int) -> Any:
    """Return the function that adds up a number, or five, over a balloon, once a substep."""
    params, others = (shared_words(f"{name} of {each}", WORDS * warps) for each in ("a patch", "patches"))

    @wp.func
    def sum_in_balloon(memory: PatchMemory, seat: PatchSeat, substep: wp.int32, part: Five):
        """Return the sum over a balloon, which is bitwise reproducible; called by all threads of all its blocks."""
        warp = WORDS * (seat.thread // WARP_THREADS)
        row = ((substep & 1) * seat.slots + seat.slot) * seat.patches
        put_warp_sums(params(), warp, part, False)
        block_barrier()
        if seat.thread < WARP_THREADS:
            of_patch = sum_of_warp_sums(params(), 0, warps)
            if seat.thread == 0:
                publish_sums(memory.sums, row + seat.patch, substep + 1, of_patch)
        other = wait_for_sums(memory.sums, row + seat.begin + seat.thread, substep + 1, seat.thread < seat.count)
        put_warp_sums(others(), warp, other, False)
        block_barrier()
        return sum_of_warp_sums(others(), 0, warps)

    @wp.func
    def sum_of_number(memory: PatchMemory, seat: PatchSeat, substep: wp.int32, part: float):
        """Return the sum of a number over a balloon; called by all threads of all its blocks."""
        return sum_in_balloon(memory, seat, substep, Five(part, 0.0, 0.0, 0.0, 0.0))[0]

    return sum_of_number if dtype is float else sum_in_balloon


class PatchWriter(BlockWriter):
    """Write the source of the kernel: that of a block, which hears from others where its rim is."""

    def __init__(self, step: Step, layout: Layout):
        super().__init__(step, layout, alone=True)  # a patch has particles of one balloon

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "advance_patches"

    @property
    def remark(self) -> str:
        """Return a sentence on the kernel."""
        threads = self.layout.threads
        return f"A block for each patch of each world, for a frame; each of {threads} threads keeps a particle."

    def _arguments(self) -> dict[str, str]:
        of_patches = {
            "patches": "PatchTable", "memory": "PatchMemory", "first_world": "wp.int32", "worlds_at_work": "wp.int32",
            "inflation_directions": "wp.array2d[wp.vec3]",
        }  # fmt: skip
        return super()._arguments() | of_patches

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        of_patches = {
            "PatchTable": PatchTable, "PatchMemory": PatchMemory, "take_patch": take_patch, "exchange": exchange,
        }  # fmt: skip
        for phase in self.phases:
            if phase.sums:
                (value,) = phase.writes
                of_patches[f"sum_of_{value}"] = sums_of(value, phase.writes[value], self.layout.warps)
        return super().names() | of_patches

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        if name == "origin_place":
            return "", "patches.origins[patch]"
        if name == "balloon":
            return "", "patches.balloons[patch]"
        if name == "ramp":
            return "balloon", "state.inflation_ramp[world, balloon]"
        return super().found(name)

    def _find_world(self) -> None:
        self.line("slot, patch, thread = wp.tid()")
        self.line("world = first_world + slot")
        self.line("seat = take_patch(patches, worlds_at_work, slot, patch, thread)")

    def _find_particle(self, number: int) -> None:
        self.line("place = thread")
        self.line("is_there = patches.numbers[patch, thread] < count")
        self.line("particle = wp.min(patches.numbers[patch, thread], count - 1)")
        if "inflation_direction" not in {value for phase in self.phases for value in phase.writes}:
            self.line("inflation_direction = vector_in(inflation_directions, world, particle)")
            self.known.add("inflation_direction")
        self.line("if seat.halo >= 0:")
        self.line(f"    put_in_tile(points, {self.layout.threads} + thread, state.points[world, seat.halo])")

    def _exchange(self, piece: Piece) -> None:
        if "point" in piece.moves:
            self.line("if substep + 1 < t.substeps:")
            self.line(f"    exchange(memory, seat, substep, count, particle, point, points, {self.layout.threads})")

    def _end_sum(self, summed: Phase | None) -> None:
        """Write a barrier, and the sum over all patches of the balloon."""
        if summed is None:
            super()._end_sum(summed)
            return
        (value,) = summed.writes
        self.line(f"{value} = sum_of_{value}(memory, seat, substep, part_of_{value})")
        self.known.add(value)

    def _items_of(self, item: str) -> tuple[str, str]:
        if item == "face":
            return "patches.face_offsets[patch]", "patches.face_offsets[patch + 1]"
        return super()._items_of(item)

    def _is_noting(self) -> str:
        return "thread == 0 and patch == seat.begin"


@cache
def kernel_of_patches(step: Step, layout: Layout) -> Any:
    """Make the kernel of a list."""
    writer = PatchWriter(step, layout)
    options = {**OPTIONS, "fast_math": True, "max_unroll": 128}
    return kernel_from(
        writer.name, writer.source(), writer.names(), cuda_max_registers=layout.registers, module_options=options
    )


@cache
def arguments_of_patches(step: Step, layout: Layout) -> tuple[str, ...]:
    """Return the names of the arguments of a list's kernel."""
    return PatchWriter(step, layout).arguments()
