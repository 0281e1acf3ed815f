"""Derivatives that only launches find: by each part, by strings, and by obstacles; where they are asked for."""

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.gradients.chain import Chain
from balloon_warp.gradients.each import require_each
from balloon_warp.gradients.obstacles import KEYFRAMES, ByObstacles, is_on_obstacles
from balloon_warp.model import Model, ModelPlan, State
from balloon_warp.model.friction import FRICTION
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.schedules.backward_each import EachBackward, bytes_of_each
from balloon_warp.schedules.backward_fixtures import POSITION, FixturesBackward, bytes_of_fixtures
from balloon_warp.schedules.backward_launched import LaunchedBackward
from balloon_warp.schedules.backward_strings import OF_STRINGS, StringsBackward
from balloon_warp.schedules.choose_backward import Backward

Values = NDArray[np.float64]
EACH, STRINGS, OBSTACLES = "each part", "strings", "obstacles"


def wanted_of(plan: ModelPlan, chains: Sequence[Chain], each: Sequence[str] = ()) -> dict[str, str]:
    """Return the derivatives that only launches find, each with the path or name that asks for it.

    Raises:
        InputError: the scene has none of a kind in `each`.
    """
    wanted = {}
    if each:
        require_each(plan, each)
        wanted[EACH] = f"each: {each[0]}"
    for chain in chains:
        for name, slopes in (item for span in chain.spans for item in span.items()):
            if name in OF_STRINGS:
                wanted[STRINGS] = chain.path
            if name in (POSITION, KEYFRAMES) or (name == FRICTION and is_on_obstacles(plan, slopes)):
                wanted[OBSTACLES] = chain.path
    return wanted


def schedule_for(wanted: dict[str, str], schedule: str) -> str:
    """Return the schedule in which frames run backwards.

    Raises:
        InputError: wanted derivatives need launches, and another schedule is asked for.
    """
    if wanted and schedule == "block":
        path = next(iter(wanted.values()))
        raise InputError(f"{path}: is derived by launches; expected the schedule launched or auto (got 'block')")
    return "launched" if wanted else schedule


def bytes_by_launches(model: Model, wanted: Collection[str]) -> int:
    """Return the device memory that this takes of each world."""
    of_obstacles = bytes_of_fixtures(model) if OBSTACLES in wanted else 0
    return (bytes_of_each(model) if EACH in wanted else 0) + of_obstacles


class ByLaunches:
    """Have frames that run backwards find wanted derivatives, and collect these.

    Args:
        backward: of launches, if anything is wanted.
    """

    def __init__(self, plan: ModelPlan, model: Model, backward: BackwardFrames, wanted: Collection[str]):
        self._obstacles: ByObstacles | None = None
        self._strings: StringsBackward | None = None
        self._each: EachBackward | None = None
        if not wanted:
            return
        assert isinstance(backward, LaunchedBackward)
        features, tables, arrays = backward.step.features, backward.tables, backward.arrays
        if EACH in wanted:
            self._each = EachBackward(model, features, tables, arrays)
            backward.parts.append(self._each)
        if STRINGS in wanted:
            self._strings = StringsBackward(model, features, tables, arrays)
            backward.parts.append(self._strings)
        if OBSTACLES in wanted:
            backward.fixtures = FixturesBackward(model, tables, backward.working)
            self._obstacles = ByObstacles(plan, model, backward.fixtures)

    def note(self, frame: int) -> None:
        """Collect the derivatives of a frame that has run backwards."""
        if self._obstacles:
            self._obstacles.note(frame)

    def taken_numbers(self) -> dict[str, Values]:
        """Return the bars of strings and obstacles since they were last taken, by the names of parameters."""
        of_strings = self._strings.taken_numbers() if self._strings else {}
        return of_strings | (self._obstacles.taken_numbers() if self._obstacles else {})

    def of_each(self) -> tuple[Values, Values]:
        """Return the bars of each spring and each triangle, see `EachBackward.found`."""
        assert self._each
        return self._each.found()


def made_backward(
    plan: ModelPlan, model: Model, state: State, runs_back: Backward, columns: Sequence[int], wanted: Collection[str]
) -> tuple[BackwardFrames, ByLaunches]:
    """Return the runner of frames backwards, with lists of contacts as long as they are forwards."""
    backward = runs_back(model, state, columns)
    return backward, ByLaunches(plan, model, backward, wanted)
