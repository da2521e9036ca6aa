"""Random weights that Python and Rust make alike from a key and a shape, so that no weight file has to be kept.

Value i of tensor KEY is `centre + spread * u`, u = uniform in [-1, 1) from SplitMix64 over FNV-1a(KEY) and i.
Rust: `tests/image_nets/seeded.rs`.
"""

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def fnv1a(key: str) -> int:
    h = 0xCBF29CE484222325
    for byte in key.encode():
        h = ((h ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return h


def uniform(key: str, shape) -> np.ndarray:
    """float32 in [-1, 1)."""
    count = int(np.prod(shape, dtype=np.int64))
    with np.errstate(over="ignore"):
        z = np.uint64(fnv1a(key)) + GOLDEN * np.arange(1, count + 1, dtype=np.uint64)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return ((z >> np.uint64(40)).astype(np.float32) / np.float32(1 << 23) - np.float32(1)).reshape(shape)


def tensor(key: str, shape, factor=1.0) -> np.ndarray:
    """A weight whose layer keeps the size of its input, or `factor` times that: matrices and filters by fan-in, norms
    about one."""
    shape = tuple(shape)
    u = uniform(key, shape)
    if len(shape) >= 2:
        fan_in = max(int(np.prod(shape[1:], dtype=np.int64)), 1)
        return u * (np.float32(np.sqrt(3.0 / fan_in)) * np.float32(factor))
    if len(shape) == 1 and key.endswith(".weight"):
        return np.float32(1) + np.float32(0.1) * u
    return np.float32(0.1) * u


def state(shapes: dict) -> dict:
    return {key: tensor(key, shape) for key, shape in shapes.items()}


def fill(module, rename=lambda key: key, special=None):
    """Overwrites every floating point entry of a torch module's state and returns what was set, by key."""
    import torch

    filled = {}
    for key, value in module.state_dict().items():
        if not value.is_floating_point():
            filled[key] = value
            continue
        array = (special or {}).get(key)
        array = tensor(rename(key), value.shape) if array is None else array
        filled[key] = torch.from_numpy(np.ascontiguousarray(array)).reshape(value.shape)
    module.load_state_dict(filled, strict=True)
    return filled


def turns(run):
    """Calls `run` once for each line on stdin and answers each with a line: wall-clock and processor time, peak memory."""
    import resource
    import sys
    import time

    import torch

    with torch.inference_mode():
        for _ in sys.stdin:
            cpu, wall = time.process_time(), time.perf_counter()
            run()
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f"torch {wall:.3f} s, {cpu:.2f} CPU-s, peak {peak:.0f} MiB", flush=True)


def versions(*modules) -> dict:
    """Metadata for a file of arrays."""
    import platform

    found = {"python": platform.python_version(), "numpy": np.__version__}
    for module in modules:
        found[module.__name__] = getattr(module, "__version__", "?")
    return found
