"""`balloon-warp`, and `python -m balloon_warp`, which is the same."""

import gc
import sys

from balloon_warp.garbage import without_collecting


def main() -> None:
    """Run the command line; Ctrl-C while it still loads ends it with a word, too."""
    try:
        _load_without_looking_for_garbage()
        from balloon_warp.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        print("error: stopped before it began", file=sys.stderr)
        sys.exit(130)


def _load_without_looking_for_garbage() -> None:
    """What is loaded stays until the end: looking through it again and again takes longer than a tenth of a second."""
    with without_collecting():
        import balloon_warp.cli  # noqa: F401 - only to have it loaded

        gc.freeze()


if __name__ == "__main__":
    main()
