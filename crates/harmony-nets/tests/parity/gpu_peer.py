"""The networks' authors' code on a GPU: the peer of `cuda_check time` and `image_nets time .. cuda`.

    gpu_peer.py vggt REFERENCE FOLDER COUNT..    VGGT-1B on so many photos, eager, bf16 autocast, heads f32 (PyTorch's defaults)
    gpu_peer.py compiled REFERENCE FOLDER        VGGT-1B on one photo: blocks and dense heads by torch.compile, a CUDA graph
    gpu_peer.py sam2 FOLDER                      SAM 2.1 large, 30 boxes (SAM2_REPO = a checkout of facebookresearch/sam2)
    gpu_peer.py owlv2 SIZE FOLDER                OWLv2 with 4 and 32 phrases
    gpu_peer.py clip FOLDER                      CLIP ViT-B/32, 1 and 16 images

FOLDER holds what `make_vggt.py full`, `sam2.py full large`, `owlv2.py full SIZE`, `clip.py full` left: weights and outputs
in f32. Prints medians in milliseconds between synchronisations, and each output's relative L2 error under bf16 autocast.
"""

import importlib.util
import os
import sys
import time

import numpy as np
import torch
from safetensors.torch import load_file

DEVICE = "cuda"


def median(run, rounds=10, warm=3):
    for _ in range(warm):
        run()
    torch.cuda.synchronize()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        run()
        torch.cuda.synchronize()
        times.append(time.perf_counter() - start)
    return sorted(times)[len(times) // 2] * 1e3


def l2(found, wanted):
    found, wanted = found.float().cpu().flatten(), torch.as_tensor(wanted).float().flatten()
    return ((found - wanted).norm() / wanted.norm()).item()


def say(name, ms):
    print(f"peer {name}: {ms:.2f} ms, {torch.cuda.max_memory_allocated() >> 20} MiB allocated at most", flush=True)


def autocast():
    return torch.autocast("cuda", dtype=torch.bfloat16)


def vggt_model(reference, folder):
    import make_vggt

    sys.path.insert(0, reference)
    model = make_vggt.full_model()
    model.load_state_dict(load_file(os.path.join(folder, "vggt_full_weights.safetensors")), assign=True)
    expected = load_file(os.path.join(folder, "vggt_full_expected.safetensors"))
    photo = expected["full.images"].permute(0, 3, 1, 2).contiguous().to(DEVICE)
    return model.to(DEVICE).eval(), photo, expected


def vggt(reference, folder, counts):
    model, photo, expected = vggt_model(reference, folder)
    with torch.inference_mode(), autocast():
        found = model(photo)
        for name in ("pose_enc", "depth", "depth_conf", "world_points", "world_points_conf"):
            print(f"peer vggt bf16 error {name}: {l2(found[name][0], expected['full.' + name]):.1e}")
        for count in map(int, counts):
            photos = photo.repeat(count, 1, 1, 1)
            torch.cuda.reset_peak_memory_stats()
            say(f"vggt {count} photos", median(lambda: model(photos), 10 if count <= 8 else 4))


def compiled(reference, folder):
    model, photo, expected = vggt_model(reference, folder)
    from vggt.layers import rope

    # The authors' code asks the GPU for the largest position in every block and makes one tensor on the host: neither can
    # be recorded. The largest position is a constant of the photo's size.
    largest = max(photo.shape[-2:]) // 14 + 1

    def turned(self, tokens, positions):
        tables = self._compute_frequency_components(tokens.size(-1) // 2, largest + 1, tokens.device, tokens.dtype)
        halves = enumerate(tokens.chunk(2, dim=-1))
        return torch.cat([self._apply_1d_rope(half, positions[..., i], *tables) for i, half in halves], dim=-1)

    rope.RotaryPositionEmbedding2D.forward = turned
    zeros = torch.zeros
    torch.zeros = lambda *sizes, **kinds: zeros(*sizes, **{"device": DEVICE, **kinds})
    with torch.inference_mode(), torch.autocast("cuda", dtype=torch.bfloat16, cache_enabled=False):
        model(photo)

        def recorded(name):
            stream = torch.cuda.Stream()
            stream.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(stream):
                for _ in range(3):
                    found = model(photo)
            torch.cuda.current_stream().wait_stream(stream)
            error = l2(found["depth"][0], expected["full.depth"])
            graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(graph):
                model(photo)
            say(f"vggt 1 photo {name}, depth error {error:.1e}", median(graph.replay, 20))

        recorded("recorded")
        # Weights cast once, not in every pass: the same arithmetic with fewer bytes to move.
        for part in (model.aggregator,):
            for module in part.modules():
                if isinstance(module, (torch.nn.Linear, torch.nn.Conv2d)):
                    module.to(torch.bfloat16)
        recorded("recorded, trunk weights bf16")
        start = time.perf_counter()
        for blocks in (model.aggregator.patch_embed.blocks, model.aggregator.frame_blocks, model.aggregator.global_blocks):
            for block in blocks:
                block.compile()
        for head in (model.depth_head, model.point_head):
            head._forward_impl = torch.compile(head._forward_impl)
        model(photo)
        print(f"peer compiling took {time.perf_counter() - start:.0f} s", flush=True)
        recorded("compiled and recorded")


def sam2(folder):
    # The script has the name of the authors' package.
    spec = importlib.util.spec_from_file_location("sam2_script", os.path.join(os.path.dirname(__file__), "sam2.py"))
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    model = script.build("large")
    model.load_state_dict(torch.load(f"{folder}/sam2.1_hiera_large.pt")["model"])
    model = model.to(DEVICE).eval()
    predictor = script.predictor_of(model)
    expected = load_file(f"{folder}/sam2_large.safetensors")
    columns, rows = np.meshgrid(np.arange(6), np.arange(5))
    x, y = columns.reshape(-1) * 200.0 + 20.0, rows.reshape(-1) * 180.0 + 30.0
    boxes = np.stack([x, y, x + 190.0, y + 160.0], -1)
    with torch.inference_mode(), autocast():
        for name, value in script.record(model, script.photo(480, 320), False).items():
            print(f"peer sam2_large bf16 error {name}: {l2(torch.as_tensor(value), expected[name]):.1e}")
        image = script.photo(1280, 960)
        pixels = predictor._transforms(image)[None]

        def encode():
            out = model.forward_image(pixels.to(DEVICE))
            _, feats, _, _ = model._prepare_backbone_features(out)
            return feats[-1] + model.no_mem_embed

        torch.cuda.reset_peak_memory_stats()
        say("sam2_large encode", median(encode))
        predictor.set_image(image)

        def masks(boxes):
            _, _, _, box = predictor._prep_prompts(None, None, boxes, None, True)
            found = predictor._predict(None, None, box, multimask_output=False)
            return found[1].float().cpu(), found[2].float().cpu()

        say("sam2_large one box", median(lambda: masks(boxes[:1])))
        say("sam2_large 30 boxes", median(lambda: masks(boxes)))

        def whole():
            predictor.set_image(image)
            predictor.predict(box=boxes, multimask_output=False)

        say("sam2_large photo to 30 masks", median(whole, 5))


def owlv2(size, folder):
    import owlv2 as script
    from transformers import Owlv2ForObjectDetection

    model = Owlv2ForObjectDetection(script.config(size)).eval()
    model.load_state_dict(load_file(f"{folder}/model.safetensors"))
    expected = load_file(f"{folder}/owlv2_{size}.safetensors")
    model = model.to(DEVICE)
    ids, mask = (t.to(DEVICE) for t in script.phrases(size))
    host = script.pixels_of(model)
    with torch.inference_mode(), autocast():
        out = model(input_ids=ids, pixel_values=host.to(DEVICE), attention_mask=mask)
        for name, value in (("logits", out.logits[0]), ("boxes", out.pred_boxes[0]), ("text_embeds", out.text_embeds[0])):
            print(f"peer owlv2_{size} bf16 error {name}: {l2(value, expected[name]):.1e}")
        torch.cuda.reset_peak_memory_stats()
        for count in (4, 32):
            many, seen = ids.repeat(count // 4, 1), mask.repeat(count // 4, 1)

            def run():
                out = model(input_ids=many, pixel_values=host.to(DEVICE), attention_mask=seen)
                return out.logits.float().cpu(), out.pred_boxes.float().cpu()

            say(f"owlv2_{size} image and {count} phrases", median(run))


def clip(folder):
    import clip as script
    from transformers import CLIPModel

    model = CLIPModel(script.config(False)).eval()
    model.load_state_dict(load_file(f"{folder}/model.safetensors"))
    expected = load_file(f"{folder}/clip_full.safetensors")
    model = model.to(DEVICE)
    host = script.pixels_of(224, 2)

    def embed(pixels):
        out = model.get_image_features(pixel_values=pixels.to(DEVICE))
        return (out if torch.is_tensor(out) else out.pooler_output).float().cpu()

    with torch.inference_mode(), autocast():
        print(f"peer clip bf16 error image_embeds: {l2(embed(host), expected['image_embeds']):.1e}")
        torch.cuda.reset_peak_memory_stats()
        say("clip one image", median(lambda: embed(host[:1])))
        say("clip 16 images", median(lambda: embed(host.repeat(8, 1, 1, 1))))


if __name__ == "__main__":
    print(f"PyTorch {torch.__version__}, {torch.cuda.get_device_name()}")
    mode, rest = sys.argv[1], sys.argv[2:]
    if mode == "vggt":
        vggt(rest[0], rest[1], rest[2:])
    else:
        {"compiled": compiled, "sam2": sam2, "owlv2": owlv2, "clip": clip}[mode](*rest)
