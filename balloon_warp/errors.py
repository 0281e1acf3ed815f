"""The errors that a user can cause. The command line prints their one sentence and no traceback."""


class InputError(ValueError):
    """Bad input: the message names the file or field, the value found, and the expected one. Exit status 2."""


class NoRoomError(InputError):
    """Worlds do not fit into a device's memory: the message says how many would. Exit status 2."""


class MissingExtraError(ImportError):
    """A feature needs an optional package: the message names the extra that installs it. Exit status 2."""


class BlowUpError(RuntimeError):
    """The simulation blew up. The message names the place, the cause and a remedy. Exit status 1.

    Args:
        report: source of the message: a `BlowUp`, or a sentence.
    """

    def __init__(self, report: object):
        super().__init__(str(report))
        self.report = report


class WorkersLostError(RuntimeError):
    """The workers of a batch, or their scheduler, are gone: the message names the loss. Exit status 1."""


class StoppedError(RuntimeError):
    """The user, or the machine, stopped a run: the message says how far it got. Exit status 130, or 143."""
