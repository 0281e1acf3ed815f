"""`balloon-warp`, and `python -m balloon_warp`, which is the same."""

import gc
import sys

from balloon_warp.system.process import watch_streams, without_garbage_collection


def main() -> None:
    """Run the command line; Ctrl-C while it still loads ends it with a word, too."""
    watch_streams()
    try:
        with without_garbage_collection():
            from balloon_warp.cli import main as command_line
        command_line()
    except KeyboardInterrupt:
        print("error: interrupted before the start", file=sys.stderr)
        sys.exit(130)
    finally:
        gc.freeze()  # a last garbage collection would take a tenth of a second


if __name__ == "__main__":
    main()
