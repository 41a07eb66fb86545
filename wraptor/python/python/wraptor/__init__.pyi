"""Host library and simulator of a robot hand (docs/python.md)."""

from collections.abc import Callable, Sequence
from os import PathLike
from types import TracebackType
from typing import Literal, SupportsIndex, TypeAlias, final

from . import sim as sim
from ._errors import (
    CallError as CallError,
    CallTimeout as CallTimeout,
    ConnectError as ConnectError,
    InvalidArgument as InvalidArgument,
)

__all__ = [
    "Bus",
    "CallError",
    "CallTimeout",
    "ConnectError",
    "Feedback",
    "Hand",
    "InvalidArgument",
    "RealTime",
    "Statistics",
    "__version__",
    "discover",
    "sim",
]

__version__: str

# Seconds since the call, and values by node, where the call polls them. The call is cancelled if it returns False itself.
_Progress: TypeAlias = Callable[[float, dict[int, int]], bool | None] | None
# Seconds since the call, node, percent sent.
_Download: TypeAlias = Callable[[float, int, int], bool | None] | None
_State: TypeAlias = Literal["silent", "asleep", "unusable", "ready"]
# A velocity in hall counts/s, positive closing, or a velocity and a gain.
_Control: TypeAlias = float | tuple[float, SupportsIndex]
_Path: TypeAlias = str | bytes | PathLike[str] | PathLike[bytes]

