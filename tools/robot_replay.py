"""Replays a motion of `harmony robot` in MuJoCo and measures it there.

    python tools/robot_replay.py OUT/mjcf/TASK.xml OUT/trajectory.json [--touching NAME,NAME] [--original MODEL.xml]

Every keyframe is set and evaluated (mj_forward), nothing is integrated. Printed as JSON:
  frames          keyframes of the file, which must be the trajectory's
  deepest         contact of a robot link with the scene of the smallest distance (metres, below 0 = in each other), its
                  frame and geoms; links that are named with --touching are left out where they meet the trajectory's object
  deepest_touch   the same for those links and that object
  over_limits     largest excess of a joint over its range
  links_apart     with --original: largest distance between a link of the file and the same link of the robot's own model
                  file in the same posture, relative to the root (an independent check of the kinematics)
  height_spread   of the middle between the two finger pads while the object is moved (models with two slides)
  lowest_foot     lowest and highest height of the lowest point of the feet over all frames (models with ankle links)
MuJoCo collides the scene's convex decompositions, not its triangles: they are up to a centimetre off.
"""

import argparse
import json

import mujoco
import numpy as np


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("xml")
    arguments.add_argument("trajectory")
    arguments.add_argument("--touching", default="")
    arguments.add_argument("--original")
    args = arguments.parse_args()
    trajectory = json.load(open(args.trajectory))
    touching = {f"robot_{name}" for name in args.touching.split(",") if name}
    model = mujoco.MjModel.from_xml_path(args.xml)
    data = mujoco.MjData(model)
    body = lambda geom: mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, model.geom_bodyid[geom]) or "world"
    deepest, touch, over = {"distance": 1.0}, {"distance": 1.0}, 0.0
    heights, feet = [], []
    moving = [f for f in trajectory["frames"]]
    for frame in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, frame)
        mujoco.mj_forward(model, data)
        for joint in range(model.njnt):
            if model.jnt_limited[joint]:
                value = data.qpos[model.jnt_qposadr[joint]]
                low, high = model.jnt_range[joint]
                over = max(over, low - value, value - high)
        for contact in data.contact:
            first, second = body(contact.geom1), body(contact.geom2)
            if first.startswith("robot_") == second.startswith("robot_"):
                continue
            robot, other = (first, second) if first.startswith("robot_") else (second, first)
            # The base stands on the floor, feet stand on it.
            if other == "floor":
                continue
            found = {"distance": float(contact.dist), "frame": frame, "link": robot, "other": other}
            meant = robot in touching and other == trajectory["object"]
            if meant and found["distance"] < touch["distance"]:
                touch = found
            if not meant and found["distance"] < deepest["distance"]:
                deepest = found
        slides = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE
                  and (mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, j) or "").startswith("robot_")]
        moved = np.linalg.norm(moving[frame]["object_offset"])
        if len(slides) == 2 and moved > 0:
            heights.append(float(np.mean([data.xpos[model.jnt_bodyid[j]][2] for j in slides])))
        for name in ("robot_left_ankle_link", "robot_right_ankle_link"):
            number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if number < 0:
                continue
            lowest = np.inf
            for geom in range(model.ngeom):
                if model.geom_bodyid[geom] == number and model.geom_group[geom] == 3:
                    mesh = model.geom_dataid[geom]
                    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
                    points = model.mesh_vert[start:start + count] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
                    lowest = min(lowest, points[:, 2].min())
            feet.append(float(lowest))
    result = {
        "frames": int(model.nkey),
        "deepest": deepest,
        "deepest_touch": touch,
        "over_limits": float(over),
        "height_spread": max(heights) - min(heights) if heights else None,
        "lowest_foot": [min(feet), max(feet)] if feet else None,
    }
    if args.original:
        result["links_apart"] = links_apart(model, data, args.original, trajectory)
    print(json.dumps(result))


def links_apart(model, data, path, trajectory):
    """Largest distance between links of both files, in the frame of the root."""
    own = mujoco.MjModel.from_xml_path(path)
    state = mujoco.MjData(own)
    names = [mujoco.mj_id2name(own, mujoco.mjtObj.mjOBJ_BODY, b) for b in range(1, own.nbody)]
    apart = 0.0
    for frame in range(0, model.nkey, 10):
        mujoco.mj_resetDataKeyframe(model, data, frame)
        mujoco.mj_forward(model, data)
        for name, value in zip(trajectory["joints"], trajectory["frames"][frame]["joints"]):
            joint = mujoco.mj_name2id(own, mujoco.mjtObj.mjOBJ_JOINT, name)
            state.qpos[own.jnt_qposadr[joint]] = value
        mujoco.mj_forward(own, state)

        def local(m, d, prefix):
            number = lambda n: mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, prefix + n)
            root = number(names[0])
            turn, at = d.xmat[root].reshape(3, 3), d.xpos[root]
            return np.array([turn.T @ (d.xpos[number(n)] - at) for n in names])

        apart = max(apart, float(np.abs(local(model, data, "robot_") - local(own, state, "")).max()))
    return apart


main()
