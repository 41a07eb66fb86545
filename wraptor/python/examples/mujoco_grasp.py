"""A grasp in which MuJoCo finds the contacts and the project's boards drive the motors, in lock step at 1 kHz.

    pip install wraptor mujoco
    python wraptor/python/examples/mujoco_grasp.py --picture grasp.svg

Types HI and GC at two simulated hands with a ball between their fingers. The first meets the ball in hil-sim's own world of grasps. The
second has no world but its joints' stops (`contacts=False`): each millisecond

1. boards, motors and gears advance by 1 ms under the last contact torques;
2. MuJoCo's joints take the joints' true positions and the rotors' true speeds;
3. MuJoCo advances by 1 ms: it finds the contacts and their forces, and moves the ball once it is free;
4. the torques of these forces are the loads of the next millisecond.

Rotors, worms and friction stay in one place, hil-sim's plant. docs/mujoco.md says why this is stable, and how MuJoCo's contacts become
springs of the same stiffness.

The ball is held during GC, as hil-sim's is. Then it is free, with its weight, for a second. Prints the positions of both hands after GC.
Exit code 1 if a motor's differ by more than 2 hall counts or the ball leaves the hand, 2 if a package or a file is missing.
"""

import argparse
import math
import re
import sys
from pathlib import Path
from typing import Any

try:
    import mujoco  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import numpy as np
    from numpy.typing import NDArray

    import wraptor
except ImportError as missing:
    print(f"{missing}\n  install it: pip install wraptor mujoco", file=sys.stderr)
    sys.exit(2)

# Seconds, the motors' hall counts, and which of them press on the ball.
Trace = list[tuple[float, NDArray[np.float64], list[bool]]]

ROOT = Path(__file__).resolve().parents[3]
MODEL = ROOT / "kinematics/model/barrettwraptor.xml"
BALL = ROOT / "hil-sim/grasps/ball.toml"

STEP_S = 0.001
# Of MuJoCo in a step: the free ball on its contacts is at 100 Hz.
SUBSTEPS = 10
# Longest HI or GC: HI ends within 25 s (docs/safety.md).
LIMIT_S = 60.0
COUNTS_PER_TURN = 18
MOTORS = ["link_1", "link_2", "link_3", "spread_1", "tip_1", "tip_2", "tip_3"]
NAMES = ["link 1", "link 2", "link 3", "spread", "tip 1", "tip 2", "tip 3"]
COLORS = ["#0b62c4", "#d9480f", "#1a7f4b"]
TOLERANCE_COUNTS = 2.0
# A free ball that moves farther has left the hand; its radius is 30 mm.
TOLERANCE_MM = 10.0

# hil-sim/experiment/src/grasp.rs, STIFFNESS_N_M.
STIFFNESS_N_M = 2e5
# Half of critical for the rotor of a link, 70 mm from its joint: sqrt(2e5 N/m * 2e-5 kg m2) / (0.07 m / 49).
DAMPING_N_S_M = 1400.0
# Low: springs, not constraints on accelerations (docs/mujoco.md).
IMPEDANCE = 0.01
# Brass.
BALL_KG = 1.0
FREE_S = 1.0


def numbers(key: str) -> list[float]:
    """The numbers of a key of the ball's file."""
    # Python 3.10 has no reader of TOML.
    found = re.search(rf"^{key} = (.*)$", BALL.read_text(encoding="utf-8"), re.MULTILINE)
    if not found:
        raise SystemExit(f"{BALL}: found no line '{key} = ...'")
    return [float(number) for number in found[1].strip("[]").split(",")]


def model() -> Any:
    """The hand's MJCF with the ball. Links and tips touch the ball and those of other fingers, as in hil-sim; the palm supports the free ball."""
    spec = mujoco.MjSpec.from_file(str(MODEL))
    spec.option.timestep = STEP_S / SUBSTEPS
    # Joints follow hil-sim's plant, which has their stops and the one motor of both spreads.
    for equality in list(spec.equalities):
        spec.delete(equality)
    parts = []
    for body in spec.bodies[1:]:
        [geom] = body.geoms
        geom.name, geom.contype, geom.conaffinity = body.name, 0, 0
        if body.name.endswith(("_link", "_tip")):
            parts.append(body.name)
    body = spec.worldbody.add_body(name="ball", pos=[mm / 1000 for mm in numbers("at_mm")])
    body.add_freejoint()
    body.add_geom(
        name="ball",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[numbers("radius_mm")[0] / 1000, 0, 0],
        mass=BALL_KG,
        contype=0,
        conaffinity=0,
    )
    pairs = [(part, "ball") for part in [*parts, "palm"]]
    pairs += [(a, b) for a in parts for b in parts if a[:8] < b[:8]]
    for a, b in pairs:
        spec.add_pair(geomname1=a, geomname2=b, condim=1)
    made = spec.compile()
    made.jnt_limited[:] = 0
    # The MJCF's damping stands for the motors' back-EMF, which hil-sim's plant has.
    made.dof_damping[:] = 0
    weight = made.body_invweight0[:, 0]
    for pair in range(made.npair):
        bodies = made.geom_bodyid[[made.pair_geom1[pair], made.pair_geom2[pair]]]
        scale = (1 - IMPEDANCE) * weight[bodies].sum()
        made.pair_solref[pair] = [-STIFFNESS_N_M * scale, -DAMPING_N_S_M * scale]
        made.pair_solimp[pair] = [IMPEDANCE, IMPEDANCE, 0.001, 0.5, 1]
    return made