@final
class Hand:
    """A hand, as its one host: through its GOD, or by CAN without one. Limits are in seconds. Motors are a prefix of the hand's language ("13", "G", "S",
    "X15", or empty for all with EN), nodes digits ("567")."""

    @classmethod
    def connect(
        cls, address: str, limit: float = 5.0, boards: Literal["wake", "ready", "any"] = "wake"
    ) -> Hand:
        """Connects over TCP to HOST:PORT. Raises ConnectError."""
    @classmethod
    def serial(
        cls, path: str, baud: SupportsIndex = 9600, limit: float = 10.0, boards: Literal["wake", "ready", "any"] = "wake"
    ) -> Hand:
        """Connects over a serial port such as /dev/ttyUSB0. Raises ConnectError."""
    @classmethod
    def can(
        cls, place: str, limit: float = 5.0, boards: Literal["wake", "ready", "any"] = "wake"
    ) -> Hand:
        """Connects by CAN, without GOD: this program interprets the hand's language itself. `place` is a CAN interface such as can0, or an SLCAN
        adapter: HOST:PORT, /dev/ttyACM0, or /dev/ttyUSB0@57600 with its baud rate. Raises ConnectError."""
    @property
    def address(self) -> str:
        """Where it is connected, as it was given."""
    @property
    def version(self) -> int:
        """The firmware's version."""
    def disconnect(self) -> None:
        """Closes the connection, once a call of another thread has ended; `cancel` ends that. RealTime is ended. Motors stop."""
    def __enter__(self) -> Hand: ...
    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None, /
    ) -> None: ...
    def cancel(self) -> None:
        """Aborts a call of another thread, which raises CallError."""
    def command(self, line: str, limit: float = 30.0, progress: _Progress = None) -> list[str]:
        """Runs a line of the hand's language and returns what it prints."""
    def command_and_wait(self, line: str, limit: float = 30.0, progress: _Progress = None) -> list[str]:
        """The same, and waits until moves are over that the line begins by MODE 5 or CMD (the manual's command)."""
    def write(self, data: bytes | bytearray | memoryview, limit: float = 1.0) -> None:
        """Writes bytes as they are, without waiting for an answer."""
    def take_reports(self, limit: float = 1.0) -> list[str]:
        """Lines that the hand has printed unasked."""
    def wake(self, limit: float = 3.0) -> None:
        """Wakes all motor boards."""
    def boards(self, limit: float = 1.0) -> list[_State]:
        """The states of motor boards 1 to 7."""
    def faults(self, limit: float = 1.0) -> dict[int, str]:
        """Latched faults by node."""
    def init(self, limit: float = 60.0, progress: _Progress = None) -> None:
        """Finds the stops of all motors and goes to 0 (HI)."""
    def find_zero(self, motors: str = "", limit: float = 60.0, progress: _Progress = None) -> None:
        """Finds the stops of motors and moves them to 0, links last (the manual's findZero)."""
    def close(self, motors: str = "", limit: float = 20.0, progress: _Progress = None) -> None:
        """Closes motors (C)."""
    def open(self, motors: str = "", limit: float = 20.0, progress: _Progress = None) -> None:
        """Opens motors (O)."""
    def grasp(self, motors: str = "", limit: float = 20.0, progress: _Progress = None) -> None:
        """Closes motors with limited torque until they stall, and leaves them pressing (TC)."""
    def relax(self, motors: str = "", limit: float = 2.0) -> None:
        """Switches motors' power off (T)."""
    def move(self, motors: str, counts: SupportsIndex, limit: float = 20.0, progress: _Progress = None) -> None:
        """Moves motors to a position of the language, GCL counts, 0 to 20000 (M)."""
    def move_halls(self, fingers: str, halls: SupportsIndex, limit: float = 20.0, progress: _Progress = None) -> None:
        """Moves fingers to a position of their links in hall counts, and their tips by a third of the joint angle."""
    def open_fingers(self, fingers: str, limit: float = 20.0, progress: _Progress = None) -> None:
        """Moves fingers and their tips to 0 (the manual's open)."""
    def close_fingers(self, fingers: str, limit: float = 20.0, progress: _Progress = None) -> None:
        """Moves fingers and their tips to the defaults of CT, or until an object stops them (the manual's close)."""
    def get(self, nodes: str, name: str, limit: float = 1.0) -> dict[int, int]:
        """A property of boards by node, in the units of docs/properties.md. Raises ValueError for an unknown name."""
    def set(self, nodes: str, name: str, value: SupportsIndex, limit: float = 1.0) -> None:
        """Sets a property of boards."""
    def wait_for(
        self, nodes: str, name: str, value: SupportsIndex, limit: float = 20.0, progress: _Progress = None
    ) -> None:
        """Polls a property until all boards have a value."""
    def parameter(self, motors: str, name: str, limit: float = 1.0) -> list[int]:
        """A parameter of motors (FGET)."""
    def set_parameter(self, motors: str, name: str, value: SupportsIndex, limit: float = 1.0) -> None:
        """Sets a parameter of motors (FSET)."""
    def hand_parameter(self, name: str, limit: float = 1.0) -> int:
        """A parameter of the hand (PGET)."""
    def set_hand_parameter(self, name: str, value: SupportsIndex, limit: float = 1.0) -> None:
        """Sets a parameter of the hand (PSET)."""
    def temperature(self, limit: float = 1.0) -> float:
        """Temperature of GOD's board, degrees Celsius; by CAN there is none."""
    def save_parameters(self, limit: float = 5.0) -> None:
        """Stores parameters of motors and of the hand."""
    def save_nodes(self, nodes: str, limit: float = 5.0) -> None:
        """Stores positions and parameters of boards, and with node 0 those of GOD (the manual's saveParameters)."""
    def prepare_power_off(self, limit: float = 5.0) -> None:
        """Switches motors off and stores positions and parameters (SAVE)."""
    def download(
        self, nodes: str, path: _Path, limit: float = 120.0, progress: _Download = None
    ) -> None:
        """Downloads a .tek file to boards; connect with boards="any". Raises OSError if it cannot be read, ValueError if it is none."""
    def realtime(
        self,
        motors: str,
        limit: float = 2.0,
        *,
        velocity: SupportsIndex = 8,
        gain: bool = False,
        feeds_velocity: SupportsIndex | None = None,
        feeds_strain: bool = False,
        feeds_position: bool = True,
        feeds_change: SupportsIndex | None = None,
        feeds_temperature: bool = False,
    ) -> RealTime:
        """Begins RealTime of motors (LOOP). `velocity` (0: none), `feeds_velocity` and `feeds_change` are units of a byte, hall counts/s
        and GCL counts. Until its end no other call of the hand is possible."""

@final
class RealTime:
    """RealTime control; motors stop when the host is silent for 250 ms. Use it in `with`."""

    @property
    def axes(self) -> int:
        """Number of motors in each block."""
    def exchange(self, controls: Sequence[_Control], limit: float = 1.0) -> Feedback:
        """Sends a control block, one control for each motor, and waits for its feedback. Velocities are rounded to the unit of the
        format and clipped to a byte; a gain counts with gain=True alone."""
    def run(
        self,
        rate: float,
        control: Callable[[int, Feedback], Sequence[_Control] | None],
        limit: float = 1.0,
    ) -> Statistics:
        """Exchanges `rate` blocks a second, 1 to 1000, until `control` returns None. It gets the number of the block and the last feedback.
        Each block has the limit to itself."""
    def end(self, limit: float = 2.0) -> None:
        """Ends RealTime, and a run of another thread with its next block; the hand takes calls again."""
    def __enter__(self) -> RealTime: ...
    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None, /
    ) -> None: ...

