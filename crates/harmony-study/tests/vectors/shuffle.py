"""Orders by an implementation of their own, from the words of src/shuffle.rs alone. Writes shuffle.json beside itself.

    python3 shuffle.py
"""
import hashlib
import json
import pathlib

MASK = (1 << 32) - 1


def rotate(x, n):
    return ((x << n) | (x >> (32 - n))) & MASK


class Xoshiro128StarStar:
    def __init__(self, text):
        digest = hashlib.sha256(text.encode()).digest()
        self.s = [int.from_bytes(digest[4 * i:4 * i + 4], "big") for i in range(4)]
        if not any(self.s):
            self.s[0] = 1

    def next(self):
        s = self.s
        result = rotate(s[1] * 5 & MASK, 7) * 9 & MASK
        t = s[1] << 9 & MASK
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = rotate(s[3], 11)
        return result

    def below(self, n):
        limit = (1 << 32) // n * n
        while True:
            x = self.next()
            if x < limit:
                return x % n


def shuffled(text, count):
    order, generator = list(range(count)), Xoshiro128StarStar(text)
    for i in range(count - 1, 0, -1):
        j = generator.below(i + 1)
        order[i], order[j] = order[j], order[i]
    return order


rows = []
for study in ["s", "harmony-user-study", "a-b-c"]:
    for participant in ["anna", "k7f2-q9xm", "0000", "z" * 32]:
        for trial in ["0123456789abcdef", "ffffffffffffffff", "bedroom_01"]:
            for count in [2, 6, 9]:
                text = f"harmony-study 1 panels\n{study}\n{participant}\n{trial}"
                rows.append({"study": study, "participant": participant, "trial": trial, "count": count,
                             "order": shuffled(text, count)})
        for count in [1, 20, 300]:
            text = f"harmony-study 1 trials\n{study}\n{participant}"
            rows.append({"study": study, "participant": participant, "trial": None, "count": count,
                         "order": shuffled(text, count)})
path = pathlib.Path(__file__).with_name("shuffle.json")
path.write_text("[\n" + ",\n".join(json.dumps(r, separators=(",", ":")) for r in rows) + "\n]\n")
