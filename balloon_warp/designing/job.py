"""Run a design from its request to its folder."""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.designing.descent import Reached
from balloon_warp.designing.folder import JOB, REPORT, SAVED, SCENE, write_picture, write_report
from balloon_warp.designing.hanging import SLOW_SWING, swing_rate
from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.picture import error_picture, stacked
from balloon_warp.designing.proof import MORE_FRAMES, SLOW, SLOW_FOIL, Simulated, simulate_from_rest
from balloon_warp.designing.result import Design
from balloon_warp.designing.springs import Hold
from balloon_warp.designing.step import DesignStep
from balloon_warp.designing.where import places_off
from balloon_warp.errors import InputError
from balloon_warp.marks import without_mark
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Scene
from balloon_warp.scene.write import write_scene

Values = NDArray[np.float64]
MOVED = 0.005
"""Distance between simulated and designed shape, over the size, from which on it is reported"""


class Saved(Protocol):
    """Saved progress of a design."""

    @property
    def steps(self) -> int:
        """Steps tried until now."""
        ...

    def save(self, path: Path) -> None:
        """Write the progress to its file."""
        ...


T = TypeVar("T", bound=Saved)


@dataclass(frozen=True)
class Job:
    """Request for a design, and its output folder."""

    target: PolygonMesh
    of: str
    stretch: float
    hold: Hold
    thickness: float
    folder: Path
    steps: int
    device: str | None
    resume: bool
    say: Callable[[str], None]
    watch: Callable[[DesignStep], None] = lambda step: None
    """Callback for each step, and for the final simulation"""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Further options of this kind of design"""
    held: NDArray[np.bool_] | None = None
    """Mask of the vertices that are held against gravity, shape (n,); None where nothing is"""

    @property
    def gravity(self) -> float:
        """Return the gravity under which it is designed [m/s^2]."""
        return float(self.options.get("gravity", 0.0))

    @property
    def thickest(self) -> float:
        """Return the largest over the least thickness that the rubber may have."""
        return float(self.options.get("thickest", self.thickness)) / self.thickness

    @cached_property
    def ruler(self) -> Ruler:
        """Ruler of the target shape."""
        return Ruler(self.target, in_place=self.held is not None)

    @property
    def _slow(self) -> float:
        """Return the speed that counts as rest [sizes a second]."""
        if self.held is not None:
            return SLOW_SWING * swing_rate(self.gravity, self.ruler.size)
        return SLOW_FOIL if self.of == "foil" else SLOW

    @property
    def _asked(self) -> dict[str, Any]:
        """Return the request by which a design is recognized."""
        numbers = {"of": self.of, "stretch": self.stretch, "hold": self.hold, "thickness": self.thickness}
        points = self.target.points
        return numbers | dict(self.options) | {"vertices": len(points), "sum": float(np.abs(points).sum())}

    def saved(self, load: Callable[[Path], T]) -> T | None:
        """Return the progress of the same design, if it is to be resumed.

        Args:
            load: reader of a file that `remember` has written.

        Raises:
            InputError: nothing was saved, or of another design.
        """
        if not self.resume:
            with suppress(OSError):
                (self.folder / SAVED).unlink()
            return None
        try:
            told = without_mark(json.loads((self.folder / JOB).read_text(encoding="utf-8")))
            reached = load(self.folder / SAVED)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise InputError(f"{self.folder}: has no design to --resume") from None
        if told != self._asked:
            raise InputError(f"{self.folder}: has another design; --resume needs the same target and options")
        self.say(f"resuming after step {reached.steps}")
        return reached

    def remember(self, reached: Saved) -> None:
        """Save the progress, for `saved`."""
        write_report(self.folder / JOB, self._asked)
        reached.save(self.folder / SAVED)

    def on_step(self, reached: Reached, stretch: float | None = None) -> None:
        """Save the progress, and report it."""
        self.remember(reached)
        step = DesignStep(self.ruler, reached.steps, reached.points, stretch)
        self.say(f"{step.label}: {step.error} of the size")
        self.watch(step)

    def proven(
        self,
        scene: Scene,
        held: Values,
        plain: Values | None,
        stretch: float,
        help_: str = "",
        rival: str = "plain, at the same stretch",
        below: Image.Image | None = None,
        mould: Values | None = None,
        **more: Any,
    ) -> Design:
        """Simulate a scene from rest, and write scene, picture and report.

        Args:
            held: the balance that was designed, shape (n, 3).
            plain: that of the rival.
            stretch: of the design, in the mean.
            help_: remedy for places that are off, as the end of a sentence.
            rival: title of its picture.
            below: a picture that stands below the others.
            mould: that of rubber, which is drawn, too, shape (n, 3).
            more: for the report.

        Raises:
            InputError: it blows up or finds no rest.
        """
        self.say("simulating from rest")
        simulated = simulate_from_rest(scene, self.ruler.size, self.device, self._slow)
        if isinstance(simulated, str):
            raise InputError(f"the design does not come to rest: {simulated}; expected a smaller stretch")
        self.watch(DesignStep(self.ruler, self.steps, simulated.points, stretch, proven=True))
        scene = scene.model_copy(update={"frames": 30 * -(-(simulated.frames + MORE_FRAMES) // 30)})
        write_scene(scene, self.folder / SCENE)
        design = self._judged(scene, simulated, held, plain, stretch, help_)
        said = {**self._asked, **design.report(), "pressure": simulated.pressure, **more}
        write_report(self.folder / REPORT, said)
        self.say("drawing the errors")
        shapes = [(f"simulated from rest: {design.got}", simulated.points)]
        shapes += [] if plain is None else [(rival, plain)]
        moulds = [] if mould is None else [("its mould, drawn as large", mould)]
        picture = error_picture(self.ruler, shapes, moulds)
        write_picture(self.folder / "error.png", picture if below is None else stacked(picture, below))
        return design

    def _judged(
        self, scene: Scene, simulated: Simulated, held: Values, plain: Values | None, stretch: float, help_: str
    ) -> Design:
        """Return the design with its errors and limits."""
        ruler = self.ruler
        cannot = places_off(ruler, simulated.points, help_)
        elsewhere = np.linalg.norm(ruler.aligned(simulated.points) - ruler.aligned(held), axis=1).max() / ruler.size
        if elsewhere > MOVED:
            cannot.append(
                f"inflated from rest it settles in another equilibrium than designed, up to {100 * elsewhere:.2g}% off"
            )
        return Design(
            scene=scene,
            folder=self.folder,
            error=ruler.error(simulated.points),
            held_error=ruler.error(held),
            plain_error=None if plain is None else ruler.error(plain),
            stretch=stretch,
            stretch_asked=None if self.of == "foil" else self.stretch,
            size=float(np.ptp(ruler.aligned(simulated.points), axis=0).max()),
            size_asked=ruler.size,
            cannot=cannot,
            simulated=simulated.points,
        )
