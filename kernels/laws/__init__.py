"""Laws of forces: on a particle, along a spring or a string, at a hinge, on a face, in a balloon, in a contact.

Each is a file: formula, units, source, energy, and its bounds of the step. The list is all that the rest of the house
knows of them: a law that stands there has its parameters in scenes, and acts in every schedule.
"""

from balloon_warp.kernels.laws.air import AIR_DRAG
from balloon_warp.kernels.laws.body import DAMPING, WEIGHT
from balloon_warp.kernels.laws.columns import columns_of
from balloon_warp.kernels.laws.face_air import FACE_AIR
from balloon_warp.kernels.laws.law import Law, LawInput, Parameter
from balloon_warp.kernels.laws.softening import SOFTENING
from balloon_warp.kernels.laws.springs import HOOKE, RUBBER, RUBBER_AT_LIMIT, STRING, TORSION
from balloon_warp.kernels.laws.tearing import TEARING
from balloon_warp.kernels.laws.water import WATER

LAWS: tuple[Law, ...] = (WEIGHT, DAMPING, HOOKE, RUBBER, RUBBER_AT_LIMIT, STRING, TORSION, WATER, AIR_DRAG, FACE_AIR)
"""Laws of the core, in the order in which their forces are added"""
PARAMETERS: dict[str, Parameter] = {row.name: row for row in columns_of(LAWS).rows}
"""Parameters that every scene has, by name: those of these laws, and of springs, inertia, gas and the ground"""
TAKEN: dict[str, Parameter] = PARAMETERS | {row.name: row for row in (*SOFTENING, *TEARING)}
"""Reserved names, which user-defined laws cannot give to other parameters: `PARAMETERS`, and those that only few scenes
have"""

__all__ = ["LAWS", "PARAMETERS", "TAKEN", "Law", "LawInput", "Parameter"]
