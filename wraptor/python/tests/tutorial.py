"""Executes the tutorial: `tutorial.py PAGE FOLDER` runs the page's ```python blocks in order, in one namespace, with FOLDER as the
working directory for its pictures, against a simulated hand on a free port. Each picture that the page shows must come out of it."""

import os
import re
import subprocess
import sys
import traceback
from pathlib import Path
from typing import Any

import matplotlib

# Where the page says that the hand is.
ADDRESS = "127.0.0.1:11001"


def blocks(text: str) -> list[str]:
    """The code, each block preceded by empty lines up to its own, so that errors name the page's lines."""
    found = re.finditer(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return ["\n" * text.count("\n", 0, match.start(1)) + match.group(1) for match in found]


def main() -> None:
    page, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["MPLBACKEND"] = "Agg"
    # The same pictures for the same version of matplotlib.
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    matplotlib.rcParams["svg.hashsalt"] = page.name
    os.chdir(folder)
    text = page.read_text()
    hand = subprocess.Popen(
        [os.environ["HIL_SIM"], "hand", "--listen", "127.0.0.1:0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert hand.stdout is not None
    address = hand.stdout.readline().split()[1]
    namespace: dict[str, Any] = {"__name__": "tutorial"}
    pictures = {Path(name).name for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)}
    for name in pictures:
        Path(name).unlink(missing_ok=True)
    try:
        for block in blocks(text):
            exec(compile(block.replace(ADDRESS, address), page, "exec"), namespace)
    except Exception:
        traceback.print_exc(file=sys.stdout)
        sys.exit(1)
    finally:
        hand.kill()
        hand.wait()
    missing = sorted(name for name in pictures if not Path(name).exists())
    if missing:
        sys.exit(f"{page.name} shows {', '.join(missing)}, which no block of it has written")
    print(f"{len(blocks(text))} blocks of {page.name} executed; its pictures are in {folder}")


if __name__ == "__main__":
    main()
