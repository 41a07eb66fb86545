"""Spreads a sweep over a Ray cluster: the bytes are those of `hil-sim sweep` on one machine (docs/sweep.md).

Each task makes one shard with `hil-sim sweep --shard`, in a temporary folder that it then moves into place, so that a task that dies and
is run again meets nothing half-written. The folders are on a file system that all nodes share; on one machine any will do.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import ray


def call(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    # 1: some runs could not be made; the table says which.
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr.strip()}")
    return done.stdout


@ray.remote(num_cpus=1, max_retries=5)
def make_shard(hil_sim: str, sweep: str, number: int, of: int, shards: str) -> int:
    """Makes a shard unless it is there. Returns the number of its runs that this call made."""
    place = Path(shards) / f"{number}-of-{of}"
    if place.exists():
        return 0
    attempt = Path(tempfile.mkdtemp(prefix=f".{place.name}.", dir=shards))
    try:
        shard = ["--shard", f"{number}/{of}", "--jobs", "1", "--json"]
        made = json.loads(call([hil_sim, "sweep", sweep, "--out", str(attempt), *shard]))["made"]
        try:
            attempt.rename(place)
        except OSError:
            # Another attempt of this shard, whose worker seemed dead, was first.
            if not place.exists():
                raise
        return made
    finally:
        shutil.rmtree(attempt, ignore_errors=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sweep", type=Path, help="the sweep's TOML file")
    parser.add_argument("--out", type=Path, required=True, help="a new folder for the results")
    parser.add_argument("--workers", type=int, help="CPUs of a local Ray; default: all, or the cluster of --address")
    parser.add_argument("--address", help="an existing Ray cluster, such as auto")
    parser.add_argument("--batch", type=int, default=2000, help="runs of a task; a second or more of work")
    parser.add_argument("--hil-sim", default="hil-sim", help="the program, at this path on each node")
    args = parser.parse_args()
    if args.batch < 1 or (args.workers or 1) < 1:
        parser.error("--batch and --workers are 1 or more")
    hil_sim = shutil.which(args.hil_sim) or parser.error(f"{args.hil_sim}: no such program; give --hil-sim PATH")
    hil_sim = os.path.abspath(hil_sim)
    sweep = str(args.sweep.resolve())
    try:
        plan = json.loads(call([hil_sim, "sweep", sweep, "--dry-run", "--json"]))
    except RuntimeError as error:
        sys.exit(str(error))
    if args.out.exists() and any(args.out.iterdir()):
        sys.exit(f"{args.out}: is not empty\n  next: choose another folder")
    of = -(-plan["runs"] // args.batch)
    # Of this sweep and commit only; kept after an interruption.
    shards = args.out.resolve().with_name(f"{args.out.name}.shards-{plan['sweep']}-{plan['commit'][:12]}")
    shards.mkdir(parents=True, exist_ok=True)
    ray.init(address=args.address, num_cpus=None if args.address else args.workers, log_to_driver=False)
    waiting = [make_shard.remote(hil_sim, sweep, number, of, str(shards)) for number in range(1, of + 1)]
    made = done = 0
    try:
        while waiting:
            ready, waiting = ray.wait(waiting)
            made += sum(ray.get(ready))
            done += len(ready)
            if sys.stderr.isatty():
                print(f"\r{done} of {of} shards", end="", file=sys.stderr, flush=True)
    except (RuntimeError, ray.exceptions.RayError) as error:
        sys.exit(f"{error}\n  next: the same line again; {done} shards are kept in {shards}")
    folders = [str(shards / f"{number}-of-{of}") for number in range(1, of + 1)]
    print(call([hil_sim, "merge", *folders, "--out", str(args.out)]), end="")
    print(f"{made} runs made by {of} tasks")
    # A task whose worker died may still write there.
    shutil.rmtree(shards, ignore_errors=True)


if __name__ == "__main__":
    main()
