"""A simulated hand, served by the program of the environment variable HIL_SIM, and one of emulated boards at the address EMULATED
(`cargo xtask wheel --check` sets both)."""

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


class Broken:
    """A number that cannot be read."""

    def __float__(self) -> float:
        return 1 / 0


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


@pytest.fixture
def emulated() -> str:
    if "EMULATED" not in os.environ:
        pytest.skip("no hand of emulated boards; `cargo xtask emu --listen` serves one, EMULATED=HOST:PORT names it")
    return os.environ["EMULATED"]