class Coupled:
    """A simulated hand whose contacts are MuJoCo's."""

    def __init__(self) -> None:
        self.hand = wraptor.sim.Hand(contacts=False)
        self.model = model()
        self.data = mujoco.MjData(self.model)
        gear = [self.model.actuator(name).gear[0] for name in MOTORS]
        self.angle = 2 * math.pi / (COUNTS_PER_TURN * np.array(gear))
        joints = [*MOTORS, "spread_2"]
        self.qpos = [self.model.joint(name).qposadr[0] for name in joints]
        self.dofs = [self.model.joint(name).dofadr[0] for name in joints]
        self.ball = self.model.body("ball").jntadr[0]
        self.is_held = True

    def step(self) -> None:
        """Advances boards, motors and MuJoCo by 1 ms."""
        hand, data = self.hand, self.data
        hand.step(STEP_S)
        angles, speeds = hand.joint_positions * self.angle, hand.velocities * self.angle
        for _ in range(SUBSTEPS):
            data.qpos[self.qpos] = [*angles, angles[3]]
            data.qvel[self.dofs] = [*speeds, speeds[3]]
            if self.is_held:
                at = self.model.jnt_qposadr[self.ball]
                data.qpos[at : at + 7] = self.model.qpos0[at : at + 7]
                data.qvel[self.model.jnt_dofadr[self.ball] :] = 0
            mujoco.mj_step(self.model, data)
        torques = data.qfrc_constraint[self.dofs]
        torques[3] += torques[7]
        for motor in range(7):
            hand.load(motor + 1, torques[motor])

    def pressed(self) -> list[bool]:
        """Which links and tips press on the ball, in the order of the motors."""
        names = set()
        for contact in self.data.contact[: self.data.ncon]:
            pair = [self.model.geom(geom).name for geom in contact.geom]
            if contact.dist < 0 and "ball" in pair:
                names.update(pair)
        return [f"finger_{name[-1]}_{name.split('_')[0]}" in names for name in MOTORS]


class Own:
    """A simulated hand in hil-sim's world of grasps."""

    def __init__(self) -> None:
        self.hand = wraptor.sim.Hand(grasp=BALL)

    def step(self) -> None:
        """Advances by 1 ms."""
        self.hand.step(STEP_S)

    def pressed(self) -> list[bool]:
        """Unknown."""
        return [False] * 7


def run(world: Coupled | Own, line: str) -> tuple[str, Trace]:
    """Types a line and steps until the prompt. Returns the answer, and times, positions and contacts."""
    hand = world.hand
    start, sent = hand.time, ""
    trace: Trace = []
    hand.receive()
    hand.send(line + "\r")
    while not sent.endswith("=> "):
        if hand.time - start > LIMIT_S:
            raise SystemExit(f"{line}: no prompt within {LIMIT_S} s, only {sent!r}")
        world.step()
        sent += hand.receive()
        trace.append((hand.time - start, hand.positions, world.pressed()))
    if "ERR" in sent:
        raise SystemExit(f"{line}: {sent!r}")
    return sent[len(line) :].removesuffix("=> ").strip(), trace


def grasp(world: Coupled | Own) -> tuple[Trace, list[float]]:
    """HI and GC. Returns the trace of GC and the counts at which the links broke away."""
    run(world, "HI")
    _, trace = run(world, "GC")
    answer, _ = run(world, "GFGET BP")
    return trace, [int(value) / 55 for value in answer.split()]


def release(coupled: Coupled) -> tuple[float, float]:
    """Frees the ball. Returns how far it and the motors then move, mm and counts."""
    ball, hand = coupled.data.body("ball"), coupled.hand
    place, positions = ball.xpos.copy(), hand.positions
    coupled.is_held = False
    for _ in range(round(FREE_S / STEP_S)):
        coupled.step()
    moved_m = float(np.linalg.norm(ball.xpos - place))
    return 1000 * moved_m, float(np.abs(hand.positions - positions).max())


