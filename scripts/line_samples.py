#!/usr/bin/env python3
"""Reference of the learned matcher `dense` + `glue` (docs/models.md): line samples become the key points of LighterGlue.

    python3 scripts/line_samples.py MODELS            writes tests/fixtures/xfeat_lighterglue.json
    python3 scripts/line_samples.py MODELS --check    compares it with what is there

MODELS is a folder with xfeat_dense_f16.onnx and lighterglue_f16.onnx. Needs numpy and onnxruntime. Input are images and segments made
here by formula, and the same in Rust by the test that compares its scores with this file.
"""

import json
import pathlib
import sys

import numpy as np
import onnxruntime

STEP_PX, MAX_SAMPLES = 12.0, 40
FILE = pathlib.Path(__file__).resolve().parent.parent / "tests" / "fixtures" / "xfeat_lighterglue.json"
SIZE = (200, 150)  # sides that are no multiples of 32


def image(which):
    """Gray levels: boxes of several sizes on a ramp; the second image is the first, seen from 9 px further right and 4 px lower."""
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].astype(np.int64)
    x, y = x + 9 * which, y + 4 * which
    level = 60 + x // 4 + y // 3
    for left, top, right, bottom, shade in BOXES:
        inside = (x >= left) & (x < right) & (y >= top) & (y < bottom)
        level = np.where(inside, shade + (x * y) % 11, level)
    return level.astype(np.uint8)


BOXES = [(20, 25, 90, 70, 210), (60, 50, 150, 120, 30), (110, 15, 185, 60, 160), (30, 90, 75, 140, 120), (160, 80, 195, 145, 235)]


def segments(which):
    """The sides of the boxes, top and bottom, left and right; those of the second image in another order."""
    x, y = 9 * which, 4 * which
    sides = []
    for left, top, right, bottom, _ in BOXES:
        left, top, right, bottom = left - x - 0.5, top - y - 0.5, right - x - 0.5, bottom - y - 0.5
        sides += [(left, top, right, top), (right, bottom, left, bottom), (left, bottom, left, top), (right, top, right, bottom)]
    inside = [side for side in sides if min(side) >= 0 and max(side[0], side[2]) < SIZE[0] and max(side[1], side[3]) < SIZE[1]]
    return np.array(inside[::-1] if which else inside, np.float32)


def samples(lines):
    """Points every STEP_PX along each line (2 to MAX_SAMPLES, both ends included) and the line each belongs to."""
    points, owner = [], []
    for index, line in enumerate(lines):
        n = int(np.clip(np.hypot(*(line[2:] - line[:2])) // STEP_PX + 1, 2, MAX_SAMPLES))
        points.append(line[:2] + (line[2:] - line[:2]) * np.linspace(0, 1, n)[:, None])
        owner += [index] * n
    return np.concatenate(points).astype(np.float32), np.array(owner)


def describe(session, gray, points):
    """Unit descriptors (n, 64) at points; the map's cell (i, j) is centred at pixel (8 j + 3.5, 8 i + 3.5)."""
    height, width = gray.shape
    padded = np.pad(gray.astype(np.float32) / 255, ((0, -height % 32), (0, -width % 32)), mode="edge")
    cells = session.run(["descriptors"], {"image": padded[None, None]})[0][0]
    x = np.clip((points[:, 0] + 0.5) / 8 - 0.5, 0, cells.shape[2] - 1.001)
    y = np.clip((points[:, 1] + 0.5) / 8 - 0.5, 0, cells.shape[1] - 1.001)
    i, j = y.astype(int), x.astype(int)
    a, b = x - j, y - i
    mixed = (
        cells[:, i, j] * (1 - a) * (1 - b)
        + cells[:, i, j + 1] * a * (1 - b)
        + cells[:, i + 1, j] * (1 - a) * b
        + cells[:, i + 1, j + 1] * a * b
    ).T
    return (mixed / np.linalg.norm(mixed, axis=1, keepdims=True)).astype(np.float32)


def scores(models, images, lines):
    """Assigned share of the shorter line's points, for every pair of lines."""
    dense, glue = (onnxruntime.InferenceSession(str(pathlib.Path(models) / f"{name}_f16.onnx")) for name in ("xfeat_dense", "lighterglue"))
    inputs, owners = {}, []
    for side, (gray, segments_px) in enumerate(zip(images, lines)):
        points, owner = samples(segments_px)
        size = np.array(gray.shape[::-1])
        inputs[f"kpts{side}"] = ((points - size / 2) / (max(size) / 2)).astype(np.float32)[None]
        inputs[f"desc{side}"] = describe(dense, gray, points)[None]
        owners.append(np.eye(len(segments_px), dtype=np.float32)[owner])
    assigned = glue.run(["scores"], inputs)[0][0]
    shorter = np.minimum(owners[0].sum(0)[:, None], owners[1].sum(0)[None])
    return owners[0].T @ assigned @ owners[1] / shorter


def main():
    if len(sys.argv) < 2 or sys.argv[2:] not in ([], ["--check"]):
        sys.exit(__doc__)
    images, lines = [image(0), image(1)], [segments(0), segments(1)]
    found = scores(sys.argv[1], images, lines)
    document = {"segments": [side.tolist() for side in lines], "scores": np.round(found, 5).tolist()}
    if sys.argv[2:]:
        wanted = json.loads(FILE.read_text())
        gap = float(np.abs(np.array(wanted["scores"]) - found).max())
        if wanted["segments"] != document["segments"] or gap > 1e-3:
            sys.exit(f"{FILE}: largest difference {gap:.5f}; allowed is 0.001")
        print(f"{found.size} scores as committed, largest difference {gap:.1e}")
    else:
        FILE.write_text(json.dumps(document).replace("], ", "],\n") + "\n")
        print(f"{FILE}: {found.shape[0]} x {found.shape[1]} scores, {(found > 0.1).sum()} above 0.1")


if __name__ == "__main__":
    main()
