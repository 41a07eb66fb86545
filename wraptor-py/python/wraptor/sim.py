"""The simulator in process: runs of scenarios, and a hand and a board in simulated time."""

from ._wraptor import Board, Run, SimHand as Hand, run, scenarios

__all__ = ["Board", "Hand", "Run", "run", "scenarios"]