@final
class Feedback:
    """A feedback block, each motor in the order of the prefix; None for what the format lacks, and before the first block."""

    @property
    def positions(self) -> list[int] | None:
        """GCL counts."""
    @property
    def velocities(self) -> list[int] | None:
        """Hall counts/s."""
    @property
    def strains(self) -> list[int] | None:
        """0 to 255."""
    @property
    def changes(self) -> list[int] | None:
        """Since the last report, GCL counts."""
    @property
    def temperature(self) -> float | None:
        """Of GOD's board, degrees Celsius."""

@final
class Statistics:
    """How regular a run at a fixed rate was; times in seconds."""

    @property
    def blocks(self) -> int:
        """Number of blocks."""
    @property
    def elapsed(self) -> float:
        """From the first block to the last answer."""
    @property
    def rate(self) -> float:
        """Blocks a second."""
    @property
    def missed(self) -> int:
        """Places of the schedule that were left out."""
    @property
    def jitter(self) -> tuple[float, float, float]:
        """How late blocks were sent: median, 99th percentile, maximum."""
    @property
    def round_trip(self) -> tuple[float, float, float]:
        """From a block to its answer: median, 99th percentile, maximum."""

@final
class Bus:
    """Motor boards on their bus, this program its one host. Limits are in seconds."""

    @classmethod
    def slcan(cls, address: str, limit: float = 5.0) -> Bus:
        """Connects to an SLCAN adapter over TCP, HOST:PORT. Raises ConnectError."""
    @classmethod
    def slcan_serial(cls, path: str, baud: SupportsIndex = 115200, limit: float = 5.0) -> Bus:
        """The same on a serial port."""
    @classmethod
    def can(cls, interface: str) -> Bus:
        """Opens a CAN interface of Linux, such as can0, which is up at 1 Mbit/s."""
    @classmethod
    def through(cls, hand: Hand, limit: float = 2.0) -> Bus:
        """Speaks to a hand's boards by packets; the hand takes no other calls afterwards."""
    def disconnect(self) -> None:
        """Closes the connection, once a call of another thread has ended."""
    def __enter__(self) -> Bus: ...
    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None, /
    ) -> None: ...
    def send(self, id: SupportsIndex, data: bytes | bytearray | memoryview, limit: float = 1.0) -> None:
        """Sends a frame (docs/wire.md)."""
    def receive(self, limit: float = 1.0) -> tuple[int, bytes] | None:
        """The next frame's id and data; None if none comes within the limit."""
    def get(self, node: SupportsIndex, name: str, limit: float = 1.0) -> int:
        """A property of a board. Raises ValueError for an unknown name."""
    def set(self, node: SupportsIndex, name: str, value: SupportsIndex, limit: float = 1.0) -> None:
        """Sets a property of a board and reads it back."""
    def state(self, node: SupportsIndex, limit: float = 1.0) -> _State:
        """The state of a board."""
    def require(self, nodes: Sequence[SupportsIndex], limit: float = 0.2) -> None:
        """Requires boards that answer and are awake, each within the limit. Raises ConnectError."""
    def wake(self, nodes: Sequence[SupportsIndex], limit: float = 3.0) -> None:
        """Wakes boards."""
    def move(self, node: SupportsIndex, halls: SupportsIndex, limit: float = 20.0, progress: _Progress = None) -> None:
        """Moves a motor to a hall count and waits for the end."""
    def find_zero(self, node: SupportsIndex, limit: float = 20.0, progress: _Progress = None) -> None:
        """Finds a motor's stop and waits for the end."""
    def fault(self, node: SupportsIndex, limit: float = 1.0) -> str | None:
        """The latched fault of a board."""
    def stop_all(self, limit: float = 1.0) -> None:
        """Stops every motor."""
    def download(
        self, node: SupportsIndex, path: _Path, limit: float = 60.0, progress: _Download = None
    ) -> None:
        """Downloads a .tek file to a board. Raises OSError if it cannot be read, ValueError if it is none."""

def discover(limit: float = 1.0, to: Sequence[str] | None = None) -> list[tuple[str, str | None]]:
    """Hands in the network that answer within `limit`: address, and hardware address if they tell. `to` are broadcast addresses."""
