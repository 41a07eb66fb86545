"""Runs of one scenario from Python against Rust's `run_speed` of the same build: `runs.py RUN_SPEED [LEAST_SHARE]`. Counted a second of
processor time, which other programs do not take, and measured in turns; the median of the pairs counts. Then two threads against one, a
second of wall time."""

import os
import resource
import statistics
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

from wraptor import sim

SCENARIO = "spread-full-travel"
RUNS = 100
PAIRS = 7


def rust(program: str) -> float:
    """Runs a second of processor time in Rust, without traces."""

    def spent() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    start = spent()
    subprocess.run([program, SCENARIO, str(RUNS)], check=True, stdout=subprocess.DEVNULL)
    return RUNS / (spent() - start)


def simulate(trace: bool = False) -> None:
    for seed in range(RUNS):
        run = sim.run(SCENARIO, seed=seed, trace=trace)
        assert run.metrics["ends"] == 1
        if trace:
            assert len(run.trace["position_counts"]) == 1501


def python(trace: bool) -> float:
    """The same from Python."""
    start = time.process_time()
    simulate(trace)
    return RUNS / (time.process_time() - start)


def threaded(threads: int) -> float:
    """Runs a second of wall time on some threads."""
    start = time.perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda _: simulate(), range(threads)))
    return threads * RUNS / (time.perf_counter() - start)


def main() -> None:
    program = sys.argv[1]
    least = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    rows = [(rust(program), python(False), python(True), threaded(1), threaded(2)) for _ in range(PAIRS)]
    runs = [statistics.median(column) for column in zip(*rows)]
    shares = [statistics.median(row[column] / row[0] for row in rows) for column in (1, 2)]
    print(f"Rust {runs[0]:.0f} runs/s; Python {runs[1]:.0f}, {shares[0]:.2f} x Rust; with traces as arrays {runs[2]:.0f}, {shares[1]:.2f} x")
    scaling = statistics.median(row[4] / row[3] for row in rows)
    print(f"two threads {scaling:.2f} x one, on {os.cpu_count()} processors")
    if shares[0] < least:
        sys.exit(f"found {shares[0]:.2f} x Rust, expected {least} at least\n  next: `cargo xtask bench` tells whether Rust has become faster")


if __name__ == "__main__":
    main()
