"""The simulator in process: runs of scenarios, and a hand and a board in simulated time."""

from . import _wraptor

Board = _wraptor.sim.Board
Hand = _wraptor.sim.Hand
Run = _wraptor.sim.Run
run = _wraptor.sim.run
scenarios = _wraptor.sim.scenarios

__all__ = ["Board", "Hand", "Run", "run", "scenarios"]
