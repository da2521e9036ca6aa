"""CLIP (transformers' CLIPModel, its processors and its tokenizer) with seeded random weights.

Usage: clip.py small OUT.safetensors       the little arrays of tests/it/clip.rs
       clip.py preprocess OUT.safetensors  the image processor (PIL backend) on small pictures
       clip.py tokens FOLDER               a made-up vocabulary, and what the tokenizer makes of sentences
       clip.py full FOLDER                 ViT-B/32: model.safetensors, inputs and outputs
       clip.py turns FOLDER                one image on two threads, once for each line on stdin

Packages: torch transformers safetensors pillow. The pictures kept were made with Pillow 12.0.0; 13 resizes along y first in
some cases.
"""

import json
import os
import sys

import numpy as np
import torch

import seeded


def config(small):
    from transformers import CLIPConfig

    if not small:
        return CLIPConfig()  # openai/clip-vit-base-patch32
    return CLIPConfig(
        text_config=dict(vocab_size=60, hidden_size=24, intermediate_size=96, num_hidden_layers=2, num_attention_heads=3,
                         max_position_embeddings=12, eos_token_id=59, bos_token_id=58, pad_token_id=59),
        vision_config=dict(hidden_size=32, intermediate_size=128, num_hidden_layers=2, num_attention_heads=2, image_size=32,
                           patch_size=8),
        projection_dim=16,
    )


def build(small):
    from transformers import CLIPModel

    model = CLIPModel(config(small)).eval()
    special = {k: np.float32(0.5) * seeded.uniform(k, tuple(v.shape)) for k, v in model.state_dict().items() if "embedding" in k and "patch" not in k}
    special["logit_scale"] = np.array(2.6592, np.float32)
    return model, seeded.fill(model, special=special)


def save(path, arrays, *modules):
    import safetensors
    import safetensors.numpy
    import transformers

    arrays = {k: np.ascontiguousarray(np.asarray(v)) for k, v in arrays.items()}
    safetensors.numpy.save_file(arrays, path, metadata=seeded.versions(torch, transformers, safetensors, *modules))


@torch.no_grad()
def record(model, pixels, ids, taps):
    kept = {}
    vision = model.vision_model(pixel_values=pixels, output_hidden_states=taps)
    if taps:
        for i, h in enumerate(vision.hidden_states):
            kept[f"vision.hidden{i}"] = h[0]
    kept["image_embeds"] = model.get_image_features(pixel_values=pixels)
    kept["text_embeds"] = model.get_text_features(input_ids=ids)
    for key in ("image_embeds", "text_embeds"):
        if not torch.is_tensor(kept[key]):
            kept[key] = kept[key].pooler_output
    kept["ids"] = ids.to(torch.int32)
    return {k: v.numpy() for k, v in kept.items()}


def pixels_of(size, count):
    values = [seeded.uniform(f"pixels{i}", (3, size, size)) * np.float32(1.7) for i in range(count)]
    return torch.from_numpy(np.stack(values))


