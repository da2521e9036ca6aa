"""Faces that lie on one another in one plane, moved apart by fractions of a millimetre.

Parts of a model may share a plane (a table top of two boards, rail and stile of a frame), and Cycles draws coincident faces
black. Needs numpy alone; `python3 apart.py` checks itself.
"""

import numpy as np

# Distance between two faces that shared a plane, metres, and how many different depths there are: all of them together
# are less than what lies on one another is apart, a rug's border on its ground.
STEP = 3e-5
STEPS = 6
# Faces nearer than this are one to a ray, metres, where their normals are alike to a hundredth.
NEAR = 2.4e-5
# Faces overlap from this length on, metres; of one face no more neighbours in its plane than this are looked at.
OVERLAP = 1e-4
NEIGHBOURS = 64


def pieces(count, corners, firsts):
    """Of each vertex the first vertex of its connected piece; `firsts`: the first vertex of each corner's face."""
    piece = np.arange(count, dtype=np.int64)
    while True:
        lowest, before = np.minimum(piece[corners], piece[firsts]), piece.copy()
        np.minimum.at(piece, corners, lowest)
        np.minimum.at(piece, firsts, lowest)
        piece = piece[piece]
        if np.array_equal(piece, before):
            return piece


def flats(places, normals, corners, starts, owner, shift):
    """Faces gathered by normal, plane and piece: of each its normal's bin, offset, piece, box, and of each face its flat."""
    offset = (normals * places[corners[starts]]).sum(axis=1)
    keys = np.column_stack([np.rint(normals * 100.0 + shift), np.rint(offset / (NEAR / 2)), owner]).astype(np.int64)
    keys, first, of_face = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    of_face = of_face.reshape(-1)
    low, high = np.full((len(keys), 3), np.inf), np.full((len(keys), 3), -np.inf)
    counts = np.diff(starts, append=len(corners))
    of_corner = np.repeat(of_face, counts)
    np.minimum.at(low, of_corner, places[corners])
    np.maximum.at(high, of_corner, places[corners])
    return keys[:, :3], offset[first], keys[:, 4], normals[first], low, high, of_face


def overlapping(places, normals, corners, starts, owner):
    """Pairs of pieces with faces on one another, with how much farther out the first one's is, and those faces."""
    pairs, faces = [], []
    for shift in (0.0, 0.5):  # a normal near the border of two bins is whole in one of both divisions
        bins, offset, piece, normal, low, high, of_face = flats(places, normals, corners, starts, owner, shift)
        order = np.lexsort((offset, bins[:, 2], bins[:, 1], bins[:, 0]))
        used = np.zeros(len(order), bool)
        for k in range(1, min(NEIGHBOURS, len(order))):
            a, b = order[:-k], order[k:]
            near = (bins[a] == bins[b]).all(axis=1) & (np.abs(offset[a] - offset[b]) < STEP * STEPS)
            if not near.any():
                break
            a, b = a[near], b[near]
            shared = np.minimum(high[a], high[b]) - np.maximum(low[a], low[b]) + np.abs(normal[a]) * 0.01
            on = (piece[a] != piece[b]) & (shared.min(axis=1) > OVERLAP)
            a, b = a[on], b[on]
            pairs.append(np.column_stack([piece[a], piece[b], offset[a] - offset[b]]))
            used[a] = used[b] = True
        faces.append(np.flatnonzero(used[of_face]))
    return np.concatenate(pairs or [np.empty((0, 3))]), np.unique(np.concatenate(faces))


def depths(pairs):
    """Of each piece how many steps its faces go inward, so that none comes near one that it lies on."""
    others = {}
    for a, b, farther in pairs:
        others.setdefault(int(a), []).append((int(b), farther))
        others.setdefault(int(b), []).append((int(a), -farther))
    steps = {}
    for piece in sorted(others):
        gaps = [(farther, steps[other]) for other, farther in others[piece] if other in steps]
        least = [min((abs(f - (k - s) * STEP) for f, s in gaps), default=np.inf) for k in range(STEPS)]
        steps[piece] = next((k for k in range(STEPS) if least[k] >= NEAR), int(np.argmax(least)))
    return steps


def apart(places, normals, corners, starts):
    """The vertices' new places. `places`: (vertices, 3), metres; `normals`: (faces, 3); `corners`: vertices of all faces, one
    face after another; `starts`: each face's first corner."""
    counts = np.diff(starts, append=len(corners))
    owner = pieces(len(places), corners, np.repeat(corners[starts], counts))[corners[starts]]
    pairs, faces = overlapping(places, normals, corners, starts, owner)
    steps = depths(pairs)
    moved, ways = places.copy(), {}
    for face in faces:
        by = steps.get(int(owner[face]), 0)
        if by == 0:
            continue
        for vertex in corners[starts[face] : starts[face] + counts[face]]:
            # Once for each plane that a corner lies in.
            own = ways.setdefault(int(vertex), [])
            if all(float(n @ normals[face]) < 0.99 for n in own):
                own.append(normals[face])
                moved[vertex] -= by * STEP * normals[face]
    return moved


def check():
    """Boards that share planes come apart, others stay."""

    def board(low, high):
        (x0, y0, z), (x1, y1) = low, high
        return [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]

    # Two rails and two stiles of a frame, one made larger by two steps, as a program's parts are; one board beside them.
    boards = [
        board((0.0, 0.0, 0.0), (1.0, 0.1)),
        board((0.0, 0.9, 0.0), (1.0, 1.0)),
        board((0.0, 0.0, 2 * STEP), (0.1, 1.0)),
        board((0.9, 0.0, 0.0), (1.0, 1.0)),
        board((2.0, 0.0, 0.0), (3.0, 1.0)),
    ]
    places = np.array([p for b in boards for p in b])
    normals = np.tile([0.0, 0.0, 1.0], (len(boards), 1))
    moved = apart(places, normals, np.arange(len(places)), np.arange(0, len(places), 4))
    height = moved[::4, 2]
    for a, b in ((0, 2), (0, 3), (1, 2), (1, 3)):
        assert abs(height[a] - height[b]) >= NEAR, (a, b, height)
    assert height[4] == 0.0, height
    assert np.abs(moved - places).max() < STEP * STEPS


if __name__ == "__main__":
    check()
    print("apart.py: faces come apart")
