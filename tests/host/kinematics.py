"""Fingertips of random poses against yourdfpy and MuJoCo, which load the generated models and know nothing of this project.

usage: kinematics.py POSES.csv MODEL.urdf MODEL.xml

POSES.csv is written by kinematics/examples/poses.rs. Joint angles are computed here, from the manual's ratios.
Exit code 1: a fingertip is off by more than 0.01 mm, or a model is not what docs/kinematics.md promises.
"""

import csv
import importlib.metadata
import itertools
import math
import os
import sys
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy
import yourdfpy

# The bound.
MOST_MM = 0.01
# A Jacobian's entries are lever arms below 0.2 m; the models' angles are rounded to 1e-9 rad.
MOST_M_PER_RAD = 1e-6

# How far full torque may press a joint over its stop, rad; MuJoCo's stops are soft.
MOST_OVER = math.radians(1)

COUNTS_PER_TURN = 18
# Manual 1.3.2, table 2, in the order of the motors.
JOINTS = {
    "link_1": 49, "link_2": 49, "link_3": 49, "spread_1": 18.28, "tip_1": 39, "tip_2": 39, "tip_3": 39,
}
FINGERS = (1, 2, 3)
# docs/kinematics.md lists them: a body of the URDF, and its parent.
ALWAYS_TOUCH = {(f"finger_{finger}_tip", f"finger_{finger}_link") for finger in FINGERS}
ALWAYS_TOUCH |= {(f"finger_{finger}_link", f"finger_{finger}_base") for finger in (1, 2)}
# Names of Drake in the URDF, as ElementTree writes them.
DRAKE = "{http://drake.mit.edu}"


def check(holds, what):
    if not holds:
        print(f"FAILED: {what}")
        sys.exit(1)


