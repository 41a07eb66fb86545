"""The client against a hand in real time. Limits are checked against the clock, with a second for a busy machine."""

import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Broken, Served

import wraptor

# Seconds that a busy machine may add to a limit.
SLACK = 1.0


def refused(cause: str | tuple[str, ...], call: Callable[[], Any], limit: float) -> wraptor.CallError:
    """The CallError of a call, which ends within its limit."""
    start = time.monotonic()
    with pytest.raises(wraptor.CallError) as raised:
        call()
    assert time.monotonic() - start < limit + SLACK
    assert raised.value.cause in cause and raised.value.next_step, raised.value
    return raised.value


def test_hand_is_homed_moved_and_read(served: Served) -> None:
    seen: list[float] = []
    with wraptor.Hand.connect(served.address, limit=10) as hand:
        assert hand.boards() == ["ready"] * 7
        hand.init(limit=60, progress=lambda elapsed, values: seen.append(elapsed))
        hand.close("4", limit=20)
        assert hand.get("4", "P")[4] > 100
        hand.set("4", "KP", 40)
        assert hand.get("4", "kp") == {4: 40}
        assert hand.command("VERS") == [str(hand.version)]
        assert hand.faults() == {}
    assert seen == sorted(seen) and len(seen) > 1
    with pytest.raises(RuntimeError, match="closed"):
        hand.wake()


