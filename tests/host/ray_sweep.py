"""A sweep under Ray with one, two and three workers, and with a worker that is killed: the bytes are those of one machine.

Usage: ray_sweep.py HIL_SIM
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "hil-sim/python/ray_sweep.py"

SWEEP = """
scenario = "tip-fast"
samples = 200
[grid]
set.KP = [100, 140]
[latin]
plant.inertia = { from = "0.7x", to = "1.4x" }
"""

# A run under Ray takes some seconds to start; a machine that is busy, many.
MOST_S = 240


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def workers_of(parent: int) -> list[int]:
    """The processes below `parent` that make a shard now."""
    parents, names = {}, {}
    for entry in Path("/proc").iterdir():
        try:
            # The parent is the second field behind the name, which may have spaces.
            parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            names[int(entry.name)] = (entry / "cmdline").read_bytes()
        except (ValueError, OSError):
            continue

    def below(pid: int) -> bool:
        while pid > 1:
            if pid == parent:
                return True
            pid = parents.get(pid, 0)
        return False

    return [pid for pid, name in names.items() if name.startswith(b"ray::make_shard") and below(pid)]


def main() -> None:
    hil_sim = sys.argv[1]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sweep = folder / "sweep.toml"
        sweep.write_text(SWEEP)
        alone = folder / "alone"
        subprocess.run([hil_sim, "sweep", sweep, "--out", alone], check=True, stdout=subprocess.DEVNULL)
        for workers, kills in [(1, False), (2, False), (3, False), (2, True)]:
            out = folder / f"{workers}-{kills}"
            line = [sys.executable, SCRIPT, sweep, "--out", out, "--workers", str(workers), "--batch", "50"]
            with tempfile.TemporaryFile() as log:
                ray = subprocess.Popen([*line, "--hil-sim", hil_sim], stdout=log, stderr=log)
                killed, begun = 0, time.monotonic()
                while ray.poll() is None and time.monotonic() - begun < MOST_S:
                    for pid in workers_of(ray.pid)[: int(kills and not killed)]:
                        os.kill(pid, signal.SIGKILL)
                        killed += 1
                    time.sleep(0.05)
                if ray.poll() is None:
                    ray.kill()
                log.seek(0)
                said = log.read().decode(errors="replace")
            if ray.wait() != 0:
                sys.exit(f"{workers} workers: exit code {ray.returncode}\n{said}")
            if kills and not killed:
                sys.exit(f"no worker was seen to kill\n{said}")
            if files(out) != files(alone):
                sys.exit(f"{workers} workers, {killed} killed: other bytes than those of one machine")
            print(f"{workers} workers, {killed} killed: the bytes of one machine")


if __name__ == "__main__":
    main()
