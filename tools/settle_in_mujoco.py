"""Lets the bodies of a run settle in MuJoCo and compares with what `harmony simulate RUN --settle` found.

    python tools/settle_in_mujoco.py RUN [RUN ...] [--json OUT] [--least 0.95]

Reads RUN/7_world/bodies.json and RUN/7_world/settle.json. Where the settling was repaired, the repaired places are taken.
An object agrees when both simulators have its origin within 1 cm after 5 s. Exit code 1 when fewer than `--least` of the
objects that move agree, or MuJoCo warns.
"""

import argparse
import json
import math
import sys
from pathlib import Path

import mujoco
import numpy as np

SECONDS = 5.0
STEP = 0.002
AGREE_M = 0.01


def numbers(values):
    return " ".join(f"{v:.9g}" for v in values)


def up(v):
    """Room (+Y up) to MuJoCo (+Z up)."""
    return (v[0], -v[2], v[1])


# Quaternion w, x, y, z of the turn by +90 degrees about x that `up` is.
TURN = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)


def times(a, b):
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def model_text(bodies, places):
    assets, world = [], []

    def mesh(name, hull):
        assets.append(f'<mesh name="{name}" vertex="{numbers(x for v in hull["vertices"] for x in v)}"/>')

    for face, hulls in bodies["shell"]:
        for k, hull in enumerate(hulls):
            mesh(f"room_{face}_{k}", hull)
            world.append(f'<geom type="mesh" mesh="room_{face}_{k}" quat="{numbers(TURN)}" friction="0.5"/>')
    for body in bodies["objects"]:
        place = places[body["id"]]
        x, y, z, w = place["rotation"]
        quat = times(TURN, (w, x, y, z))
        geoms = []
        for k, hull in enumerate(body["hulls"]):
            mesh(f'{body["id"]}_{k}', hull)
            geoms.append(f'<geom type="mesh" mesh="{body["id"]}_{k}" friction="{body["friction"]:.4g}" mass="0"/>')
        head = f'<body name="{body["id"]}" pos="{numbers(up(place["position"]))}" quat="{numbers(quat)}">'
        if body["motion"] == "dynamic":
            i = body["inertia"]
            full = (i[0][0], i[1][1], i[2][2], i[0][1], i[0][2], i[1][2])
            head += "<freejoint/>" + (
                f'<inertial pos="{numbers(body["centre_of_mass"])}" mass="{body["mass_kg"]:.9g}" '
                f'fullinertia="{numbers(full)}"/>'
            )
        world.append(head + "".join(geoms) + "</body>")
    return (
        '<mujoco><compiler angle="radian" balanceinertia="true" boundinertia="1e-9"/>'
        f'<option timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="10" gravity="0 0 -9.81"/>'
        '<size memory="512M"/>'
        '<default><geom solref="0.004 1" solimp="0.95 0.99 0.001"/></default>'
        f"<asset>{''.join(assets)}</asset><worldbody>{''.join(world)}</worldbody></mujoco>"
    )


def check(run):
    folder = Path(run) / "7_world"
    bodies = json.loads((folder / "bodies.json").read_text())
    file = json.loads((folder / "settle.json").read_text())
    repaired = file.get("repaired")
    settled = repaired["after"] if repaired else file["settled"]
    scene = json.loads((Path(run) / "scene.json").read_text())
    poses = {o["id"]: (o["pose"]["position"], o["pose"]["yaw"]) for o in scene["objects"]}
    for repair in (repaired or {}).get("repairs", []):
        poses[repair["id"]] = (repair["position"], repair["yaw"])
    places = {
        name: {"position": p, "rotation": (0.0, math.sin(yaw / 2), 0.0, math.cos(yaw / 2))}
        for name, (p, yaw) in poses.items()
    }
    model = mujoco.MjModel.from_xml_string(model_text(bodies, places))
    data = mujoco.MjData(model)
    for _ in range(round(SECONDS / STEP)):
        mujoco.mj_step(model, data)
    warnings = int(sum(w.number for w in data.warning))
    rows = []
    for o in settled["objects"]:
        if o["motion"] != "dynamic":
            continue
        mine = np.array(up(o["settled"]["position"]))
        theirs = data.body(o["id"]).xpos
        start = np.array(up(places[o["id"]]["position"]))
        rows.append({
            "id": o["id"],
            "apart_m": float(np.linalg.norm(mine - theirs)),
            "drift_here_m": float(np.linalg.norm(mine - start)),
            "drift_mujoco_m": float(np.linalg.norm(theirs - start)),
        })
    return rows, warnings


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--least", type=float, default=0.95)
    args = parser.parse_args()
    everything, agree, count, warned = {}, 0, 0, 0
    for run in args.runs:
        rows, warnings = check(run)
        good = sum(r["apart_m"] <= AGREE_M for r in rows)
        still = sum(r["drift_mujoco_m"] <= AGREE_M for r in rows)
        print(f"{run}: {good} of {len(rows)} within 1 cm of each other, {still} still in MuJoCo, {warnings} warnings")
        for r in rows:
            if r["apart_m"] > AGREE_M:
                print(f"  {r['id']}: {100 * r['apart_m']:.1f} cm apart; drift {100 * r['drift_here_m']:.1f} cm here, {100 * r['drift_mujoco_m']:.1f} cm in MuJoCo")
        everything[run] = rows
        agree, count, warned = agree + good, count + len(rows), warned + warnings
    print(f"together {agree} of {count} ({100 * agree / max(count, 1):.1f} %)")
    if args.json:
        args.json.write_text(json.dumps(everything, indent=2) + "\n")
    sys.exit(0 if agree >= args.least * count and warned == 0 else 1)


main()
