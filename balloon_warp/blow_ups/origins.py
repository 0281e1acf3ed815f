"""States kept during a simulation, from which a blow-up can be replayed."""

from dataclasses import replace

from balloon_warp.blow_ups.origin import Origin
from balloon_warp.model import Model, copy_of, overwrite

KEPT_FRAMES = 512
"""Number of frames between two kept states of a single world, from which a blow-up can be replayed: a copy costs less
than five frames, and so less than a hundredth of all"""


class Origins:
    """The start of a simulation, and of a single world the last state that was kept."""

    def __init__(self, start: Origin):
        self._start = start
        self._kept: Origin | None = None

    @property
    def last(self) -> Origin:
        """The latest to begin again from."""
        return self._kept or self._start

    def is_due(self, model: Model, frame: int) -> bool:
        """Return whether a state is to be kept at the start of a frame."""
        kept = self._kept
        alone = model.world_count == 1 and (kept is None or frame >= kept.frame + KEPT_FRAMES)
        return alone or bool(model.reach)  # values on the device are those of the last frame alone

    def keep(self, here: Origin) -> None:
        """Keep a copy of the state that a simulation is in."""
        kept = self._kept.state if self._kept else None
        if here.state is not None and kept is not None:  # its arrays are there already
            overwrite(kept, here.state)
        else:
            kept = copy_of(here.state) if here.state else None
        self._kept = replace(here, state=kept)

    def forget(self) -> None:
        """Drop the kept states: later frames do not follow from them."""
        self._kept = None
