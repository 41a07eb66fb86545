"""Exceptions. The extension module makes them, with the message that the Rust library prints."""

from __future__ import annotations


class ConnectError(ConnectionError):
    """A hand, adapter or bus that cannot be used."""

    place: str
    """The address, port or interface, as it was given."""
    cause: str
    """Name of the cause, such as ``"NothingListens"`` (docs/wraptor.md)."""
    next_step: str
    """What to do."""

    def __init__(self, message: str, place: str = "", cause: str = "", next_step: str = "") -> None:
        super().__init__(message)
        self.place = place
        self.cause = cause
        self.next_step = next_step


class CallError(Exception):
    """A call that failed."""

    call: str
    """The call, as a line of the hand's language or in words."""
    cause: str
    """Name of the failure, such as ``"Lost"`` (docs/wraptor.md)."""
    next_step: str
    """What to do."""
    status: int
    """The number after ERR; 0 where the hand did not answer one."""

    def __init__(
        self, message: str, call: str = "", cause: str = "", next_step: str = "", status: int = 0
    ) -> None:
        super().__init__(message)
        self.call = call
        self.cause = cause
        self.next_step = next_step
        self.status = status


class InvalidArgument(CallError, ValueError):
    """A call with a wrong argument; nothing was sent."""


class CallTimeout(CallError, TimeoutError):
    """A call that was not done within its limit; the hand was told to abort it."""
