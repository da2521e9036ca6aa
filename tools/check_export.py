"""Judges exports with the readers of other programs.

    python tools/check_export.py usd|mujoco|settle|dxf FOLDER

FOLDER holds exports at any depth (`scene.usda`, `scene.usdz`, `scene.xml`, `*.urdf`, `*.dxf`) with their `export.json`, and
the run's `scene.json` above them. Runs in the environment that `tools/setup.sh checkers` makes; ends with 1 when anything
is wrong. `settle` measures and judges nothing: how far each object moved in 5 s.
"""

import json
import math
import pathlib
import sys
import warnings


def run_scene(path):
    """The `scene.json` above a file and the `export.json` of its export."""
    scene = manifest = None
    for folder in path.parents:
        if manifest is None and (folder / "export.json").is_file():
            manifest = json.loads((folder / "export.json").read_text())
        if (folder / "scene.json").is_file():
            scene = json.loads((folder / "scene.json").read_text())
            break
    return scene, manifest


def z_up(v):
    return (v[0], -v[2], v[1])


# ---------------------------------------------------------------- USD


def usd(folder):
    from pxr import Gf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade, UsdValidation

    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    context = UsdValidation.ValidationContext(validators)
    bad = 0
    files = sorted([*folder.rglob("scene.usda"), *folder.rglob("scene.usdz")])
    for path in files:
        problems = []
        stage = Usd.Stage.Open(str(path))
        issues = context.Validate(stage)
        problems += [f"{e.GetName()}: {e.GetMessage()}" for e in issues]
        if UsdGeom.GetStageUpAxis(stage) != "Z" or UsdGeom.GetStageMetersPerUnit(stage) != 1:
            problems.append("not metres with +Z up")
        scene, manifest = run_scene(path)
        bodies = {b["id"]: b for b in manifest["bodies"]}
        cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
        guides = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.guide])
        with warnings.catch_warnings():
            # Its successor wants a stage cache; what it yields is the same.
            warnings.simplefilter("ignore")
            parsed = UsdPhysics.LoadUsdPhysicsFromRange(stage, ["/World"])
        kinds = UsdPhysics.ObjectType
        shapes = {str(p): d for kind in (kinds.MeshShape,) for p, d in zip(*parsed.get(kind, ([], [])))}
        rigid = {str(p) for p in parsed.get(kinds.RigidBody, ([], []))[0]}
        joints = {str(p): d for kind in (kinds.RevoluteJoint, kinds.PrismaticJoint) for p, d in zip(*parsed.get(kind, ([], [])))}
        problems += joint_problems(stage, manifest, joints)
        by_name = {p.GetName(): p for p in stage.Traverse() if p.IsA(UsdGeom.Xform)}
        for o in scene["objects"]:
            prim = by_name.get(o["id"])
            if prim is None:
                problems.append(f"{o['id']} is missing")
                continue
            body = bodies[o["id"]]
            # An object with parts that open has its body and them beside each other.
            path_of = str(prim.GetPath())
            own_body = stage.GetPrimAtPath(f"{path_of}/body") or prim
            parts = [p for p in prim.GetChildren() if str(p.GetPath()) in rigid and p.GetName() != "body"]
            if sorted(p.GetName() for p in parts) != sorted(manifest["opens"].get(o["id"], [])):
                problems.append(f"{o['id']}: opens {[p.GetName() for p in parts]}")
            if (str(own_body.GetPath()) in rigid) != body["dynamic"]:
                problems.append(f"{o['id']}: moves {not body['dynamic']}")
            if body["dynamic"]:
                mass = sum(UsdPhysics.MassAPI(p).GetMassAttr().Get() for p in [own_body, *parts])
                if abs(mass - body["mass_kg"]) > 1e-3 * body["mass_kg"]:
                    problems.append(f"{o['id']}: {mass} kg, {body['mass_kg']} in the scene")
                inertia = UsdPhysics.MassAPI(own_body).GetDiagonalInertiaAttr().Get()
                if min(inertia) <= 0 or sum(inertia) < 2 * max(inertia) * (1 - 1e-4):
                    problems.append(f"{o['id']}: inertia {inertia} is none of a body")
            own = [p for p in shapes if p.startswith(f"{own_body.GetPath()}/collision/")]
            if len(own) != body["hulls"]:
                problems.append(f"{o['id']}: {len(own)} colliders, {body['hulls']} in the scene")
            for p in own:
                material = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(p)).ComputeBoundMaterial("physics")[0]
                api = UsdPhysics.MaterialAPI(material.GetPrim())
                friction, restitution = api.GetStaticFrictionAttr().Get(), api.GetRestitutionAttr().Get()
                if abs(friction - body["friction"]) > 1e-3 or abs(restitution - body["restitution"]) > 1e-3:
                    problems.append(f"{o['id']}: friction {friction}, restitution {restitution}")
                    break
            # Place by USD's own transforms: the origin, and the front a metre before it.
            matrix = UsdGeom.XformCache().GetLocalToWorldTransform(prim)
            yaw = o["pose"]["yaw"]
            at = o["pose"]["position"]
            front = (at[0] + math.sin(yaw), at[1], at[2] + math.cos(yaw))
            for point, wanted in (((0, 0, 0), at), (z_up((0, 0, 1)), front)):
                found = matrix.Transform(Gf.Vec3d(*point))
                if max(abs(a - b) for a, b in zip(found, z_up(wanted))) > 1e-4:
                    problems.append(f"{o['id']}: {tuple(found)} instead of {z_up(wanted)}")
            # Its meshes without the light that it may carry.
            box = Gf.Range3d()
            for p in Usd.PrimRange(prim):
                if p.IsA(UsdGeom.Mesh):
                    box.UnionWith(cache.ComputeRelativeBound(p, prim).ComputeAlignedRange())
            size = box.GetSize()
            hull = guides.ComputeUntransformedBound(prim).ComputeAlignedRange().GetSize()
            wanted = (o["size"]["width"], o["size"]["depth"], o["size"]["height"])
            if any(abs(a - b) > max(0.02, 0.05 * b) for a, b in zip(size, wanted)):
                problems.append(f"{o['id']}: {tuple(size)} m instead of {wanted}")
            # What gives way (a rug) touches nothing, and has none.
            if own and any(abs(a - b) > max(0.03, 0.06 * max(size)) for a, b in zip(hull, size)):
                problems.append(f"{o['id']}: colliders of {tuple(hull)} m around {tuple(size)} m")
        lights = [p for p in stage.Traverse() if p.HasAPI(UsdLux.LightAPI) and not p.IsA(UsdLux.DomeLight)]
        if len(lights) != len(scene["lighting"]["lights"]):
            problems.append(f"{len(lights)} lights")
        problems += light_problems(lights, scene)
        problems += camera_problems(stage, scene)
        textures = [p for p in stage.Traverse() if p.IsA(UsdShade.Shader) and UsdShade.Shader(p).GetIdAttr().Get() == "UsdUVTexture"]
        for p in textures:
            asset = UsdShade.Shader(p).GetInput("file").Get()
            if not asset.resolvedPath:
                problems.append(f"{p.GetPath()}: {asset.path} is not there")
        print(
            f"{path.name}: {len(issues)} issues of {len(validators)} validators, {len(scene['objects'])} objects, "
            f"{len(rigid)} rigid bodies, {len(joints)} joints, {len(shapes)} convex colliders, {len(lights)} lights, {len(textures)} textures"
        )
        for problem in problems:
            print(f"  {problem}")
        bad += bool(problems)
    return 1 if bad or not files else 0


