"""Warp's own messages, kept off a user's terminal and notebook."""

import os
import tempfile
from functools import cache
from pathlib import Path

from balloon_warp.files import clear_left_over, folder_of_process
from balloon_warp.garbage import without_collecting
from balloon_warp.standard_streams import open_closed_streams
from balloon_warp.warp_headers import share_headers


@cache
@without_collecting()
def quiet_warp() -> int:
    """Start Warp with only its errors shown: no banner, no word of each kernel compiled, none about a missing GPU.

    Return the process that started it: this one, or one that it was forked from.

    Whoever wants to hear more is heard: this happens once, so that a `warp.config.log_level` that is set afterwards
    stays, and one that asks for more than Warp says by itself (`warp.LOG_DEBUG`) stays anyway.
    """
    import warp as wp

    open_closed_streams()
    if wp.config.log_level >= wp.LOG_INFO:
        wp.config.log_level = max(wp.config.log_level, wp.LOG_ERROR)
    # Warp's native library says on standard error itself, whatever the level, that there is no GPU.
    standard_error = os.dup(2)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            wp.init()
        except OSError:  # no home to cache kernels in, as in a locked-down container
            wp.config.kernel_cache_dir = str(folder_of_process() / "kernels")
            wp.init()
        finally:
            os.dup2(standard_error, 2)
            os.close(standard_error)
    clear_left_over(Path(tempfile.gettempdir()))
    from warp._src.context import runtime  # once it is there

    share_headers(runtime, Path(str(wp.config.kernel_cache_dir)), Path(wp.__file__).parent / "native")
    return os.getpid()
