"""Tiny weight files as PyTorch writes them, for the tests of the loaders (Python 3.11, torch 2.11.0, safetensors 0.7).

    python make_weights.py OUT

Every file holds a = arange(6) as f32 (2, 3), b = [1.5, -2] as bf16, c = [0.25] as f16, t = a transposed (not contiguous),
i = [7] as i64.
"""

import collections
import os
import sys

import torch
from safetensors.torch import save_file

out = sys.argv[1]
a = torch.arange(6, dtype=torch.float32).reshape(2, 3)
tensors = collections.OrderedDict(
    a=a, b=torch.tensor([1.5, -2.0], dtype=torch.bfloat16), c=torch.tensor([0.25], dtype=torch.float16),
    t=a.t(), i=torch.tensor([7]))
torch.save(tensors, os.path.join(out, "weights_zip.pt"))
torch.save(tensors, os.path.join(out, "weights_legacy.pth"), _use_new_zipfile_serialization=False)
torch.save({"model": tensors, "epoch": 3, "lr": 1e-4, "names": ["x", None, True]}, os.path.join(out, "weights_nested.pt"))
torch.save({"a": torch.nn.Parameter(a)}, os.path.join(out, "weights_parameter.pt"))
save_file({k: v.contiguous() for k, v in tensors.items()}, os.path.join(out, "weights.safetensors"))


class Evil:
    def __reduce__(self):
        return os.system, ("echo this must never be printed",)


torch.save({"a": a, "evil": Evil()}, os.path.join(out, "weights_evil.pt"))