def joint_problems(stage, manifest, joints):
    """Every part that opens has one joint with limits, closed at 0, at one place of both bodies."""
    from pxr import UsdPhysics

    out = []
    wanted = sorted(f"{p}_joint" for parts in manifest["opens"].values() for p in parts)
    if sorted(p.rsplit("/", 1)[1] for p in joints) != wanted:
        out.append(f"joints {sorted(joints)} instead of {wanted}")
    for path in joints:
        prim = stage.GetPrimAtPath(path)
        turns = prim.IsA(UsdPhysics.RevoluteJoint)
        joint = UsdPhysics.RevoluteJoint(prim) if turns else UsdPhysics.PrismaticJoint(prim)
        low, high = joint.GetLowerLimitAttr().Get(), joint.GetUpperLimitAttr().Get()
        if not low <= 0 <= high or not 0.05 < high - low < (181 if turns else 2):
            out.append(f"{path}: limits {low} to {high}")
        if joint.GetAxisAttr().Get() != ("Z" if turns else "Y") and not (turns and joint.GetAxisAttr().Get() == "X"):
            out.append(f"{path}: axis {joint.GetAxisAttr().Get()}")
        if joint.GetLocalPos0Attr().Get() != joint.GetLocalPos1Attr().Get():
            out.append(f"{path}: it does not stand closed")
    return out


