"""Reads a motion's USD layer back with usd-core and compares its time samples with the JSON that tells the same motion.

    python tools/usd_motion.py LAYER.usda earthquake.json
    python tools/usd_motion.py LAYER.usda trajectory.json [--mjcf MJCF/TASK.xml]

Compared in world space, by USD's own transforms, in every frame: of an earthquake the origin and the front of each object
that moves and the ground under it; of a robot its root, how far the object was moved from its first place, and with --mjcf
every link against MuJoCo's at the same keyframe. The composed stage must pass all validators. Ends with 1 when anything is
off; prints the largest differences (metres) as JSON.
"""

import argparse
import json
import sys

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdValidation

FAR = 1e-4


def z_up(v):
    return np.array([v[0], -v[2], v[1]])


def turned(q, v):
    """A vector turned by a quaternion x, y, z, w."""
    u, w = np.array(q[:3]), q[3]
    v = np.array(v, float)
    return v + 2 * np.cross(u, np.cross(u, v) + w * v)


def objects(stage):
    """Prims by name; a lamp's light has the lamp's."""
    from pxr import UsdLux

    return {p.GetName(): p for p in stage.Traverse() if not p.HasAPI(UsdLux.LightAPI)}


def earthquake(stage, told, at):
    prims = objects(stage)
    worst = 0.0
    count = len(told["ground"])
    for o in told["objects"]:
        prim = prims.get(o["id"])
        for frame in range(0, count if o["positions"] else 0):
            place = np.array(o["positions"][frame]) + np.array(told["ground"][frame])
            front = place + turned(o["rotations"][frame], (0, 0, 1))
            found = at(prim, frame)
            for own, wanted in (((0, 0, 0), place), ((0, -1, 0), front)):
                worst = max(worst, float(np.abs(np.array(found.Transform(Gf.Vec3d(*own))) - z_up(wanted)).max()))
    return {"frames": count, "objects_apart": worst}


def robot(stage, told, at, mjcf):
    prims = objects(stage)
    links = list(stage.GetPrimAtPath("/World/robot").GetChildren())
    frames = told["frames"]
    first = np.array(at(prims[told["object"]], 0).Transform(Gf.Vec3d(*told["object_point"])))
    root = moved = apart = 0.0
    model = data = None
    if mjcf:
        import mujoco

        model = mujoco.MjModel.from_xml_path(mjcf)
        data = mujoco.MjData(model)
    for k, frame in enumerate(frames):
        origin = lambda prim: np.array(at(prim, k).ExtractTranslation())
        root = max(root, float(np.abs(origin(links[0]) - z_up(frame["root_position"])).max()))
        now = np.array(at(prims[told["object"]], k).Transform(Gf.Vec3d(*told["object_point"])))
        # Offset and turn are of the room: what they do to the first place.
        room = np.array([first[0], first[2], -first[1]])
        wanted = turned(frame["object_rotation"], room) + np.array(frame["object_offset"])
        moved = max(moved, float(np.abs(now - z_up(wanted)).max()))
        if model:
            mujoco.mj_resetDataKeyframe(model, data, k)
            mujoco.mj_forward(model, data)
            for link in [*links, prims[told["object"]]]:
                own = f"robot_{link.GetName()}" if link in links else told["object"]
                body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, own)
                apart = max(apart, float(np.abs(data.xpos[body] - origin(link)).max()))
                axes = np.array(at(link, k))[:3, :3].T
                apart = max(apart, float(np.abs(data.xmat[body].reshape(3, 3) - axes).max()))
    return {"frames": len(frames), "links": len(links), "root_apart": root, "object_apart": moved, "links_apart": apart}


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("layer")
    arguments.add_argument("told")
    arguments.add_argument("--mjcf")
    args = arguments.parse_args()
    stage = Usd.Stage.Open(args.layer)
    told = json.load(open(args.told))
    caches = {}

    def at(prim, frame):
        if frame not in caches:
            caches.clear()
            caches[frame] = UsdGeom.XformCache(frame)
        return caches[frame].GetLocalToWorldTransform(prim)

    if "ground" in told:
        result = earthquake(stage, told, at)
    else:
        # A point of the object that its turns move, its own frame.
        told["object_point"] = (0.1, 0.2, 0.3)
        result = robot(stage, told, at, args.mjcf)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    issues = UsdValidation.ValidationContext(validators).Validate(stage)
    result["issues"] = [f"{e.GetName()}: {e.GetMessage()}" for e in issues]
    result["end_time_code"] = stage.GetEndTimeCode()
    result["frames_per_second"] = stage.GetTimeCodesPerSecond()
    bodies = [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.RigidBodyAPI)]
    result["kinematic"] = sorted(p.GetName() for p in bodies if UsdPhysics.RigidBodyAPI(p).GetKinematicEnabledAttr().Get())
    print(json.dumps(result))
    apart = max(v for k, v in result.items() if k.endswith("_apart"))
    off = result["issues"] or apart > FAR or result["end_time_code"] != result["frames"] - 1
    sys.exit(1 if off else 0)


main()