def read(path):
    """Joint angles, fingertips and Jacobians of each pose."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    poses = []
    for row in rows:
        angles = {
            joint: float(row[f"motor_{motor}"]) * 2 * math.pi / COUNTS_PER_TURN / ratio
            for motor, (joint, ratio) in enumerate(JOINTS.items(), 1)
        }
        tips = [[float(row[f"finger_{finger}_{axis}"]) for axis in "xyz"] for finger in FINGERS]
        jacobians = [[float(row[f"finger_{finger}_j{entry}"]) for entry in range(1, 10)] for finger in FINGERS]
        poses.append((angles, numpy.array(tips), numpy.array(jacobians).reshape(3, 3, 3)))
    return poses


def check_urdf(path, robot):
    """Seven joints of their own and a mimic, with limits; inertia and collision shapes of every body; no xacro, no mesh file."""
    tree = ElementTree.parse(path).getroot()
    spaced = {node.tag for node in tree.iter() if "}" in node.tag}
    check(spaced == {DRAKE + "rotor_inertia", DRAKE + "gear_ratio"}, f"no xacro, and of other spaces' names Drake's motors: {spaced}")
    check(not list(tree.iter("mesh")), "the URDF needs no mesh file")
    check(sorted(robot.actuated_joint_names) == sorted(JOINTS), f"seven joints: {robot.actuated_joint_names}")
    revolute = [joint for joint in tree.iter("joint") if joint.get("type") == "revolute"]
    mimics = {joint.get("name"): joint.find("mimic").get("joint") for joint in revolute if joint.find("mimic") is not None}
    check(len(revolute) == 8 and mimics == {"spread_2": "spread_1"}, f"one mimic: {mimics}")
    for joint in revolute:
        limit = {key: float(joint.find("limit").get(key)) for key in ("lower", "upper", "effort", "velocity")}
        check(limit["lower"] < limit["upper"] and limit["effort"] > 0 and limit["velocity"] > 0, f"{joint.get('name')}: {limit}")
    bodies = [link for link in tree.iter("link") if link.find("collision") is not None]
    check(len(bodies) == 10, "ten bodies have collision shapes")
    total = 0
    for body in bodies:
        mass = float(body.find("inertial/mass").get("value"))
        xx, yy, zz = (float(body.find("inertial/inertia").get(key)) for key in ("ixx", "iyy", "izz"))
        total += mass
        # What a rigid body of positive mass obeys.
        check(mass > 0 and min(xx, yy, zz) > 0 and max(xx, yy, zz) < xx + yy + zz - max(xx, yy, zz), body.get("name"))
    motors = {}
    for transmission in tree.iter("transmission"):
        actuator = transmission.find("actuator")
        check(float(actuator.find(DRAKE + "rotor_inertia").get("value")) > 0, actuator.get("name"))
        motors[transmission.find("joint").get("name")] = float(actuator.find(DRAKE + "gear_ratio").get("value"))
    check(motors == JOINTS, f"a motor for each joint, with the manual's ratio: {motors}")
    check(abs(total - 6.9) < 1e-6, f"the manual's 6.9 kg: {total}")
    for finger in FINGERS:
        # PyBullet gives a link without a mass 1 kg.
        mass = tree.find(f"link[@name='finger_{finger}_fingertip']/inertial/mass")
        check(mass is not None and 0 < float(mass.get("value")) < 1e-5, f"fingertip {finger} has a mass of next to nothing")


def worst_of_yourdfpy(robot, poses):
    worst = 0
    for angles, tips, _ in poses:
        robot.update_cfg(angles)
        for finger, tip in zip(FINGERS, tips):
            found = robot.get_transform(f"finger_{finger}_fingertip", "palm")[:3, 3]
            worst = max(worst, numpy.linalg.norm(found - tip))
    return 1000 * worst


def touching(model, data, angles):
    """Pairs of a body and its parent that touch at joint angles: child, parent."""
    for name, angle in {**angles, "spread_2": angles["spread_1"]}.items():
        data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    pairs = set()
    for contact in data.contact[: data.ncon]:
        bodies = model.geom_bodyid[contact.geom]
        for child, parent in (bodies, bodies[::-1]):
            if model.body_parentid[child] == parent:
                pairs.add((model.body(child).name, model.body(parent).name))
    return pairs


def check_contacts(model, poses):
    """MuJoCo leaves out contacts of a body with its parent, but not if the parent stands still: none remain. The others are documented."""
    data = mujoco.MjData(model)
    found = set().union(*(touching(model, data, angles) for angles, _, _ in poses))
    check(not found, f"bodies touch parents that stand still: {sorted(found)}")
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
    found = [touching(model, data, angles) for angles, _, _ in poses]
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    check(all(pairs == ALWAYS_TOUCH for pairs in found), f"other bodies touch their parents: {set().union(*found) ^ ALWAYS_TOUCH}")


def mujoco_of_urdf(path):
    spec = mujoco.MjSpec.from_file(path)
    # Otherwise fingertips vanish into their tips.
    spec.compiler.fusestatic = False
    return spec.compile()


def worst_of_mujoco(model, poses, is_site):
    """The worst distance, mm, and the worst entry of a Jacobian, m/rad."""
    data = mujoco.MjData(model)
    joint = {name: model.joint(name) for name in [*JOINTS, "spread_2"]}
    kind = mujoco.mjtObj.mjOBJ_SITE if is_site else mujoco.mjtObj.mjOBJ_BODY
    ends = [mujoco.mj_name2id(model, kind, f"finger_{finger}_fingertip") for finger in FINGERS]
    check(min(ends) >= 0, "the model has three fingertips")
    places, jacobian_of = (data.site_xpos, mujoco.mj_jacSite) if is_site else (data.xpos, mujoco.mj_jacBody)
    worst, worst_lever = 0, 0
    for angles, tips, jacobians in poses:
        for name, angle in {**angles, "spread_2": angles["spread_1"]}.items():
            data.qpos[joint[name].qposadr[0]] = angle
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for finger, end, tip, expected in zip(FINGERS, ends, tips, jacobians):
            worst = max(worst, numpy.linalg.norm(places[end] - tip))
            jacobian = numpy.zeros((3, model.nv))
            jacobian_of(model, data, jacobian, None, end)
            for column, name in enumerate((f"spread_{finger}", f"link_{finger}", f"tip_{finger}")):
                found = jacobian[:, joint[name].dofadr[0]] if name in joint else numpy.zeros(3)
                worst_lever = max(worst_lever, numpy.abs(found - expected[:, column]).max())
    return 1000 * worst, worst_lever


def check_simulation(model, speeds):
    """Full torque on each motor for 3 s, to either end: the documented speed, the stop holds, both spreads alike, nothing explodes."""
    for step, motor, sign in itertools.product((0.001, 0.002), JOINTS, (1, -1)):
        model.opt.timestep = step
        data = mujoco.MjData(model)
        joint = model.joint(motor)
        data.actuator(motor).ctrl[0] = sign * 0.65
        if motor == "spread_1" and sign < 0:
            data.joint("spread_1").qpos[0] = data.joint("spread_2").qpos[0] = 3
        speed, over, apart = 0, 0, 0
        while data.time < 3:
            mujoco.mj_step(model, data)
            angle = data.joint(motor).qpos[0]
            speed = max(speed, abs(data.joint(motor).qvel[0]))
            over = max(over, joint.range[0] - angle, angle - joint.range[1])
            apart = max(apart, abs(data.joint("spread_1").qpos[0] - data.joint("spread_2").qpos[0]))
        what = f"{motor} at {sign * 0.65} N m, steps of {step} s"
        check(numpy.isfinite(data.qpos).all() and all(warning.number == 0 for warning in data.warning), f"{what}: stable")
        check(0.98 < speed / speeds[motor] < 1.02, f"{what}: top speed {speed} rad/s, documented {speeds[motor]}")
        end = joint.range[1 if sign > 0 else 0]
        check(over < MOST_OVER and abs(data.joint(motor).qpos[0] - end) < MOST_OVER, f"{what}: {over} rad over the stop at {end}")
        # Equality constraints of MuJoCo are soft.
        check(apart < 0.005, f"{what}: one motor spreads both fingers, apart by {apart} rad")


def main():
    poses_path, urdf, mjcf = sys.argv[1:]
    poses = read(poses_path)
    check(len(poses) >= 100, f"{len(poses)} poses")
    robot = yourdfpy.URDF.load(urdf, load_meshes=False, build_scene_graph=True)
    check_urdf(urdf, robot)
    model = mujoco.MjModel.from_xml_path(mjcf)
    check(model.nu == 7 and model.neq == 1 and abs(sum(model.body_mass) - 6.9) < 1e-6, "the MJCF has seven motors, one mimic and 6.9 kg")
    check_simulation(model, {name: robot.joint_map[name].limit.velocity for name in JOINTS})
    urdf_model = mujoco_of_urdf(urdf)
    check_contacts(urdf_model, poses)
    found = {
        f"yourdfpy {importlib.metadata.version('yourdfpy')}, URDF": (worst_of_yourdfpy(robot, poses), None),
        f"MuJoCo {mujoco.__version__}, URDF": worst_of_mujoco(urdf_model, poses, False),
        f"MuJoCo {mujoco.__version__}, MJCF": worst_of_mujoco(model, poses, True),
    }
    for name, (worst_mm, worst_lever) in found.items():
        lever = "" if worst_lever is None else f", worst entry of a Jacobian {worst_lever:.1e} m/rad"
        print(f"{name}: {len(poses)} poses, worst fingertip {worst_mm:.1e} mm{lever}")
    # The figure of the README, which has two digits.
    readme = open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../README.md"), encoding="utf-8").read()
    stated = float(readme.split("| off by ")[1].split(" mm at worst")[0])
    worst_mm = max(mm for mm, _ in found.values())
    check(stated / 2 < worst_mm <= 1.05 * stated, f"README.md: off by {stated} mm at worst, found {worst_mm:.1e}")
    for name, (worst_mm, worst_lever) in found.items():
        check(worst_mm <= MOST_MM, f"{name}: {worst_mm} mm, expected {MOST_MM} at most")
        check(worst_lever is None or worst_lever <= MOST_M_PER_RAD, f"{name}: {worst_lever} m/rad, expected {MOST_M_PER_RAD} at most")


main()