def light_problems(prims, scene):
    """Places and directions of lights by USD's own transforms; what moves has its light below it."""
    from pxr import Gf, UsdGeom

    out, cache = [], UsdGeom.XformCache()
    by_name = {p.GetName(): p for p in prims}
    for light in scene["lighting"]["lights"]:
        prim = by_name.get(light["id"])
        if prim is None:
            out.append(f"the light {light['id']} is missing")
            continue
        matrix = cache.GetLocalToWorldTransform(prim)
        if max(abs(a - b) for a, b in zip(matrix.ExtractTranslation(), z_up(light["position"]))) > 1e-4:
            out.append(f"the light {light['id']} is at {matrix.ExtractTranslation()}")
        if light["kind"] != "point":
            length = math.dist(light["direction"], (0, 0, 0))
            found = matrix.TransformDir(Gf.Vec3d(0, 0, -1))
            if max(abs(a - b / length) for a, b in zip(found, z_up(light["direction"]))) > 1e-4:
                out.append(f"the light {light['id']} shines along {found}")
    return out


def camera_problems(stage, scene):
    """USD's own frustum against the scene's camera, at places of the room."""
    from pxr import Gf, UsdGeom

    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/camera")).GetCamera()
    frustum = camera.frustum
    view = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    c = scene["camera"]
    k, size = c["intrinsics"], c["size"]
    out = []
    e = scene["room"]["extents"]
    for share in ((0.3, 0.2, 0.1), (0.7, 0.6, 0.1), (0.5, 0.4, 0.3)):
        p = (e["width"] * share[0], e["height"] * share[1], e["depth"] * share[2])
        ours = [sum(r[i] * p[i] for i in range(3)) + t for r, t in zip(c["rotation"], c["translation"])]
        if ours[2] <= 0:
            continue
        pixel = (k["fx"] * ours[0] / ours[2] + k["cx"], k["fy"] * ours[1] / ours[2] + k["cy"])
        ndc = view.Transform(Gf.Vec3d(*z_up(p)))
        found = ((ndc[0] + 1) / 2 * size["width"], (1 - ndc[1]) / 2 * size["height"])
        if max(abs(a - b) for a, b in zip(pixel, found)) > 0.05:
            out.append(f"the camera sees {p} at {found} instead of {pixel}")
    return out


# ---------------------------------------------------------------- MuJoCo


