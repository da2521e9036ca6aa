"""Plays a motion of `harmony robot` in Isaac Sim. NOT RUN by the authors: Isaac Sim needs an RTX GPU and its own
installation. Written against the documented interfaces of Isaac Sim 4.5 and 5.x; if a name has moved, the error says which.

    harmony export RUN --to usd --out OUT
    ~/isaacsim/python.sh tools/isaac_replay.py OUT/usd/scene.usda OUT/trajectory.json ROBOT.usd [--headless]

ROBOT.usd is the robot as Isaac Sim ships it (Isaac/Robots/Franka/franka.usd, Isaac/Robots/Unitree/H1/h1.usd), or what its
MJCF importer makes of the file that --model named. Joint names of the trajectory are looked up in it: the Franka of Isaac Sim
calls them panda_joint1 ... and panda_finger_joint1 ..., the H1 left_hip_yaw_joint ...; RENAMES has both.

Kinematic playback, as in the paper: physics is stopped, joint positions and the moved object's transform are set each frame.
The trajectory is in the room frame (+Y up, metres); the exported stage is +Z up: (x, y, z) becomes (x, -z, y).
"""

import argparse
import json

parser = argparse.ArgumentParser()
parser.add_argument("scene")
parser.add_argument("trajectory")
parser.add_argument("robot")
parser.add_argument("--headless", action="store_true")
args = parser.parse_args()

from isaacsim import SimulationApp  # noqa: E402  (the application must exist before anything else is imported)

app = SimulationApp({"headless": args.headless})

import numpy as np  # noqa: E402
import omni.usd  # noqa: E402
from isaacsim.core.api import World  # noqa: E402
from isaacsim.core.prims import SingleArticulation  # noqa: E402
from isaacsim.core.utils.stage import add_reference_to_stage, open_stage  # noqa: E402
from pxr import Gf, UsdGeom  # noqa: E402


def renames(name):
    """Names that a joint may have in the robot's USD file."""
    if name.startswith("finger_joint"):
        return [name, "panda_" + name]
    return [name, "panda_" + name, name + "_joint"]


def z_up(v):
    return np.array([v[0], -v[2], v[1]])


def root_rotation(xyzw):
    """Rotation of the root in the stage (w, x, y, z): the room is turned by a quarter about X."""
    x, y, z, w = xyzw
    half = np.sqrt(0.5)
    # (half, half, 0, 0) * (w, x, y, z): +Y up becomes +Z up.
    return np.array([half * (w - x), half * (x + w), half * (y - z), half * (z + y)])


trajectory = json.load(open(args.trajectory))
open_stage(args.scene)
add_reference_to_stage(usd_path=args.robot, prim_path="/World/robot")
world = World(stage_units_in_meters=1.0)
robot = world.scene.add(SingleArticulation(prim_path="/World/robot", name="robot"))
world.reset()

order = []
for name in trajectory["joints"]:
    found = [robot.dof_names.index(n) for n in renames(name) if n in robot.dof_names]
    if not found:
        raise SystemExit(f"joint {name} is not in {args.robot}: it has {', '.join(robot.dof_names)}")
    order.append(found[0])

stage = omni.usd.get_context().get_stage()
moved = [p for p in stage.Traverse() if p.GetName() == trajectory["object"]]
if not moved:
    raise SystemExit(f"{trajectory['object']} is not in {args.scene}")
xform = UsdGeom.Xformable(moved[0])
rest = xform.GetLocalTransformation()
parent = xform.ComputeParentToWorldTransform(0)

for frame in trajectory["frames"]:
    position = z_up(frame["root_position"])
    robot.set_world_pose(position=position, orientation=root_rotation(frame["root_rotation"]))
    values = np.zeros(robot.num_dof)
    values[order] = frame["joints"]
    robot.set_joint_positions(values)
    offset = z_up(frame["object_offset"])
    x, y, z, w = frame.get("object_rotation", (0, 0, 0, 1))
    turn = Gf.Matrix4d(1)
    turn.SetRotateOnly(Gf.Quatd(w, *map(float, z_up((x, y, z)))))
    turn.SetTranslateOnly(Gf.Vec3d(*map(float, offset)))
    now = rest * parent * turn * parent.GetInverse()
    xform.MakeMatrixXform().Set(now)
    world.render()

app.close()
