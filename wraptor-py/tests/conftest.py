"""A simulated hand, served by the program of the environment variable HIL_SIM (`cargo xtask wheel --check` sets it)."""

import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

HIL_SIM = os.environ.get("HIL_SIM", "hil-sim")


@dataclass
class Served:
    """A program that serves a hand."""

    process: subprocess.Popen[str]
    address: str


@pytest.fixture
def served() -> Iterator[Served]:
    process = subprocess.Popen(
        [HIL_SIM, "hand", "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    kind, address = process.stdout.readline().split()
    assert kind == "gcl"
    yield Served(process, address)
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.fixture(scope="session")
def hil_sim() -> str:
    return HIL_SIM
