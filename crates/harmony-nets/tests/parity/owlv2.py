"""OWLv2 (transformers' Owlv2ForObjectDetection and its image processor) with seeded random weights.

Usage: owlv2.py small OUT.safetensors        the little arrays of tests/it/detector.rs
       owlv2.py preprocess OUT.safetensors   the image processor (torchvision backend) on small pictures
       owlv2.py full SIZE FOLDER             SIZE = base, large: model.safetensors, inputs and outputs
       owlv2.py turns SIZE FOLDER            one image with four phrases on two threads, once for each line on stdin

Packages: torch torchvision transformers safetensors pillow.
"""

import os
import sys

import numpy as np
import torch

import seeded
from clip import photo


def config(size):
    from transformers import Owlv2Config

    if size == "small":
        return Owlv2Config(
            text_config=dict(vocab_size=60, hidden_size=24, intermediate_size=96, num_hidden_layers=2, num_attention_heads=3,
                             max_position_embeddings=16),
            vision_config=dict(hidden_size=32, intermediate_size=128, num_hidden_layers=2, num_attention_heads=2,
                               image_size=48, patch_size=8),
            projection_dim=24,
        )
    if size == "base":  # google/owlv2-base-patch16-ensemble
        return Owlv2Config(text_config={}, vision_config=dict(image_size=960), projection_dim=512)
    return Owlv2Config(  # google/owlv2-large-patch14-ensemble
        text_config=dict(hidden_size=768, intermediate_size=3072, num_attention_heads=12),
        vision_config=dict(hidden_size=1024, intermediate_size=4096, num_hidden_layers=24, num_attention_heads=16,
                           image_size=1008, patch_size=14),
        projection_dim=768,
    )


def build(size):
    from transformers import Owlv2ForObjectDetection

    model = Owlv2ForObjectDetection(config(size)).eval()
    special = {k: np.float32(0.5) * seeded.uniform(k, tuple(v.shape)) for k, v in model.state_dict().items() if "embedding" in k and "patch" not in k}
    special["owlv2.logit_scale"] = np.array(2.6592, np.float32)
    return model, seeded.fill(model, special=special)


def save(path, arrays, *modules):
    import safetensors
    import safetensors.numpy
    import transformers

    arrays = {k: np.ascontiguousarray(np.asarray(v)) for k, v in arrays.items()}
    safetensors.numpy.save_file(arrays, path, metadata=seeded.versions(torch, transformers, safetensors, *modules))


def phrases(size):
    """Token ids with bos, eos and pads of zero, and their mask."""
    bos, eos = (58, 59) if size == "small" else (49406, 49407)
    rows = np.zeros((4, 16), np.int64)
    for row, length in enumerate((1, 3, 6, 14)):
        inner = ((seeded.uniform(f"ids{row}", (length,)) + 1) * 0.5 * (bos - 2)).astype(np.int64) + 1
        rows[row, : length + 2] = [bos, *inner, eos]
    ids = torch.from_numpy(rows)
    return ids, (ids > 0).long()


def pixels_of(model):
    side = model.config.vision_config.image_size
    return torch.from_numpy(seeded.uniform("pixels0", (1, 3, side, side)) * np.float32(1.7))


@torch.no_grad()
def record(model, size):
    ids, mask = phrases(size)
    out = model(input_ids=ids, pixel_values=pixels_of(model), attention_mask=mask)
    kept = {
        "logits": out.logits[0], "boxes": out.pred_boxes[0], "objectness": out.objectness_logits[0],
        "text_embeds": out.text_embeds[0], "class_embeds": out.class_embeds[0], "ids": ids.to(torch.int32),
    }
    if size == "small":
        kept["features"] = out.image_embeds[0]
        kept["vision.last"] = out.vision_model_output[0][0]
    return {k: v.numpy() for k, v in kept.items()}


def main():
    torch.set_num_threads(2)
    mode = sys.argv[1]
    if mode == "small":
        model, _ = build("small")
        save(sys.argv[2], record(model, "small"))
    elif mode == "full":
        size, folder = sys.argv[2], sys.argv[3]
        model, state = build(size)
        os.makedirs(folder, exist_ok=True)
        save(f"{folder}/model.safetensors", {k: v.numpy() for k, v in state.items()})
        save(f"{folder}/owlv2_{size}.safetensors", record(model, size))
    elif mode == "preprocess":
        import PIL
        import torchvision
        from transformers.models.owlv2.image_processing_owlv2 import Owlv2ImageProcessor

        processor = Owlv2ImageProcessor(size={"height": 32, "width": 32})
        arrays = {}
        for name, (w, h) in {"wide": (97, 61), "tall": (40, 93), "grow": (21, 13), "slight": (35, 30)}.items():
            out = processor(PIL.Image.fromarray(photo(w, h)), return_tensors="np")["pixel_values"][0]
            arrays[name] = out.transpose(1, 2, 0).astype(np.float32)
        save(sys.argv[2], arrays, PIL, torchvision)
    elif mode == "turns":
        from safetensors.torch import load_file
        from transformers import Owlv2ForObjectDetection

        model = Owlv2ForObjectDetection(config(sys.argv[2])).eval()
        model.load_state_dict(load_file(f"{sys.argv[3]}/model.safetensors"), assign=True)
        ids, mask = phrases(sys.argv[2])
        pixels = pixels_of(model)
        seeded.turns(lambda: model(input_ids=ids, pixel_values=pixels, attention_mask=mask))
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
