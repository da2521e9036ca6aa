"""Reads a released data set with the libraries that others use: pyarrow, tarfile, json, hashlib. Shares no code with what
wrote it, and ends with 1 when anything does not fit together.

    python tools/read_dataset.py RELEASE
"""
import csv
import hashlib
import json
import pathlib
import struct
import sys
import tarfile

import pyarrow.parquet as pq

root = pathlib.Path(sys.argv[1])
problems = []


def expect(condition, what):
    if not condition:
        problems.append(what)


def png_size(data):
    expect(data[:8] == b"\x89PNG\r\n\x1a\n", "no PNG")
    return struct.unpack(">II", data[16:24])


# Hashes: every file but the list itself, and no other.
sums = dict(reversed(line.split("  ", 1)) for line in (root / "SHA256SUMS").read_text().splitlines())
there = {str(p.relative_to(root)) for p in root.rglob("*") if p.is_file()} - {"SHA256SUMS"}
expect(set(sums) == there, f"SHA256SUMS and the folder differ: {set(sums) ^ there}")
for path, digest in sums.items():
    expect(hashlib.sha256((root / path).read_bytes()).hexdigest() == digest, f"hash of {path}")

index = pq.read_table(root / "index.parquet")
objects = pq.read_table(root / "objects.parquet")
scenes = index.to_pylist()
rows = objects.to_pylist()
with open(root / "sources.csv", newline="") as file:
    sources = {f"{r['split']}/{r['name']}": r for r in csv.DictReader(file)}
expect({s["scene"] for s in scenes} == set(sources), "index and sources.csv name other scenes")

for scene in scenes:
    folder = root / scene["scene"]
    mine = [r for r in rows if r["scene"] == scene["scene"]]
    annotated = json.loads((folder / "objects.json").read_text())["objects"]
    expect([o["id"] for o in annotated] == [r["id"] for r in mine], f"objects of {scene['scene']}")
    for o, r in zip(annotated, mine):
        expect(o["size_m"]["width"] == r["width_m"] and o["position_m"] == [r["x_m"], r["y_m"], r["z_m"]], f"numbers of {o['id']}")
        expect((o["on_top_of"] or "") == r["on_top_of"] and o["type"] == r["type"], f"words of {o['id']}")
        expect(r["mask"] == "" or (root / r["mask"]).is_file(), f"mask {r['mask']}")
    counts = {s: sum(o["stage"] == s for o in annotated) for s in ("furniture", "wall-mounted", "ceiling", "decoration")}
    expect(counts == {"furniture": scene["furniture"], "wall-mounted": scene["wall_mounted"], "ceiling": scene["ceiling"],
                      "decoration": scene["decoration"]}, f"stages of {scene['scene']}")
    camera = json.loads((folder / "camera.json").read_text())
    expect(abs(camera["K"][0][0] - scene["fx"]) < 1e-9 and camera["width"] == scene["width"], f"camera of {scene['scene']}")
    expect(png_size((root / scene["segmentation"]).read_bytes()) == (scene["width"], scene["height"]), "segmentation's size")
    expect((root / scene["glb"]).read_bytes()[:4] == b"glTF", "scene.glb")
    published = sources[scene["scene"]]["redistributable"] == "yes"
    expect(published == scene["redistributable"] == bool(scene["photo"]), f"photo of {scene['scene']}")
    expect(not published or (root / scene["photo"]).is_file(), f"{scene['photo']} is not there")
    expect(published or not list(folder.glob("photo.*")), f"photo of {scene['scene']} is there")

# Shards: the files of each scene side by side, under one key, byte for byte.
shards = sorted((root / "shards").glob("*.tar"))
seen = {}
for path in shards:
    last = None
    with tarfile.open(path) as tar:
        for member in tar:
            key, rest = member.name.split(".", 1)
            expect(key == last or key not in seen, f"{key} is scattered in {path.name}")
            last = key
            expect((member.mtime, member.uid, member.gid, member.uname) == (0, 0, 0, ""), f"{member.name} tells of a machine")
            seen.setdefault(key, {})[rest] = hashlib.sha256(tar.extractfile(member).read()).hexdigest()
wanted = {}
for path, digest in sums.items():
    parts = path.split("/")
    if parts[0] in ("easy", "medium", "complicated"):
        wanted.setdefault(f"{parts[0]}-{parts[1]}", {})[".".join(parts[2:])] = digest
expect(seen == wanted, "shards hold other files than the folders")

# Croissant: the files that it names have the hashes that it says, its fields are the tables' columns.
croissant = json.loads((root / "croissant.json").read_text())
expect(croissant["@type"] == "sc:Dataset" and croissant["conformsTo"] == "http://mlcommons.org/croissant/1.0", "croissant's head")
tables = {"index.parquet": index, "objects.parquet": objects}
for file in croissant["distribution"]:
    expect(sums[file["@id"]] == file["sha256"], f"croissant's hash of {file['@id']}")
for record_set in croissant["recordSet"]:
    columns = [f["source"]["extract"]["column"] for f in record_set["field"]]
    table = tables[record_set["field"][0]["source"]["fileObject"]["@id"]]
    expect(columns == table.column_names, f"croissant's columns of {record_set['name']}")
    kinds = {"string": "sc:Text", "int64": "sc:Integer", "double": "sc:Float", "bool": "sc:Boolean"}
    for field, column in zip(record_set["field"], table.schema):
        expect(field["dataType"] == kinds[str(column.type)], f"croissant's type of {column.name}")

# Where the reference implementation is installed, it judges too.
try:
    import mlcroissant
except ImportError:
    print("mlcroissant is not installed: its check is left out")
else:
    dataset = mlcroissant.Dataset(jsonld=str(root / "croissant.json"))
    expect(not dataset.metadata.ctx.issues.errors, f"mlcroissant: {dataset.metadata.ctx.issues.errors}")

for problem in problems:
    print("problem:", problem)
print(f"{len(scenes)} scenes, {len(rows)} objects, {len(shards)} shards, {len(problems)} problems")
sys.exit(1 if problems else 0)
