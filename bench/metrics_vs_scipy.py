"""Compares our metrics with SciPy and Pillow on the files of a folder, and times the nearest-neighbour search.

Usage: metrics_vs_scipy.py FOLDER METRICS_BENCH_PROGRAM [ROUNDS]
       metrics_vs_scipy.py --record    (prints the expected values of crates/harmony-bench/tests/it/metrics_scipy.rs)

Both programs run in turns within one run of this script, so that both see the same load. The peer is
scipy.spatial.cKDTree, built with its defaults and asked with two workers; a tree without balancing, which builds
faster, is timed as well.
"""

import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import PIL
import scipy
from PIL import Image
from scipy.spatial import cKDTree

THRESHOLDS = [0.1, 0.01, 0.001]
SIZES = [(224, 224), (97, 311), (640, 480), (500, 100), (1, 1)]
TOLERANCE = 1e-6
WORKERS = 2


def both_ways(prediction, truth):
    from_prediction, _ = cKDTree(truth).query(prediction, workers=WORKERS)
    from_truth, _ = cKDTree(prediction).query(truth, workers=WORKERS)
    return from_prediction, from_truth


def gen3dsr(from_prediction, from_truth):
    numbers = {"chamfer": (from_truth.mean() + from_prediction.mean()) / 2}
    for t in THRESHOLDS:
        precision = 100.0 * (from_prediction < t).mean()
        recall = 100.0 * (from_truth < t).mean()
        numbers[f"precision {t}"], numbers[f"recall {t}"] = precision, recall
        numbers[f"f1 {t}"] = 2.0 * precision * recall / (precision + recall + 1e-6)
    return numbers


def midi(prediction, truth):
    d1, d2 = both_ways(prediction, truth)
    precision, recall = (d1 < 0.1).mean(), (d2 < 0.1).mean()
    return {
        "chamfer": (d1**2).mean() + (d2**2).mean(),
        "precision": precision,
        "recall": recall,
        "f1": 2 * precision * recall / (precision + recall + 1e-8),
    }


def normalised(prediction, truth):
    low, high = truth.min(0), truth.max(0)
    centre, half = (low + high) / 2, (high - low).max() / 2
    return (prediction - centre) / half, (truth - centre) / half


class Check:
    worst = 0.0
    failed = 0

    def number(self, name, ours, peer):
        difference = abs(ours - peer)
        good = difference <= TOLERANCE
        self.failed += not good
        self.worst = max(self.worst, difference)
        print(f"{name:28s} ours {ours:.9f}  peer {peer:.9f}  differ by {difference:.1e}{'' if good else '  TOO FAR'}")


def compare(folder, program, prediction, truth):
    ours = json.loads(subprocess.run([program, "score", folder], check=True, capture_output=True, text=True).stdout)
    check = Check()
    from_prediction, from_truth = both_ways(prediction, truth)
    for name, peer in (("from_prediction", from_prediction), ("from_truth", from_truth)):
        check.number(f"{name}, worst of {len(peer)}", np.abs(np.fromfile(folder / f"{name}.f64", "<f8") - peer).max(), 0)
    flat = {"chamfer": ours["gen3dsr"]["chamfer"]}
    for at in ours["gen3dsr"]["at"]:
        flat |= {f"{key} {at['threshold']}": at[key] for key in ("precision", "recall", "f1")}
    for name, peer in gen3dsr(from_prediction, from_truth).items():
        check.number(f"gen3dsr {name}", flat[name], peer)

    steps = ours["midi_step"]
    moving, still = normalised(prediction[:: steps[0]], truth[:: steps[1]])
    motion = ours["midi"]["icp"]["target_from_source"]
    rotation = np.array(motion["rotation"]).reshape(3, 3).T  # column by column
    moved = moving @ rotation.T + motion["translation"]
    for name, key, points in (("before ICP", "before_icp", moving), ("after our ICP", "score", moved)):
        flat = ours["midi"][key]["f_score"] | {"chamfer": ours["midi"][key]["chamfer"]}
        for number, peer in midi(points, still).items():
            check.number(f"midi {name} {number}", flat[number], peer)
    print(f"ICP: {ours['midi']['icp']['iterations']} rounds, settled: {ours['midi']['icp']['converged']}")

    render, target = (Image.open(folder / f"{name}.png").convert("RGB") for name in ("render", "target"))
    for size in SIZES + [render.size]:
        resized = np.asarray(target.resize(size, Image.Resampling.BICUBIC), int)
        mine = np.asarray(Image.open(folder / f"resized_{size[0]}x{size[1]}.png"), int)
        check.number(f"resized to {size[0]} x {size[1]}, worst", np.abs(resized - mine).max(), 0)
    pixels = np.asarray(render, float) / 255 - resized / 255
    check.number("pixel loss", ours["pixel_loss"], (pixels**2).mean())
    return check


