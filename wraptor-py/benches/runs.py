"""Runs a second of one scenario from Python against Rust's `run_speed` of the same build: `runs.py RUN_SPEED [LEAST_SHARE]`. Measured in
turns, so that both see the same load of the machine; the median of the pairs counts. Then with two threads, where two processors are."""

import os
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
    """Runs a second of Rust, without a trace."""
    line = subprocess.run([program, SCENARIO, str(RUNS)], check=True, stdout=subprocess.PIPE, text=True).stdout
    return float(line.split(": ")[1].split()[0])


def simulate(seeds: range, trace: bool) -> None:
    for seed in seeds:
        run = sim.run(SCENARIO, seed=seed, trace=trace)
        assert run.metrics["ends"] == 1
        if trace:
            assert len(run.trace["position_counts"]) == 1501


def python(trace: bool, threads: int = 1) -> float:
    """The same from Python."""
    start = time.perf_counter()
    if threads == 1:
        simulate(range(RUNS), trace)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda _: simulate(range(RUNS), trace), range(threads)))
    return threads * RUNS / (time.perf_counter() - start)


def main() -> None:
    program = sys.argv[1]
    least = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    rows = [(rust(program), python(False), python(True), python(False, 2)) for _ in range(PAIRS)]
    runs = [statistics.median(column) for column in zip(*rows)]
    shares = [statistics.median(row[column] / row[0] for row in rows) for column in (1, 2)]
    scaling = statistics.median(row[3] / row[1] for row in rows)
    print(f"Rust {runs[0]:.0f} runs/s; Python {runs[1]:.0f}, {shares[0]:.2f} x Rust; with traces as arrays {runs[2]:.0f}, {shares[1]:.2f} x")
    print(f"two threads {runs[3]:.0f} runs/s, {scaling:.2f} x one, on {os.cpu_count()} processors")
    if shares[0] < least:
        sys.exit(f"found {shares[0]:.2f} x Rust, expected {least} at least\n  next: `cargo xtask bench` tells whether Rust has become faster")


if __name__ == "__main__":
    main()