@pytest.mark.parametrize(
    ("door", "args"),
    [
        ("gcl", ["hand", "--listen", "127.0.0.1:0"]),
        ("pty", ["hand", "--pty"]),
        ("slcan", ["bus", "--nodes", "1-7", "--slcan", "127.0.0.1:0"]),
    ],
)
def test_functions_of_the_manual_on_every_way(hil_sim: str, door: str, args: list[str]) -> None:
    with subprocess.Popen(
        [hil_sim, *args], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout is not None
        kind, place = process.stdout.readline().split()
        assert kind == door
        if door == "gcl":
            hand = wraptor.Hand.connect(place, limit=10, boards="any")
        elif door == "pty":
            hand = wraptor.Hand.serial(place, limit=10, boards="any")
        else:
            hand = wraptor.Hand.can(place, limit=10, boards="any")
        with hand:
            hand.wake()
            assert hand.boards() == ["ready"] * 7
            hand.find_zero()
            hand.move_halls("1", 100)
            hand.close_fingers("4")
            hand.open_fingers("1")
            hand.command_and_wait("4 S E 82")
            hand.command_and_wait("4 S M 5")
            positions = hand.get("145", "P")
            assert all(abs(positions[node] - goal) <= 4 for node, goal in ((1, 0), (4, 82), (5, 0))), positions
            hand.set("7", "MT", 550)
            hand.wait_for("7", "MT", 550)
            hand.save_nodes("7")
            hand.write(b"1 G AP")
            assert hand.command("VERS") == [str(hand.version)]
            assert any(line.startswith("1 P=") for line in hand.take_reports())
            if door == "slcan":
                with pytest.raises(ValueError, match="by CAN there is no GOD"):
                    hand.temperature()
            process.kill()
            refused("Lost", lambda: hand.get("4", "P", limit=0.5), 0.5)


def test_hand_of_emulated_boards_is_homed_moved_and_driven(emulated: str) -> None:
    with wraptor.Hand.connect(emulated, limit=60) as hand:
        hand.init(limit=120)
        hand.move_halls("4", 60, limit=60)
        assert abs(hand.get("4", "P", limit=10)[4] - 60) <= 1
        with hand.realtime("S", limit=10) as realtime:
            assert realtime.run(100, lambda block, feedback: [40] if block < 50 else None).blocks == 50
        assert hand.faults(limit=10) == {}


@pytest.mark.parametrize(
    "call",
    [
        lambda hand, kill: hand.init(limit=2, progress=kill),
        lambda hand, kill: hand.command("HI", limit=2, progress=kill),
        lambda hand, kill: hand.wait_for("4", "MODE", 5, limit=2, progress=kill),
    ],
)
def test_killed_hand_raises_within_the_limit(
    served: Served, call: Callable[[wraptor.Hand, Callable[..., None]], None]
) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    refused(("Lost", "TimedOut"), lambda: call(hand, lambda *_: served.process.kill()), 2)
    refused(("Lost", "TimedOut"), lambda: hand.get("4", "P", limit=0.5), 0.5)
    refused("Lost", hand.take_reports, 1)


def test_killed_hand_ends_realtime_within_the_limit(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.init()
    realtime = hand.realtime("G")
    assert realtime.axes == 3

    def control(number: int, feedback: wraptor.Feedback) -> list[float]:
        if number == 20:
            served.process.kill()
        return [40.0] * 3

    refused(("Lost", "TimedOut"), lambda: realtime.run(100, control, limit=0.5), 0.5 + 20 / 100)
    with pytest.raises(RuntimeError, match="RealTime has ended"):
        realtime.exchange([0, 0, 0], limit=0.5)


def test_stopped_hand_times_out(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    os.kill(served.process.pid, signal.SIGSTOP)
    error = refused("TimedOut", lambda: hand.get("4", "P", limit=0.3), 0.3)
    assert isinstance(error, TimeoutError)


def test_realtime_runs_at_a_rate_and_gives_the_hand_back(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    with pytest.raises(wraptor.CallError) as not_yet:
        hand.realtime("G")
    assert not_yet.value.next_step == "call init (HI)"
    hand.init()
    positions: list[int] = []

    def control(number: int, feedback: wraptor.Feedback) -> list[tuple[float, int]] | None:
        if feedback.positions is not None:
            positions.append(feedback.positions[0])
        return [(40.0, 32)] * 3 if number < 50 else None

    with hand.realtime("G", gain=True) as realtime:
        statistics = realtime.run(100, control)
        with pytest.raises(RuntimeError, match="RealTime"):
            hand.get("1", "P")
    assert statistics.blocks == 50 and len(positions) == 50
    assert positions[-1] > positions[0]
    assert hand.get("1", "MODE").keys() == {1}
    with pytest.raises(RuntimeError, match="ended"):
        realtime.exchange([0, 0, 0])


def test_exception_in_control_ends_realtime(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.init()

    def control(number: int, feedback: wraptor.Feedback) -> list[float]:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"), hand.realtime("4") as realtime:
        realtime.run(100, control)
    assert hand.get("4", "P").keys() == {4}


def test_callback_and_signal_end_a_motion(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    error = refused("Cancelled", lambda: hand.init(limit=30, progress=lambda *_: False), 5)
    assert "cancelled" in str(error)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    previous = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        start = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            hand.init(limit=30)
        assert time.monotonic() - start < 5
    finally:
        signal.signal(signal.SIGALRM, previous)
    assert hand.command("VERS")


def test_callback_that_calls_its_hand_raises_at_once(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)

    def reads(elapsed: float, values: dict[int, int]) -> None:
        hand.get("4", "P", limit=60)

    with pytest.raises(RuntimeError, match="whose callback this is"):
        hand.init(limit=60, progress=reads)
    with pytest.raises(RuntimeError, match="whose callback this is"):
        hand.init(limit=60, progress=lambda *_: hand.disconnect())
    hand.init(limit=60)
    realtime: wraptor.RealTime
    for call in (lambda: realtime.exchange([0, 0, 0]), lambda: realtime.end()):

        def control(number: int, feedback: wraptor.Feedback, call: Callable[[], object] = call) -> None:
            call()

        with pytest.raises(RuntimeError, match="whose callback this is"), hand.realtime("G") as realtime:
            realtime.run(100, control)
    assert hand.get("4", "P").keys() == {4}


def test_calls_of_other_threads_wait_within_their_limits(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.init(limit=60)
    moving = threading.Event()
    motion = threading.Thread(target=lambda: hand.init(limit=60, progress=lambda *_: moving.set()))
    motion.start()
    moving.wait(10)
    error = refused("TimedOut", lambda: hand.get("4", "P", limit=0.2), 0.2)
    assert "another thread" in str(error) and isinstance(error, TimeoutError)
    assert hand.get("4", "P", limit=60) == {4: 0}
    motion.join()

    realtime = hand.realtime("G")
    controlling = threading.Event()

    def control(number: int, feedback: wraptor.Feedback) -> list[float]:
        controlling.set()
        return [0.0] * 3

    run = threading.Thread(target=lambda: realtime.run(100, control))
    run.start()
    controlling.wait(10)
    assert "another thread" in str(refused("TimedOut", lambda: realtime.exchange([0, 0, 0], limit=0.2), 0.2))
    hand.disconnect()
    realtime.end()
    run.join()
    with pytest.raises(RuntimeError, match="closed"):
        hand.get("4", "P")


def test_forked_child_leaves_the_connection_to_its_parent(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    child = os.fork()
    if child == 0:
        code = 1
        try:
            hand.get("4", "P", limit=10)
        except RuntimeError:
            hand.disconnect()
            del hand
            code = 0
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert hand.get("4", "P", limit=10).keys() == {4}


def test_disconnect_ends_realtime(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.init(limit=60)
    realtime = hand.realtime("G")
    controlling = threading.Event()
    ended: list[BaseException] = []

    def control(number: int, feedback: wraptor.Feedback) -> list[float]:
        controlling.set()
        return [40.0] * 3

    def run() -> None:
        try:
            realtime.run(100, control)
        except (RuntimeError, wraptor.CallError) as error:
            ended.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    assert controlling.wait(10)
    hand.disconnect()
    thread.join(10)
    assert not thread.is_alive()
    with pytest.raises(RuntimeError, match="RealTime has ended"):
        realtime.exchange([0, 0, 0])
    with wraptor.Hand.connect(served.address, limit=10) as other:
        assert set(other.get("123", "MODE").values()) <= {0, 3}


def interrupted(call: Callable[[], Any]) -> float:
    """Seconds from ^C to the end of a call, which raises KeyboardInterrupt."""
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    previous = signal.signal(signal.SIGALRM, signal.default_int_handler)
    start = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
    finally:
        signal.signal(signal.SIGALRM, previous)
    return time.monotonic() - start - 0.3


def test_signal_ends_a_motion_of_a_silent_hand_soon(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.init(limit=60)
    realtime = hand.realtime("G")
    os.kill(served.process.pid, signal.SIGSTOP)
    assert interrupted(lambda: realtime.run(100, lambda number, feedback: [0.0] * 3, limit=30)) < 1 + SLACK
    os.kill(served.process.pid, signal.SIGCONT)
    realtime.end(limit=40)
    os.kill(served.process.pid, signal.SIGSTOP)
    for call in [
        lambda: hand.init(limit=30),
        lambda: hand.move_halls("1", 50, limit=30),
        lambda: hand.wait_for("1", "P", 5, limit=30),
    ]:
        # The next call finds the prompt of the last one first.
        os.kill(served.process.pid, signal.SIGCONT)
        assert hand.get("4", "P", limit=20).keys() == {4}
        os.kill(served.process.pid, signal.SIGSTOP)
        assert interrupted(call) < 1 + SLACK


def test_motion_of_a_bus_is_interrupted_or_times_out(served: Served) -> None:
    bus = wraptor.Bus.through(wraptor.Hand.connect(served.address, limit=10))
    bus.find_zero(4, limit=20)
    bus.set(4, "MV", 30)
    error = refused("TimedOut", lambda: bus.move(4, 150, limit=0.5), 0.5)
    assert isinstance(error, TimeoutError) and "500ms" in str(error)
    os.kill(served.process.pid, signal.SIGSTOP)
    assert interrupted(lambda: bus.move(4, 100, limit=30)) < 1 + SLACK


def test_only_false_cancels(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.wait_for("4", "STAT", 2, limit=10, progress=lambda *_: 0)  # type: ignore[arg-type]
    for false in [False, np.False_]:
        refused("Cancelled", lambda false=false: hand.init(limit=30, progress=lambda *_: false), 5)  # type: ignore[misc]


def test_failed_connection_names_cause_and_next_step() -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        address = "{}:{}".format(*closed.getsockname())
        with pytest.raises(wraptor.ConnectError) as nothing:
            wraptor.Hand.connect(address, limit=2)
    assert nothing.value.cause == "NothingListens" and nothing.value.place == address
    assert "start the hand" in nothing.value.next_step and "start the hand" in str(nothing.value)
    assert isinstance(nothing.value, ConnectionError)


def test_wrong_arguments_are_refused(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    with pytest.raises(ValueError, match="did you mean TSTOP"):
        hand.get("4", "TSTO")
    with pytest.raises(ValueError, match="seconds above 0"):
        hand.get("4", "P", limit=0)
    refused("Invalid", lambda: hand.get("9", "P"), 1)
    assert refused("Status", lambda: hand.command("NONSENSE"), 1).status != 0


def test_wrong_argument_is_a_value_error_that_names_value_and_range(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    error = refused("Invalid", lambda: hand.set("4", "KP", -1), 1)
    assert isinstance(error, wraptor.InvalidArgument) and isinstance(error, ValueError)
    assert isinstance(refused("Invalid", lambda: hand.parameter("4", "NONE"), 1), ValueError)
    calls: list[tuple[Callable[[], object], str]] = [
        (lambda: hand.set("4", "KP", 10**30), f"found {10**30}, expected a whole number from -"),
        (lambda: hand.realtime("G", velocity=256), "found 256, expected a whole number from 0 to 255"),
        (lambda: hand.realtime("G", feeds_change=-1), "found -1, expected a whole number from 0 to 255"),
        (lambda: wraptor.Hand.serial("/dev/null", baud=1 << 32), "from 0 to 4294967295"),
        (lambda: hand.get("4", "P", limit=float("inf")), "found inf, expected seconds above 0, at most 1000000000"),
        (lambda: wraptor.discover(to=[]), r"to: found \[\], expected an IPv4 address"),
    ]
    for call, expected in calls:
        with pytest.raises(ValueError, match=expected):
            call()
    bus = wraptor.Bus.through(hand)
    for node in [32, 256, -1, 10**30]:
        with pytest.raises(ValueError, match="0 to 31|whole number"):
            bus.get(node, "P")
    with pytest.raises(ValueError, match="found 65536"):
        bus.send(1 << 16, b"")


def test_numbers_of_numpy_paths_and_bytes_of_any_kind_are_taken(served: Served, tmp_path: Path) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.set("4", "KP", np.int64(41))
    assert hand.get("4", "KP") == {4: 41}
    written: list[bytes | bytearray | memoryview] = [b"\r", bytearray(b"\r"), memoryview(b"\r.")[::2]]
    for data in written:
        hand.write(data)
    for wrong in [5, [13], "\r"]:
        with pytest.raises(TypeError, match="expected bytes, a bytearray or a memoryview"):
            hand.write(wrong)  # type: ignore[arg-type]
    file = tmp_path / "none.tek"
    paths: list[str | bytes | Path] = [file, str(file), bytes(file)]
    for path in paths:
        with pytest.raises(FileNotFoundError, match="none.tek: cannot be read: .*\n  next: check that it is"):
            hand.download("4", path)
    with pytest.raises(TypeError, match="expected str, bytes or os.PathLike"):
        hand.download("4", 5)  # type: ignore[arg-type]


def test_download_refuses_what_is_no_firmware(served: Served, tmp_path: Path) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    fifo, large = tmp_path / "fifo", tmp_path / "large.tek"
    os.mkfifo(fifo)
    for path in [fifo, tmp_path, Path("/dev/null")]:
        with pytest.raises(OSError, match=f"{path}: cannot be read: .*expected a file\n  next: "):
            hand.download("4", path)
    with large.open("wb") as file:
        file.truncate((4 << 20) + 1)
    with pytest.raises(ValueError, match="large.tek: cannot be read: found more than 4 MiB"):
        hand.download("4", large)
    (tmp_path / "text.tek").write_text("no firmware")
    with pytest.raises(ValueError, match="text.tek:"):
        wraptor.Bus.through(hand).download(4, tmp_path / "text.tek")


def test_realtime_refuses_what_is_no_velocity(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.init(limit=60)
    with hand.realtime("G", gain=True) as realtime:
        for wrong in [float("nan"), float("inf"), float("-inf")]:
            with pytest.raises(ValueError, match="velocity: found (NaN|inf|-inf), expected hall counts/s"):
                realtime.exchange([0, 0, wrong])
            with pytest.raises(ValueError, match="velocity: found"):
                realtime.run(100, lambda number, feedback: [(wrong, 1)] * 3)
        with pytest.raises(TypeError, match=r"controls\[1\]: found None, expected a velocity, or a tuple"):
            realtime.exchange([0, None, 0])  # type: ignore[list-item]
        with pytest.raises(ValueError, match="found 256, expected a whole number from 0 to 255"):
            realtime.exchange([(0, 256)] * 3)
        with pytest.raises(ZeroDivisionError):
            realtime.exchange([Broken()] * 3)  # type: ignore[list-item]
        with pytest.raises(TypeError, match="found 3, expected a function"):
            realtime.run(100, 3)  # type: ignore[arg-type]
        assert realtime.exchange(np.zeros(3)).positions is not None  # type: ignore[arg-type]


def test_only_false_itself_cancels_and_a_callback_must_be_a_function(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    hand.init(limit=60, progress=lambda *_: 0)  # type: ignore[arg-type]
    hand.close("4", progress=lambda *_: [])  # type: ignore[arg-type]
    before = hand.get("4", "P")
    with pytest.raises(TypeError, match="found 3, expected a function"):
        hand.open("4", progress=3)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="found 3, expected a function"):
        hand.download("4", "none.tek", progress=3)  # type: ignore[arg-type]
    assert hand.get("4", "P") == before


def test_repr_of_a_hand_has_address_and_state(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    assert repr(hand) == f"<Hand at {served.address}: connected>"
    states = []
    hand.init(limit=60, progress=lambda *_: states.append(repr(hand)))
    assert states[0] == f"<Hand at {served.address}: in a call>"
    with hand.realtime("G"):
        assert repr(hand).endswith(": in RealTime>")
    hand.disconnect()
    assert repr(hand).endswith(": closed>")


def test_bus_through_a_hand(served: Served) -> None:
    hand = wraptor.Hand.connect(served.address, limit=10)
    bus = wraptor.Bus.through(hand)
    bus.require([1, 4, 7])
    bus.find_zero(4, limit=20)
    seen: list[dict[int, int]] = []
    bus.move(4, 60, limit=10, progress=lambda elapsed, values: seen.append(values))
    assert abs(bus.get(4, "P") - 60) <= 1 and seen[-1].keys() == {4}
    with pytest.raises(RuntimeError, match="closed"):
        hand.wake()
    with bus:
        assert bus.state(4) == "ready"
    with pytest.raises(RuntimeError, match="closed"):
        bus.state(4)
