"""Warp's own messages, kept off a user's terminal."""


def quiet_warp() -> None:
    """Leave only errors: no banner, no word of each kernel compiled, none about a missing GPU."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
