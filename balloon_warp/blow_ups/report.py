"""Report of a world that blew up."""

from dataclasses import asdict, dataclass
from math import ceil, isfinite
from typing import Any

from balloon_warp.blow_ups.pulls import Pull
from balloon_warp.model.stability import AUTO_MARGIN, MOST_SUBSTEPS


@dataclass(frozen=True)
class BlowUp:
    """Blow-up of a world; as text, a sentence. Fields that are None are not known, or have no part in it."""

    world: int
    frame: int
    substeps: int
    """Number of substeps in a frame"""
    step: float
    """Step [s]"""
    body: str | None
    """First particle or sphere that went bad, such as "particle 7": by the order of the vertices in its balloon's
    file"""
    substep: int | None = None
    """Number of the substep in the frame, from 1"""
    moved: float | None = None
    """Displacement in that substep [m]; infinite if its place is no longer finite"""
    spring: Pull | None = None
    """Spring of the particle with the largest tension or compression just before"""
    other: Pull | None = None
    """Larger force of another source"""
    touched: tuple[str, ...] = ()
    """Things that the particle touched"""
    stable_step: float | None = None
    """Stable step for springs, damping and speeds just before [s]; None for an implicit solver, or a sphere"""
    is_sphere: bool = False
    """Whether it is a sphere, not a particle"""
    limit_point: str | None = None
    """Limit point that the balloon has passed, under a given pressure: no step helps there"""
    pressure: float | None = None
    """Given pressure [Pa], where it alone would throw its balloon away within a frame: no step helps there, either"""
    k_normal: float | None = None
    """Given k_normal, where it alone would throw its balloon away within a frame"""

    def __str__(self) -> str:
        when = f"frame {self.frame}, world {self.world}"
        if self.substep is not None:
            when += f", substep {self.substep} of {self.substeps}"
        clauses = [f"the simulation blew up in {when}: {self.body or 'something'} {self._fate}"]
        clauses += [str(pull) for pull in (self.other, self.spring) if pull]
        clauses += [f"it touched {' and '.join(self.touched)}"] if self.touched else []
        return "; ".join([*clauses, self._advice])

    @property
    def _fate(self) -> str:
        if self.moved is not None and isfinite(self.moved):
            return f"flew off, {self.moved:.2g} m in one step"
        return "has a position that is not finite"

    @property
    def _advice(self) -> str:
        """The step beside the stable one, and the remedy."""
        if self.pressure:
            return f"its pressure of {self.pressure:.3g} Pa alone blows it up within a frame: less pressure helps"
        if self.k_normal:
            return (
                f"its k_normal of {self.k_normal:.3g}, {100.0 * self.k_normal:.3g} N in all, alone blows it up within "
                "a frame: less force helps"
            )
        if self.limit_point:
            return self.limit_point
        if self.is_sphere:
            return 'a heavier sphere, contact = "impulse", less inflation or more substeps help'
        if self.stable_step is None:
            return "more substeps, more damping or softer springs help"
        if self.stable_step == 0.0:
            return "forward Euler without damping is unstable at any step; symplectic Euler helps"
        if self.step > self.stable_step:
            enough = ceil(self.step * self.substeps / (AUTO_MARGIN * self.stable_step))
            helps = f"{enough:,} substeps a frame" if enough <= MOST_SUBSTEPS else "less force"
            return (
                f"the step of {self.step:.2e} s exceeds the largest stable step, then {self.stable_step:.2e} s: "
                f"{helps}, more damping or softer springs help"
            )
        return (
            f"the step of {self.step:.2e} s is stable for its springs (up to {self.stable_step:.2e} s): less force or "
            "more substeps help"
        )

    def as_json(self) -> dict[str, Any]:
        """Return the report as JSON, with its sentence."""
        moved = self.moved if self.moved is not None and isfinite(self.moved) else None
        return {**asdict(self), "moved": moved, "sentence": str(self)}