def picture(coupled: Coupled, ours: Trace, theirs: Trace) -> str:
    """Positions over time, contacts, and the fingers at the end from the side, as SVG."""
    width, height, left, top = 560, 330, 60, 40
    end = max(ours[-1][0], theirs[-1][0])

    def at(time: float, counts: float) -> tuple[float, float]:
        return left + width * time / end, top + height * (1 - counts / 350)

    svg = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1040 470" font-family="sans-serif" font-size="13" fill="#1c2128">',
        '<rect width="100%" height="100%" fill="#fff"/>',
        f'<text x="{left}" y="24" font-size="15">GC on a ball: MuJoCo (lines), hil-sim\'s own world (black dots)</text>',
    ]
    for counts in range(0, 351, 50):
        (x, y), (far, _) = at(0, counts), at(end, counts)
        svg.append(f'<line x1="{x}" y1="{y:.1f}" x2="{far:.1f}" y2="{y:.1f}" stroke="#d0d4d9"/>')
        svg.append(f'<text x="{x - 8}" y="{y + 4:.1f}" text-anchor="end">{counts}</text>')
    for tenths in range(0, int(end * 10) + 1, 5):
        svg.append(f'<text x="{at(tenths / 10, 0)[0]:.1f}" y="{top + height + 18}" text-anchor="middle">{tenths / 10:g} s</text>')
    for trace, dots in ((theirs, ""), (ours, "2 6")):
        for motor in (0, 1, 2, 4, 5, 6):
            points = " ".join("{:.1f},{:.1f}".format(*at(time, counts[motor])) for time, counts, _ in trace[::5])
            color = "#1c2128" if dots else COLORS[motor % 4]
            thick = 1 if dots else 4 if motor < 3 else 2
            svg.append(
                f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="{thick}" stroke-dasharray="{dots}"/>'
            )
    for row, motor in enumerate((0, 1, 2, 4, 5, 6)):
        y = top + height + 32 + 11 * row
        svg.append(f'<text x="{left - 8}" y="{y + 4}" text-anchor="end" font-size="10">{NAMES[motor]}</text>')
        times = [time for time, _, pressed in theirs if pressed[motor]]
        path = "".join(f"M{at(time, 0)[0]:.2f} {y}h{width * STEP_S / end + 0.2:.2f}" for time in times)
        svg.append(f'<path d="{path}" stroke="{COLORS[motor % 4]}" stroke-width="7"/>')
    svg.append(f'<text x="{left + width + 6}" y="{top + height + 64}">presses on the ball</text>')
    svg.append(f'<text x="{left + 8}" y="{top + 16}">hall counts; thick: links, thin: tips</text>')
    return "\n".join([*svg, *fingers(coupled), "</svg>", ""])


def fingers(coupled: Coupled) -> list[str]:
    """The shapes of MuJoCo's model from the side: y to the right, z up."""
    scale, middle, bottom = 1150, 840, 330
    model, data = coupled.model, coupled.data
    shapes: list[str] = []
    names = ["palm", "ball"] + [f"finger_{finger}_{part}" for finger in (1, 2, 3) for part in ("base", "link", "tip")]
    for name in names:
        geom = model.geom(name).id
        radius, half = model.geom_size[geom][:2]
        if name == "palm":
            radius, half = half, radius
        axis = [0, 1, 0] if name == "palm" else data.geom_xmat[geom].reshape(3, 3)[:, 2]
        ends = [data.geom_xpos[geom] + side * half * np.array(axis) for side in (-1, 1)]
        (x1, y1), (x2, y2) = [(middle + scale * end[1], bottom - scale * end[2]) for end in ends]
        color = {"palm": "#d0d4d9", "ball": "#c9a227"}.get(name) or COLORS[int(name[7]) - 1]
        cap = "butt" if name == "palm" else "round"
        shapes.append(
            f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2 + 0.01:.2f}" y2="{y2:.1f}" stroke="{color}" stroke-width="{2 * scale * radius:.1f}" '
            f'stroke-linecap="{cap}" opacity="0.7"/>'
        )
    return [*shapes, f'<text x="{middle - 130}" y="360">MuJoCo after GC, from the side</text>']


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--picture", type=Path, help="write an SVG of both hands' positions over time")
    path = arguments.parse_args().picture
    coupled = Coupled()
    (ours, our_breaks), (theirs, their_breaks) = grasp(Own()), grasp(coupled)
    names = [*NAMES, "BP 1", "BP 2", "BP 3"]
    rows = list(zip(names, [*ours[-1][1], *our_breaks], [*theirs[-1][1], *their_breaks]))
    print("GC with the ball, hall counts\n          own world    MuJoCo  difference")
    for name, own, other in rows:
        print(f"{name:8} {own:10.2f} {other:9.2f} {other - own:11.2f}")
    worst = max(abs(other - own) for _, own, other in rows)
    print(f"worst {worst:.2f} counts, allowed {TOLERANCE_COUNTS:g}")
    if path:
        path.write_text(picture(coupled, ours, theirs), encoding="utf-8")
    moved_mm, counts = release(coupled)
    print(f"the free ball moves {moved_mm:.1f} mm in {FREE_S:g} s, allowed {TOLERANCE_MM:g}; motors move {counts:.2f} counts")
    return int(not (worst <= TOLERANCE_COUNTS and moved_mm <= TOLERANCE_MM))


if __name__ == "__main__":
    sys.exit(main())
