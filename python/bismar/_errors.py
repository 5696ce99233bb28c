"""Exceptions: one class for each kind of exit code of the command line (docs/exit-codes.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Dict, Optional, Type

if TYPE_CHECKING:
    from . import Picture


class Error(Exception):
    """Any error of Bismar. The text says what is wrong, where, and what to do."""

    exit_code: int
    """The exit code of the command line for this error: 64 to 78 (docs/exit-codes.md)."""

    def __init__(self, message: str = "", exit_code: int = 70) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class UsageError(Error, ValueError):
    """A wrong argument (exit code 64)."""


class InputError(Error):
    """A scene or a picture that cannot be used (65) or does not exist (66)."""


class InternalError(Error):
    """A bug in Bismar (70). Please report it."""


class FileError(Error):
    """A file that cannot be created (73), read or written (74), or that may not be (77)."""


class Interrupted(Error, KeyboardInterrupt):
    """Ctrl-C ended a render (75). The program goes on only if this is caught.

    It is a `KeyboardInterrupt` too, so what catches that one catches this one.
    """

    picture: Optional["Picture"] = None
    """What there is of the picture; None before the first path."""


class HostError(Error):
    """Not possible on this machine (76): memory, instruction set, Embree, a missing library, a forked process."""


class ConfigError(Error):
    """A wrong configuration file (78)."""


_CLASSES: Dict[int, Type[Error]] = {
    64: UsageError,
    65: InputError,
    66: InputError,
    70: InternalError,
    73: FileError,
    74: FileError,
    75: Interrupted,
    76: HostError,
    77: FileError,
    78: ConfigError,
}


def of(exit_code: int, message: str) -> Error:
    """The exception of an exit code."""
    return _CLASSES.get(exit_code, Error)(message, exit_code)
