"""`balloon-warp`, and `python -m balloon_warp`, which is the same."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C while it still loads ends it with a word, too."""
    try:
        from balloon_warp.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        print("error: stopped before it began", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
