"""Layout of a world on a block of threads."""

from typing import NamedTuple

from balloon_warp.kernels.loops.membrane_face_places import MembraneFaceLayout


class Layout(NamedTuple):
    """Layout of a kernel, beside the scene's features."""

    threads: int
    """Number of threads in a block"""
    capacity: int
    """Number of points that a tile holds"""
    held: int = 0
    """Number of particles that a thread keeps in registers for a frame; 0 where threads loop over all particles"""
    slots: tuple[int, int, int] = (0, 0, 0)
    """Largest number of springs of each kind at a particle, which also stay in registers"""
    rings: int = 0
    """Least number of quads around a particle, if area vectors follow from the ring of springs around it; else 0"""
    tiles: tuple[str, ...] = ()
    """State of particles in shared memory, where threads loop"""
    ordered: bool = False
    """Whether particles stand by their number of springs, so that no thread of a warp waits for another"""
    doubled: bool = True
    """Whether points may have a second tile in place of a barrier"""
    membrane_face: MembraneFaceLayout | None = None
    """Layout of the faces of membranes, if each face is measured once"""
    odd: bool = False
    """Whether a frame has an odd number of substeps"""
    registers: int = 64
    """Registers of a thread"""

    @property
    def warps(self) -> int:
        """Return how many warps a block has; on a CPU a block is one thread."""
        return max(self.threads // 32, 1)