def load(path):
    """A model, and what MuJoCo warned of while it was made."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    model = spec.compile()
    said = getattr(spec, "warning", "") or getattr(spec, "error", "") or ""
    return model, [said] if said else []


def mujoco_files(folder):
    import mujoco

    warned, problems = [], []
    files = sorted([*folder.rglob("mjcf/scene.xml"), *folder.rglob("mjcf/objects/*.xml"), *folder.rglob("*.urdf")])
    warnings.simplefilter("error")
    for path in files:
        try:
            model, said = load(path)
        except Exception as e:  # whatever it is, it is about this file
            problems.append(f"{path.name}: {e}")
            continue
        warned += [f"{path.name}: {w}" for w in said]
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        warned += [f"{path.name}: {data.warning[i].number} x warning {i}" for i in range(len(data.warning)) if data.warning[i].number]
        if path.name != "scene.xml":
            continue
        scene, manifest = run_scene(path)
        bodies = {b["id"]: b for b in manifest["bodies"]}
        for o in scene["objects"]:
            name = o["id"]
            b = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if b < 0:
                problems.append(f"{name} is missing")
                continue
            # Parts that open are bodies below it.
            mass = model.body_subtreemass[b]
            if abs(mass - bodies[name]["mass_kg"]) > 1e-3 * bodies[name]["mass_kg"]:
                problems.append(f"{name}: {mass} kg instead of {bodies[name]['mass_kg']}")
            parts = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, c) for c in range(model.nbody) if model.body_parentid[c] == b and c != b]
            if sorted(parts) != sorted(manifest["opens"].get(name, [])):
                problems.append(f"{name}: opens {parts}")
            if max(abs(a - c) for a, c in zip(data.xpos[b], z_up(o["pose"]["position"]))) > 1e-4:
                problems.append(f"{name}: at {data.xpos[b]}")
            # Its front, MuJoCo's rotation of the body's -Y.
            yaw, rotation = o["pose"]["yaw"], data.xmat[b].reshape(3, 3)
            front = z_up((math.sin(yaw), 0, math.cos(yaw)))
            if max(abs(-rotation[k][1] - front[k]) for k in range(3)) > 1e-4:
                problems.append(f"{name}: its front is {-rotation[:, 1]} instead of {front}")
            if (model.body_jntnum[b] > 0) != bodies[name]["dynamic"]:
                problems.append(f"{name}: {model.body_jntnum[b]} joints")
            collide = [g for g in range(model.ngeom) if model.geom_bodyid[g] == b and model.geom_contype[g]]
            if len(collide) != bodies[name]["hulls"]:
                problems.append(f"{name}: {len(collide)} colliders")
            if any(abs(model.geom_friction[g][0] - bodies[name]["friction"]) > 1e-3 for g in collide):
                problems.append(f"{name}: friction {[model.geom_friction[g][0] for g in collide]}")
        for light in scene["lighting"]["lights"]:
            k = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_LIGHT, light["id"])
            if k < 0:
                problems += [f"the light {light['id']} is missing"] if light["on"] else []
                continue
            if max(abs(a - b) for a, b in zip(data.light_xpos[k], z_up(light["position"]))) > 1e-3:
                problems.append(f"the light {light['id']} is at {data.light_xpos[k]}")
            owner = next((o for o in scene["objects"] if o["id"] == light.get("object")), None)
            carried = owner is not None and bodies[owner["id"]]["dynamic"]
            of = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, model.light_bodyid[k])
            if carried and of != owner["id"]:
                problems.append(f"the light {light['id']} belongs to {of}")
            if light["kind"] != "point":
                length = math.dist(light["direction"], (0, 0, 0))
                wanted = [v / length for v in z_up(light["direction"])]
                if max(abs(a - b) for a, b in zip(data.light_xdir[k], wanted)) > 1e-3:
                    problems.append(f"the light {light['id']} shines along {data.light_xdir[k]}")
        print(f"{path.name}: {model.nbody} bodies, {model.ngeom} geoms, {model.nmesh} meshes, {model.ntex} textures")
    print(f"mujoco: {len(files)} files, {len(warned)} warnings")
    for line in warned + problems:
        print(f"  {line}")
    return 1 if warned or problems or not files else 0


def settle(folder):
    import mujoco
    import numpy as np

    for path in sorted(folder.rglob("mjcf/scene.xml")):
        model, _ = load(path)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        start = {b: (data.xpos[b].copy(), data.xmat[b].reshape(3, 3).copy()) for b in range(1, model.nbody)}
        deepest = min((c.dist for c in data.contact), default=0.0)
        while data.time < 5.0:
            mujoco.mj_step(model, data)
        free = mujoco.mjtJoint.mjJNT_FREE
        moving = [b for b in range(1, model.nbody) if model.body_jntnum[b] and model.jnt_type[model.body_jntadr[b]] == free]
        stable = 0
        for b in moving:
            at, turn = start[b]
            drift = float(np.linalg.norm(data.xpos[b] - at))
            tilt = math.degrees(math.acos(max(-1.0, min(1.0, float((data.xmat[b].reshape(3, 3) @ turn.T)[2, 2])))))
            fine = drift <= 0.01 and tilt <= 2.0
            stable += fine
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, b)
            print(f"  {name}: {drift * 100:.2f} cm, {tilt:.2f} deg{'' if fine else '  MOVED'}")
        print(f"{path.parent.parent}: {stable} of {len(moving)} stand after 5 s, deepest contact before {-deepest * 1000:.1f} mm")
    return 0


# ---------------------------------------------------------------- DXF


def dxf(folder):
    import ezdxf
    from ezdxf import bbox

    bad = 0
    files = sorted(folder.rglob("*.dxf"))
    for path in files:
        doc = ezdxf.readfile(path)
        audit = doc.audit()
        space = doc.modelspace()
        problems = [str(e.message) for e in audit.errors]
        layers = {e.dxf.layer for e in space}
        unknown = [l for l in layers if l not in doc.layers]
        if unknown:
            problems.append(f"layers {unknown} are not in the table")
        dimensions = list(space.query("DIMENSION"))
        scene, _ = run_scene(path)
        e = scene["room"]["extents"]
        if path.name == "floor_plan.dxf":
            walls = bbox.extents(space.query('*[layer ? "WALLS.*"]'))
            wanted = (e["width"] + 0.24, e["depth"] + 0.24)
            if any(abs(a - b) > 1e-3 for a, b in zip(walls.size, wanted)):
                problems.append(f"walls of {walls.size} m instead of {wanted}")
            lengths = [round(math.dist(d.dxf.defpoint2, d.dxf.defpoint3), 3) for d in dimensions]
            for side in ("width", "depth"):
                if not any(abs(l - e[side]) < 2e-3 for l in lengths):
                    problems.append(f"no dimension says the {side} of {e[side]} m: {lengths}")
        print(f"{path.name}: {len(audit.errors)} errors, {len(list(space))} entities, {len(dimensions)} dimensions, {len(layers)} layers")
        for problem in problems:
            print(f"  {problem}")
        bad += bool(problems)
    return 1 if bad or not files else 0


JUDGES = {"usd": usd, "mujoco": mujoco_files, "settle": settle, "dxf": dxf}

if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in JUDGES:
        print(__doc__)
        sys.exit(2)
    sys.exit(JUDGES[sys.argv[1]](pathlib.Path(sys.argv[2]).resolve()))
