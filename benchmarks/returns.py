"""Returns of the tasks' own policies and of random ones.

Run it by python -m balloon_warp.benchmarks.returns [TASK ...].
"""

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.learn import TASKS, make_vec
from balloon_warp.system.warp_setup import quiet_warp

WORLDS = 16


def random_policy(actions: int) -> Callable[[Any], NDArray[Any]]:
    """Return a policy of so many random actions."""
    chance = np.random.default_rng(0)
    return lambda seen: chance.uniform(-1.0, 1.0, (len(seen), actions))


def returns_of(name: str, policy: Callable[[Any], NDArray[Any]]) -> NDArray[np.float64]:
    """Measure the return of the first episode of each world."""
    env = make_vec(name, WORLDS)
    observations, _ = env.reset(seed=0)
    goes_on, total = np.ones(WORLDS, dtype=bool), np.zeros(WORLDS)
    while goes_on.any():
        observations, rewards, terminated, truncated, _ = env.step(policy(observations).astype(np.float32))
        total += rewards * goes_on
        goes_on &= ~(terminated | truncated)
    return total


def main() -> None:
    quiet_warp()
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument(
        "tasks", nargs="*", metavar="TASK", choices=[[], *TASKS], help=f"{', '.join(TASKS)}; all if not given"
    )
    for name in parser.parse_args().tasks or TASKS:
        task = TASKS[name]()
        scripted, at_random = returns_of(name, task.policy), returns_of(name, random_policy(task.actions))
        print(f"{name}: {scripted.mean():.1f} scripted, {at_random.mean():.1f} random")


if __name__ == "__main__":
    main()
