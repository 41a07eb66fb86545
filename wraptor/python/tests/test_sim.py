"""The simulator in process."""

import collections
import json
import pickle
import subprocess
import threading
import types
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from conftest import Broken

import wraptor
from wraptor import sim

GRASPS = Path(__file__).parents[3] / "hil-sim" / "grasps"

# Friction of a motor, which a load must overcome first, N m (`hil-sim list --plant`).
FRICTION = 0.04

# Motor revolutions a revolution of the spread's joint (manual 1.3.2, table 2).
SPREAD_GEAR = 17.5


def test_run_is_that_of_the_command_line(hil_sim: str) -> None:
    run = sim.run("spread-full-travel", properties={"KP": 30}, plant={"inertia": "1.3x"}, seed=7)
    line = "run spread-full-travel --json --set KP=30 --plant inertia=1.3x --seed 7"
    found = subprocess.run([hil_sim, *line.split()], stdout=subprocess.PIPE, text=True)
    expected = json.loads(found.stdout)
    for name in ["scenario", "seed", "model", "wall_s"]:
        del expected[name]
    assert run.expectations == expected.pop("expectations")
    assert run.metrics == expected
    assert run.passed == (found.returncode == 0)


def test_trace_is_arrays_of_a_row_a_millisecond() -> None:
    run = sim.run("spread-full-travel")
    position = run.trace["position_counts"]
    assert position.dtype == np.float64 and position.shape == (1501,)
    assert np.array_equal(run.trace["time_ms"], np.arange(1501.0))
    assert position[-1] == run.metrics["position_counts"]
    assert run.traces["spread"] is run.trace
    assert sim.run("spread-full-travel", trace=False).trace == {}


def test_run_takes_a_file_and_numbers_of_numpy(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("name = 'mine'\nabout = 'mine'\nmotor = ['link', 'tip']\nduration_ms = 5\n")
    run = sim.run(file, properties={"KP": np.int64(30), "HOLD": True}, plant={"inertia": np.float32(2e-5)})
    assert run.scenario == "mine" and list(run.traces) == ["link", "tip"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"scenario": "spread-full-travl"}, "did you mean spread-full-travel"),
        ({"scenario": "spread-full-travel", "properties": {"TSTO": 30}}, "did you mean TSTOP"),
        ({"scenario": "spread-full-travel", "properties": {"KP": 30.5}}, "whole number"),
        ({"scenario": "spread-full-travel", "plant": {"inertai": "1.3x"}}, "did you mean inertia"),
        ({"scenario": "spread-full-travel", "plant": {"inertia": "1e9x"}}, "out of range"),
        ({"scenario": "spread-full-travel", "model": "ideal"}, "averaged or switched"),
        ({"scenario": "spread-full-travel", "properties": {"KP": 10**30}}, f"KP={10**30}\n  expected: KP from 0 to"),
        ({"scenario": "spread-full-travel", "properties": {"KP": -(10**30)}}, "KP from 0 to"),
        ({"scenario": "spread-full-travel", "properties": {"KP": 3, "kp": 4}}, '"KP" and "kp", expected each name once'),
        ({"scenario": "spread-full-travel", "plant": {"inertia": float("nan")}}, "plant inertia=NaN"),
        ({"scenario": "spread-full-travel", "rig": {"hall_offset_deg": "2x"}}, "rig hall_offset_deg=2x"),
        ({"scenario": "spread-full-travel", "seed": -1}, "found -1, expected a whole number from 0 to"),
        ({"scenario": "none"}, r"wraptor.sim.scenarios\(\) names"),
    ],
)
def test_unknown_name_or_value_names_the_nearest(arguments: dict[str, object], expected: str) -> None:
    with pytest.raises(ValueError, match=expected) as error:
        sim.run(**arguments)  # type: ignore[arg-type]
    # A wheel has no command line.
    assert "--" not in str(error.value) and "hil-sim" not in str(error.value)


@pytest.mark.parametrize("kind", [types.MappingProxyType, collections.ChainMap, collections.UserDict])
def test_overrides_are_any_mapping(kind: Callable[[dict[str, int]], Mapping[str, int]]) -> None:
    run = sim.run("spread-full-travel", kind({"KP": 30}), trace=False)
    assert run.metrics == sim.run("spread-full-travel", {"KP": 30}, trace=False).metrics


def test_override_that_is_no_number_names_its_key() -> None:
    with pytest.raises(TypeError, match=r"properties\['KP'\]: found None, expected a number or a text"):
        sim.run("spread-full-travel", {"KP": None})  # type: ignore[dict-item]
    with pytest.raises(TypeError, match="plant: found the name 3"):
        sim.Board(plant={3: 4})  # type: ignore[dict-item]
    with pytest.raises(ZeroDivisionError):
        sim.run("spread-full-travel", plant={"inertia": Broken()})
    with pytest.raises(TypeError, match="Mapping"):
        sim.run("spread-full-travel", [("KP", 3)])  # type: ignore[arg-type]