def photo(width, height):
    x, y = np.meshgrid(np.arange(width, dtype=np.int64), np.arange(height, dtype=np.int64))
    channels = [(x * x * 3 + y * 5) // 7 % 256, (x * 2 + y * y) // 5 % 256, (x * y) // 11 % 256]
    return np.stack(channels, -1).astype(np.uint8)


SENTENCES = [
    "a photo of a mid-century sideboard",
    "  the cat's   chair\tand 2 lamps!! ",
    "L'étagère où l'on pose 12½ livres…",
    "don't we'll I'm you've she'd they're it's",
    "ΣΟΦΟΣ Straße İstanbul ﬁn",
    "e\u0301tage\u0300re vs étagère",
    "椅子 と 机 🪑🛋️",
    "क्षेत्र ⅻ ② x²",
    "",
    "...sofa?!.,;:-()[]{}<>|@#$%^&*~`\"\\/",
    "tall floor lamp . standing lamp",
]


def tokens(folder):
    """A vocabulary like CLIP's: 256 bytes, 256 bytes at a word's end, merges, two marks."""
    from transformers import CLIPTokenizer
    from transformers.convert_slow_tokenizer import bytes_to_unicode

    alphabet = list(bytes_to_unicode().values())
    merges = [
        "t h", "th e</w>", "a n", "an d</w>", "l a", "la m", "lam p", "lamp s</w>", "lam p</w>", "c h", "ch a", "cha i", "chai r</w>",
        "s i", "si d", "sid e", "side b", "sideb o", "sidebo a", "sideboa r", "sideboar d</w>", "o f</w>", "Ã ©", "Ã ©</w>", "r e</w>", "Ã© t", "Ã©t a",
        "! !</w>", "' s</w>", "f l", "fl o", "flo o", "floo r</w>", "p h", "ph o", "pho t", "phot o</w>", "1 2</w>", "s o", "so f", "sof a</w>",
    ]
    vocab = alphabet + [a + "</w>" for a in alphabet] + [m.replace(" ", "") for m in merges]
    vocab = {token: i for i, token in enumerate(dict.fromkeys(vocab + ["<|startoftext|>", "<|endoftext|>"]))}
    os.makedirs(folder, exist_ok=True)
    with open(f"{folder}/vocab.json", "w") as file:
        json.dump(vocab, file, ensure_ascii=False)
    with open(f"{folder}/merges.txt", "w") as file:
        file.write("#version: 0.2\n" + "\n".join(merges) + "\n")
    tokenizer = CLIPTokenizer(vocab=vocab, merges=[tuple(m.split(" ")) for m in merges])
    tokenizer.backend_tokenizer.save(f"{folder}/tokenizer.json", pretty=False)
    cases = [{"text": s, "ids": tokenizer(s)["input_ids"]} for s in SENTENCES]
    cases += [{"text": "lamps and the chair " * 4, "max": 9,
               "ids": tokenizer("lamps and the chair " * 4, truncation=True, max_length=9)["input_ids"]}]
    with open(f"{folder}/cases.json", "w") as file:
        json.dump(cases, file, ensure_ascii=False, indent=1)
        file.write("\n")


def main():
    torch.set_num_threads(2)
    mode = sys.argv[1]
    if mode == "small":
        model, _ = build(True)
        ids = torch.tensor([[58, 3, 17, 9, 59, 59, 59], [58, 44, 59, 59, 59, 59, 59], [58, 1, 2, 3, 4, 5, 59]])
        save(sys.argv[2], record(model, pixels_of(32, 2), ids, True))
    elif mode == "full":
        folder = sys.argv[2]
        model, state = build(False)
        os.makedirs(folder, exist_ok=True)
        save(f"{folder}/model.safetensors", {k: v.numpy() for k, v in state.items()})
        ids = torch.full((3, 77), 49407)
        for row, length in enumerate((4, 9, 75)):
            ids[row, 0] = 49406
            ids[row, 1 : 1 + length] = torch.from_numpy(((seeded.uniform(f"ids{row}", (length,)) + 1) * 24000).astype(np.int64))
        save(f"{folder}/clip_full.safetensors", record(model, pixels_of(224, 2), ids, False))
    elif mode == "preprocess":
        import PIL
        from transformers.models.clip.image_processing_pil_clip import CLIPImageProcessorPil

        arrays = {}
        for name, (w, h, side) in {"wide": (97, 61, 32), "tall": (40, 93, 32), "grow": (21, 13, 32), "odd": (45, 32, 32)}.items():
            processor = CLIPImageProcessorPil(size={"shortest_edge": side}, crop_size={"height": side, "width": side})
            out = processor(PIL.Image.fromarray(photo(w, h)), return_tensors="np")["pixel_values"][0]
            arrays[name] = out.transpose(1, 2, 0).astype(np.float32)
            arrays[name + ".bilinear8"] = np.asarray(PIL.Image.fromarray(photo(w, h)).resize((24, 24), PIL.Image.BILINEAR))
        save(sys.argv[2], arrays, PIL)
    elif mode == "compare_backends":
        import PIL
        from transformers.models.clip.image_processing_clip import CLIPImageProcessor
        from transformers.models.clip.image_processing_pil_clip import CLIPImageProcessorPil

        image = PIL.Image.fromarray(photo(1280, 960))
        a = CLIPImageProcessor()(image, return_tensors="np")["pixel_values"][0]
        b = CLIPImageProcessorPil()(image, return_tensors="np")["pixel_values"][0]
        print("levels apart:", np.abs(a - b).max() * 0.26 * 255)
    elif mode == "tokens":
        tokens(sys.argv[2])
    elif mode == "turns":
        from safetensors.torch import load_file
        from transformers import CLIPModel

        model = CLIPModel(config(False)).eval()
        model.load_state_dict(load_file(f"{sys.argv[2]}/model.safetensors"), assign=True)
        pixels = pixels_of(224, 1)
        seeded.turns(lambda: model.get_image_features(pixel_values=pixels))
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
