"""The command line in this process."""

import sys
from collections.abc import Callable

import pytest

from balloon_warp import cli


def status_of(*words: str, main: Callable[[], object] = cli.main) -> int:
    """Run a command, as a user types it, and return its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["balloon-warp", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    return int(ended.value.code or 0)