def test_run_is_pickled() -> None:
    run = sim.run("spread-full-travel", seed=(1 << 64) - 1)
    copy = pickle.loads(pickle.dumps(run))
    assert (copy.scenario, copy.seed, copy.passed) == (run.scenario, (1 << 64) - 1, run.passed)
    assert copy.metrics == run.metrics and copy.expectations == run.expectations
    assert np.array_equal(copy.trace["position_counts"], run.trace["position_counts"])


def test_board_moves_and_answers() -> None:
    board = sim.Board(properties={"ACCEL": 20})
    assert (board.get("ACCEL"), board.get("accel")) == (20, 20)
    board.set("M", 100)
    board.step(2.0)
    assert board.time == 2.0 and board.get("P") == 100 and abs(board.position - 100) < 1
    assert board.get("END") == 1
    with pytest.raises(ValueError, match="0 to"):
        board.set("KP", 1 << 20)
    with pytest.raises(ValueError, match="did you mean TSTOP"):
        board.get("TSTO")
    with pytest.raises(ValueError, match="beyond the stops"):
        sim.Board(position=1e4)


def test_board_names_position_property_and_range() -> None:
    for position in [float("nan"), float("inf"), 1e4]:
        with pytest.raises(ValueError, match="Board: position is out of range"):
            sim.Board(position=position)
    board = sim.Board()
    with pytest.raises(ValueError) as error:
        board.set("P", 40000)
    assert str(error.value).startswith("P: found 40000, expected -32767 to 32767\n")
    with pytest.raises(ValueError, match="found -1, expected a whole number"):
        sim.Board(seed=-1)
    with pytest.raises(ValueError, match=f"found {10**30}"):
        board.set("P", 10**30)
    with pytest.raises(ValueError, match="KP: found -1, expected 0 to"):
        board.set("KP", -1)
    with pytest.raises(ValueError, match="ERROR: found 0, expected a property that can be set"):
        board.set("ERROR", 0)


def test_board_in_its_monitor_is_named() -> None:
    board = sim.Board()
    board.set("STAT", 0)
    for name, value in [("MKA", 399), ("HALLS", 1), ("CMD", 99), ("KP", 30), ("STAT", 1)]:
        with pytest.raises(ValueError, match=f"{name}: found a board in its monitor.*\n  next: wake it by set"):
            board.set(name, value)
    with pytest.raises(ValueError, match="P: found a board in its monitor"):
        board.get("P")
    assert board.get("STAT") == 0
    board.set("STAT", 2)
    board.step(0.1)
    assert board.get("STAT") == 2 and board.get("P") == 0


@pytest.mark.parametrize("make", [sim.Board, sim.Hand])
def test_steps_add_up_to_their_sum(make: Callable[[], sim.Board | sim.Hand]) -> None:
    steps = make()
    start = steps.time
    for _ in range(240):
        steps.step(1 / 240)
    assert steps.time - start == pytest.approx(1.0, abs=1e-9)
    for _ in range(10_000):
        steps.step(4e-7)
    assert steps.time - start == pytest.approx(1.004, abs=1e-9)
    with pytest.raises(ValueError, match="found 10000000000, expected simulated seconds, 0 to 1000000000"):
        steps.step(1e10)


def test_velocity_mode_outlives_the_host_watchdog() -> None:
    board = sim.Board("link")
    board.set("V", 10)
    board.set("MODE", 4)
    board.step(4.0)
    assert board.get("MODE") == 4 and board.velocity > 5


@pytest.mark.parametrize("load", [-2.0, 2.0])
def test_load_is_of_the_joint_and_held_by_the_motor(load: float) -> None:
    board = sim.Board("spread", position=80.0)
    board.set("P", 80)
    board.set("MODE", 3)
    board.step(0.5)
    board.load(load)
    board.step(0.5)
    # The motor holds what friction does not.
    assert abs(board.torque + load / SPREAD_GEAR) < FRICTION
    board.load(0.0)
    board.step(0.5)
    assert abs(board.torque) < FRICTION
    with pytest.raises(ValueError, match="N m on the joint"):
        board.load(float("nan"))


def test_hand_obeys_its_language_in_simulated_time() -> None:
    hand = sim.Hand()
    assert hand.time < 0.1
    hand.command("HI")
    hand.command("GC")
    assert hand.positions[:3].min() > 200 and abs(hand.joint_positions[0] - hand.positions[0]) < 5
    with pytest.raises(wraptor.CallError, match="ERR") as error:
        hand.command("NONSENSE")
    assert error.value.status > 0
    with pytest.raises(wraptor.CallError, match="printable"):
        hand.command("HI\r")


