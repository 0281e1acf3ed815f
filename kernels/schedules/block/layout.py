"""How a world lies on a block of threads."""

from typing import NamedTuple

from balloon_warp.kernels.loops.film_places import FilmLayout


class Layout(NamedTuple):
    """Hold what a kernel is written for, beside the scene's traits."""

    threads: int
    """of a block"""
    capacity: int
    """points that a tile holds"""
    held: int = 0
    """particles that a thread keeps in registers for a frame; 0 where threads loop over all particles"""
    slots: tuple[int, int, int] = (0, 0, 0)
    """the most springs of each kind at a particle, which stay in registers, too"""
    rings: int = 0
    """if area vectors come of the ring of springs around each particle, the fewest quads in one"""
    tiles: tuple[str, ...] = ()
    """what of particles stands in shared memory, where threads loop"""
    doubled: bool = True
    """points may have a second tile, where otherwise a barrier would be needed"""
    film: FilmLayout | None = None
    """how faces of membranes are measured, if each is once"""
    odd: bool = False
    """a frame has an odd number of substeps"""
    registers: int = 64
    """of a thread"""

    @property
    def warps(self) -> int:
        """Return how many warps a block has; on a CPU a block is one thread."""
        return max(self.threads // 32, 1)
