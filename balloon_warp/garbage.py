"""Python's search for garbage, put off."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_collecting() -> Iterator[None]:
    """Suspend the cyclic garbage collector while long-lived objects are loaded or made.

    That takes a sixth of the time until the first frame. Afterwards, if a search is due, all of it counts as old, and
    is looked through seldom.

    Nothing changes where whoever calls has turned the search off.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            is_due = gc.get_count()[0] > gc.get_threshold()[0]
            if is_due and not gc.get_freeze_count():  # which counts them: else, objects that others froze would thaw
                gc.freeze()
                gc.unfreeze()  # into the oldest generation, wherever it was
            gc.enable()