def test_command_times_out_in_simulated_time_and_the_next_one_works() -> None:
    hand = sim.Hand()
    start = hand.time
    with pytest.raises(TimeoutError) as error:
        hand.command("HI", limit=0.5)
    assert error.value.cause == "TimedOut" and 0.5 <= hand.time - start < 3  # type: ignore[attr-defined]
    assert hand.command("VERS") and abs(hand.velocities).max() < 1


def test_hand_is_the_same_for_the_same_seed() -> None:
    def states(seed: int) -> np.ndarray:
        hand = sim.Hand(seed=seed)
        hand.send("HI\r")
        rows = []
        for _ in range(300):
            hand.step(0.01)
            rows.append(np.concatenate([hand.positions, hand.velocities, hand.torques]))
        return np.array(rows)

    first, again, other = states(1), states(1), states(2)
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_steps_in_lock_step_are_one_long_step() -> None:
    one, many = sim.Hand(seed=3), sim.Hand(seed=3)
    for hand in [one, many]:
        hand.send("SO\r")
    one.step(0.5)
    for _ in range(500):
        many.step(0.001)
    assert one.time == many.time and np.array_equal(one.positions, many.positions)
    assert one.receive() == many.receive()


def test_what_is_sent_is_received_and_no_reply() -> None:
    hand = sim.Hand()
    hand.send("VERS\r")
    hand.step(0.1)
    version = hand.receive()
    assert version.startswith("VERS") and version.endswith("=> ") and hand.receive() == ""
    hand.send("VERS\r")
    hand.step(0.1)
    assert hand.command("VERS") == [version.split()[1]]
    assert hand.receive() == version


def test_command_waits_for_the_end_of_what_was_sent() -> None:
    hand = sim.Hand()
    hand.command("HI")
    hand.send("GC\r")
    assert hand.command("GFGET P") == hand.command("GFGET P") and hand.receive().startswith("GC")
    hand.send("4FSET MPE 77\r4FGET MPE\r")
    position = hand.command("4FGET P")
    assert position == hand.command("4FGET P") and "77" in hand.receive()
    hand.send("NONSENSE\r")
    hand.step(0.01)
    hand.send("NONSENSE\r")
    assert hand.command("4FGET P") == position and hand.receive().count("ERR") == 2
    hand.send("HI\r")
    hand.step(0.01)
    start = hand.time
    with pytest.raises(wraptor.CallTimeout):
        hand.command("4FGET P", limit=0.1)
    assert 0.1 <= hand.time - start < 3
    hand.command("HI")
    assert hand.command("4FGET P") == ["0"]


def test_load_takes_up_the_play_of_a_worm_and_does_not_drive_it() -> None:
    hand = sim.Hand()
    hand.command("HI")
    hand.command("T")
    before, joint = hand.positions[0], hand.joint_positions[0]
    hand.load(1, 10.0)
    hand.step(0.3)
    assert abs(hand.positions[0] - before) < 0.1 and hand.joint_positions[0] > joint
    with pytest.raises(ValueError, match="1 to 7"):
        hand.load(8, 1.0)
    with pytest.raises(ValueError, match="found -1, expected 1 to 7"):
        hand.load(-1, 1.0)
    hand.load(np.int64(4), 1.0)


def test_load_is_held_by_the_motor_of_the_spread() -> None:
    def torques(load: float) -> np.ndarray:
        hand = sim.Hand()
        hand.command("HI")
        hand.load(4, load)
        hand.send("SC\r")
        hand.step(0.3)
        rows = []
        for _ in range(200):
            hand.step(0.001)
            rows.append(hand.torques[3])
        return np.array(rows)

    # On the way, at the same acceleration: 3 N m at the joint.
    assert np.mean(torques(-3.0) - torques(0.0)) == pytest.approx(3.0 / SPREAD_GEAR, rel=0.1)


def test_grasp_stops_fingers_at_the_object(tmp_path: Path) -> None:
    free, full = sim.Hand(), sim.Hand(grasp=GRASPS / "ball.toml")
    for hand in [free, full]:
        hand.command("HI")
        hand.command("GC")
    assert (full.positions[:3] < free.positions[:3] - 20).all()
    with pytest.raises(ValueError, match="cannot be read"):
        sim.Hand(grasp=tmp_path / "none.toml")


def test_gil_is_released_during_a_simulation() -> None:
    hand, begun, ended = sim.Hand(), threading.Event(), threading.Event()

    def home() -> None:
        begun.set()
        hand.command("HI")
        ended.set()

    thread = threading.Thread(target=home)
    thread.start()
    begun.wait()
    # Seconds of a hand take longer than the few instructions here.
    was_running = not ended.is_set()
    thread.join()
    assert was_running


def test_hand_may_be_called_from_any_thread() -> None:
    hand, found = sim.Hand(), []
    thread = threading.Thread(target=lambda: found.append(hand.command("VERS")))
    thread.start()
    thread.join()
    assert found == [hand.command("VERS")]
