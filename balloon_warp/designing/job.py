"""One design from what was asked for to its folder."""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.descent import Reached
from balloon_warp.designing.folder import JOB, SAVED, write_picture, write_report
from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.picture import error_picture
from balloon_warp.designing.proof import MORE_FRAMES, Simulated, simulate_from_rest
from balloon_warp.designing.result import Design
from balloon_warp.designing.springs import Hold
from balloon_warp.designing.step import DesignStep
from balloon_warp.designing.where import places_off
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Scene
from balloon_warp.scene.write import write_scene

Values = NDArray[np.float64]
MOVED = 0.005
"""of the size: what was simulated is further from what was designed, so that it is said"""


@dataclass(frozen=True)
class Job:
    """What is asked for, and where it goes."""

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
    """told each step, and what is simulated in the end"""

    @cached_property
    def ruler(self) -> Ruler:
        """Of the wanted shape."""
        return Ruler(self.target)

    @property
    def _asked(self) -> dict[str, Any]:
        """By which a design is known again."""
        numbers = {"of": self.of, "stretch": self.stretch, "hold": self.hold, "thickness": self.thickness}
        points = self.target.points
        return numbers | {"vertices": len(points), "sum": float(np.abs(points).sum())}

    def saved(self) -> Reached | None:
        """How far the same design was, where it is to be resumed.

        Raises:
            InputError: nothing was saved, or of another design.
        """
        if not self.resume:
            with suppress(OSError):
                (self.folder / SAVED).unlink()
            return None
        try:
            told = json.loads((self.folder / JOB).read_text(encoding="utf-8"))
            reached = Reached.load(self.folder / SAVED)
        except (OSError, ValueError, KeyError):
            raise InputError(f"{self.folder}: no design was begun there; expected none to --resume") from None
        if told != self._asked:
            raise InputError(f"{self.folder}: another design was begun there; expected the same target and options")
        self.say(f"going on after step {reached.steps}")
        return reached

    def on_step(self, reached: Reached, stretch: float | None = None) -> None:
        """Save how far it is, and say so."""
        write_report(self.folder / JOB, self._asked)
        reached.save(self.folder / SAVED)
        step = DesignStep(self.ruler, reached.steps, reached.points, stretch)
        self.say(f"{step.label}: {step.error} of the size")
        self.watch(step)

    def proven(
        self, scene: Scene, held: Values, plain: Values | None, stretch: float, help_: str = "", **more: Any
    ) -> Design:
        """Simulate a scene from rest, and write all down: the picture and the report, too.

        Args:
            held: the balance that was designed, shape (n, 3).
            plain: that of the rival.
            stretch: of the design, in the mean.
            help_: what may bring nearer what is off, as the end of a sentence.
            more: for the report.

        Raises:
            InputError: it blows up or finds no rest.
        """
        self.say("simulating it from rest")
        simulated = simulate_from_rest(scene, self.ruler.size, self.device)
        if isinstance(simulated, str):
            raise InputError(f"the design does not come to rest: {simulated}; expected a smaller stretch")
        self.watch(DesignStep(self.ruler, self.steps, simulated.points, stretch, proven=True))
        scene = scene.model_copy(update={"frames": 30 * -(-(simulated.frames + MORE_FRAMES) // 30)})
        write_scene(scene, self.folder / "balloon.toml")
        design = self._judged(scene, simulated, held, plain, stretch, help_)
        said = {**self._asked, **design.report(), "pressure": simulated.pressure, **more}
        write_report(self.folder / "report.json", said)
        self.say("drawing the errors")
        rival = [] if plain is None else [("plain, at the same stretch", plain)]
        write_picture(
            self.folder / "error.png", error_picture(self.ruler, [("simulated from rest", simulated.points), *rival])
        )
        return design

    def _judged(
        self, scene: Scene, simulated: Simulated, held: Values, plain: Values | None, stretch: float, help_: str
    ) -> Design:
        """The design with its errors, and what it cannot."""
        ruler = self.ruler
        cannot = places_off(ruler, simulated.points, help_)
        elsewhere = np.linalg.norm(ruler.aligned(simulated.points) - ruler.aligned(held), axis=1).max() / ruler.size
        if elsewhere > MOVED:
            cannot.append(
                f"from rest it comes to another balance than was designed, {100 * elsewhere:.2g}% off at most"
            )
        return Design(
            scene=scene,
            folder=self.folder,
            error=ruler.error(simulated.points),
            held_error=ruler.error(held),
            plain_error=None if plain is None else ruler.error(plain),
            stretch=stretch,
            cannot=cannot,
            simulated=simulated.points,
        )
