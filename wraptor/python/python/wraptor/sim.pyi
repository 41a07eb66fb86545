"""The simulator in process: runs of scenarios, and a hand and a board in simulated time."""

from collections.abc import Mapping
from os import PathLike
from typing import Any, Literal, SupportsFloat, SupportsIndex, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

__all__ = ["Board", "Hand", "Run", "run", "scenarios"]

_Overrides: TypeAlias = Mapping[str, SupportsFloat | SupportsIndex | str]
_Path: TypeAlias = str | bytes | PathLike[str] | PathLike[bytes]
_Model: TypeAlias = Literal["averaged", "switched"]

@final
class Run:
    """The result of a scenario, as `run` returns it. It can be pickled, so that a pool of processes can return it."""

    def __new__(cls, result: dict[str, Any], traces: dict[str, Any]) -> Run: ...

    @property
    def scenario(self) -> str:
        """The scenario's name."""
    @property
    def seed(self) -> int:
        """The seed of noise and scatter."""
    @property
    def passed(self) -> bool:
        """Whether all expectations were met."""
    @property
    def metrics(self) -> dict[str, Any]:
        """Metrics by name, as in run.json: numbers, words, a list of faults; None without a value."""
    @property
    def expectations(self) -> list[dict[str, Any]]:
        """The verdict on each expectation: name, ok, value, want."""
    @property
    def trace(self) -> dict[str, NDArray[np.float64]]:
        """Columns of trace.csv by name, a row a millisecond, of the scenario's first motor; empty with trace=False."""
    @property
    def traces(self) -> dict[str, dict[str, NDArray[np.float64]]]:
        """The same by motor: "link", "spread" and "tip"."""

def run(
    scenario: _Path,
    properties: _Overrides | None = None,
    plant: _Overrides | None = None,
    seed: SupportsIndex | None = None,
    *,
    rig: _Overrides | None = None,
    supply: _Overrides | None = None,
    model: _Model = "averaged",
    trace: bool = True,
) -> Run:
    """Runs a scenario, by its name or file, with the overrides and the seed (1) of `hil-sim run`.

    Raises ValueError for an unknown name, with the nearest one, for a name given twice, and for a value out of range.
    """

def scenarios() -> list[str]:
    """Names of the shipped scenarios."""

@final
class Hand:
    """A whole hand in simulated time: GOD, the bus and seven motor boards, powered up, at its first prompt. The same seed and
    calls give the same results. Motors are 1 to 3 (links of the fingers), 4 (spread), 5 to 7 (tips); index 0 of an array is motor 1.

    `grasp` is a file of objects between the fingers. Without `contacts` fingers meet only their stops, for a physics engine
    that computes what else they touch and applies it by `load`."""

    def __new__(
        cls,
        seed: SupportsIndex = 0,
        grasp: _Path | None = None,
        *,
        contacts: bool = True,
        model: _Model = "averaged",
    ) -> Hand: ...
    @property
    def time(self) -> float:
        """Simulated seconds since power-up."""
    def step(self, seconds: float) -> None:
        """Advances time by whole microseconds; the rest is kept for the next step."""
    def send(self, text: str) -> None:
        """Types characters, each a byte (Latin-1), without waiting."""
    def receive(self) -> str:
        """What the hand has sent since the last call and no command has returned, each byte a character (Latin-1)."""
    def command(self, text: str, limit: float = 60.0) -> list[str]:
        """Runs a line of the hand's language, once those that were sent have ended, and returns what it prints. Time advances until
        the prompt.

        Raises CallError for ERR, and CallTimeout, a TimeoutError, after `limit` simulated seconds: then the line was aborted.
        """
    def load(self, motor: SupportsIndex, torque: float) -> None:
        """Applies a torque to a motor's joint from outside, N m behind the gear, positive closing, until changed. Motors of links and
        tips have worms, through which no load drives them."""
    @property
    def positions(self) -> NDArray[np.float64]:
        """True positions of the motors' rotors, hall counts."""
    @property
    def velocities(self) -> NDArray[np.float64]:
        """True velocities of the motors' rotors, hall counts/s."""
    @property
    def torques(self) -> NDArray[np.float64]:
        """True torques of the motors on their rotors, N m."""
    @property
    def joint_positions(self) -> NDArray[np.float64]:
        """True positions of the joints behind play and twist of their gears, hall counts of the motors."""

@final
class Board:
    """One motor board with its motor, awake, in simulated time. Its host asks for MODE ten times a simulated second.

    `position` is where the motor stands, hall counts. Overrides as of `run`."""

    def __new__(
        cls,
        kind: Literal["link", "spread", "tip"] = "spread",
        properties: _Overrides | None = None,
        plant: _Overrides | None = None,
        seed: SupportsIndex | None = None,
        *,
        position: float = 0.0,
        model: _Model = "averaged",
    ) -> Board: ...
    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
    def step(self, seconds: float) -> None:
        """Advances time by whole microseconds; the rest is kept for the next step."""
    def get(self, name: str) -> int:
        """A property, over the bus, in the units of docs/properties.md."""
    def set(self, name: str, value: SupportsIndex) -> None:
        """Sets a property over the bus. Raises ValueError if the board does not take it; in its monitor (STAT 0) it
        takes STAT alone."""
    def load(self, torque: float) -> None:
        """Applies a torque to the joint from outside, N m behind the gear, positive closing, until changed."""
    @property
    def position(self) -> float:
        """True position of the rotor, hall counts."""
    @property
    def velocity(self) -> float:
        """True velocity of the rotor, hall counts/s."""
    @property
    def torque(self) -> float:
        """True torque of the motor on its rotor, N m."""
    @property
    def joint_position(self) -> float:
        """True position of the joint behind play and twist of its gear, hall counts of the motor."""