def peer_seconds(prediction, truth, **options):
    start = time.perf_counter()
    tree = cKDTree(truth, **options)
    built = time.perf_counter()
    tree.query(prediction, workers=WORKERS)
    return built - start, time.perf_counter() - built


def measure(folder, program, prediction, truth, rounds):
    names = ("cKDTree", "cKDTree, not balanced", "ours")
    seconds = {name: [] for name in names}
    for _ in range(rounds):
        seconds[names[0]].append(peer_seconds(prediction, truth))
        seconds[names[1]].append(peer_seconds(prediction, truth, balanced_tree=False))
        text = subprocess.run([program, "time", folder, "3"], check=True, capture_output=True, text=True).stdout
        runs = [tuple(float(v) for v in line.split()) for line in text.splitlines()]
        seconds[names[2]].append(sorted(runs, key=sum)[1])
    totals = {name: [sum(v) for v in values] for name, values in seconds.items()}
    print(f"\n{len(prediction)} queries against {len(truth)} points, {rounds} rounds; load", os.getloadavg())
    for name, values in seconds.items():
        build, query = (statistics.median(v) for v in zip(*values))
        print(f"{name:22s} build {build:.3f} s  query {query:.3f} s (medians)"
              f"   both min {min(totals[name]):.3f}  median {statistics.median(totals[name]):.3f}")
    for name in names[:2]:
        ratios = [peer / mine for peer, mine in zip(totals[name], totals["ours"])]
        print(f"{name} / ours: {min(totals[name]) / min(totals['ours']):.1f} (min / min)  "
              f"{statistics.median(totals[name]) / statistics.median(totals['ours']):.1f} (median / median)  "
              f"rounds {min(ratios):.1f} to {max(ratios):.1f}")


def record():
    """The point sets of the Rust test: exact in binary, with ties, an empty corner and a far point."""
    i = np.arange(3000)
    truth = np.stack([i * 37 % 101, i * 53 % 67, i * 29 % 43], 1) / 64.0
    i = np.arange(2000)
    prediction = np.stack([i * 41 % 97, i * 59 % 71, i * 31 % 47], 1) / 64.0 + [0.125, 0.0078125, 0.0]
    prediction[7] = [40.0, -3.0, 9.0]
    numbers = gen3dsr(*both_ways(prediction, truth))
    before = midi(*normalised(prediction, truth))
    for name, value in (numbers | {f"midi {k}": v for k, v in before.items()}).items():
        print(f"{name:20s} {float(value)!r}")


def main():
    if sys.argv[1] == "--record":
        return record()
    folder, program = Path(sys.argv[1]), sys.argv[2]
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    prediction, truth = (np.fromfile(folder / f"{name}.f64", "<f8").reshape(-1, 3) for name in ("prediction", "truth"))
    print("numpy", np.__version__, "scipy", scipy.__version__, "pillow", PIL.__version__, "load", os.getloadavg())
    check = compare(folder, program, prediction, truth)
    measure(folder, program, prediction, truth, rounds)
    print(f"\n{check.failed} numbers differ by more than {TOLERANCE}; the worst by {check.worst:.1e}")
    return 1 if check.failed else 0


if __name__ == "__main__":
    sys.exit(main())
