"""Adjoints of phases: functions by which a list of phases runs backwards.

Let L be a number that depends on where a scene ends. The *bar* of a value is the derivative of L by that value. A
phase's adjoint takes the bars of the phase's outputs, and returns those of its inputs. Like a phase, it names its
arguments: `velocity_bar` is the bar of a particle's own `velocity`, `force_bars` a view of those of all particles of
its world. So a schedule, which knows no physics, can run any list backwards, see `schedules.launched.backward`.
"""

from typing import Any, NamedTuple


class Adjoint(NamedTuple):
    """Hold a function that returns bars."""

    function: Any
    """Function of Warp; its arguments name its inputs"""
    of: tuple[str, ...]
    """Names whose bars it returns, in order: of the phase's inputs, or of its outputs, to be added there"""
    of_face: Any = None
    """Function of a face of a membrane that runs for all faces before, and leaves the bars of its corners there; it
    returns the bar of the balloon's numbers. None if there is none"""
    of_eight: Any = None
    """Function that adds all that `function` finds of a world's particles, eight at a time, for a CPU, see
    `adjoints.eights`. None if there is none"""
    columns: tuple[int, ...] = ()
    """Columns of the balloon's and the world's numbers whose bars it returns, where that is not all of them"""


class NoAdjointError(Exception):
    """Error of a phase without an adjoint for a feature of the scene, which the message names."""
