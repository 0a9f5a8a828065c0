#!/usr/bin/env python3
"""Writes the models that the tests of the learned matcher run, and the scores they must give: tests/fixtures/learned.

    python3 scripts/tiny_models.py            writes the files
    python3 scripts/tiny_models.py --check    compares them with what is there, and fails where they differ

Needs Python alone. The models are written byte by byte in ONNX's wire format (protocol buffers), one for each contract of
docs/models.md, and some that are wrong on purpose. The scores are computed here a second time, without any runtime and without
reading the Rust code: the golden values are an independent implementation of the same documents.
"""

import json
import math
import pathlib
import struct
import sys

FOLDER = pathlib.Path(__file__).resolve().parent.parent / "tests" / "fixtures" / "learned"

# --- ONNX on the wire -----------------------------------------------------------------------------------------------------------

FLOAT, INT64, FLOAT16 = 1, 7, 10


def varint(value):
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def number(field, value):
    return varint(field << 3) + varint(value)


def block(field, data):
    data = data.encode() if isinstance(data, str) else data
    return varint(field << 3 | 2) + varint(len(data)) + data


def tensor(name, dims, values):
    """A constant: 64-bit whole numbers where all values are, else 32-bit floats."""
    whole = all(isinstance(value, int) for value in values)
    raw = b"".join(struct.pack("<q" if whole else "<f", value) for value in values)
    return b"".join(number(1, dim) for dim in dims) + number(2, INT64 if whole else FLOAT) + block(8, name) + block(9, raw)


def value_info(name, dims, kind=FLOAT):
    """An input or output; a dimension that is a text is free."""
    dims = b"".join(block(1, block(2, dim) if isinstance(dim, str) else number(1, dim)) for dim in dims)
    return block(1, name) + block(2, block(1, number(1, kind) + block(2, dims)))


def node(op, inputs, output, **attributes):
    out = b"".join(block(1, name) for name in inputs) + block(2, output) + block(3, output + "_" + op) + block(4, op)
    for name, value in sorted(attributes.items()):
        if isinstance(value, list):
            out += block(5, block(1, name) + b"".join(number(8, item) for item in value) + number(20, 7))
        else:
            out += block(5, block(1, name) + number(3, value) + number(20, 2))
    return out


def model(nodes, constants, inputs, output, **metadata):
    graph = b"".join(block(1, item) for item in nodes) + block(2, "tiny")
    graph += b"".join(block(5, item) for item in constants) + b"".join(block(11, item) for item in inputs)
    graph += block(12, output)
    out = number(1, 8) + block(2, "pelical scripts/tiny_models.py") + block(7, graph) + block(8, block(1, "") + number(2, 17))
    metadata = {"licence": "MIT OR Apache-2.0", **metadata}
    return out + b"".join(block(14, block(1, "pelical." + key) + block(2, value)) for key, value in sorted(metadata.items()))


# --- the models -----------------------------------------------------------------------------------------------------------------

STRIDE, MULTIPLE, WIDTH = 8, 16, 4
# A descriptor of a cell of 8 x 8 px: how bright it is, how much brighter at the right and below, and at its middle.
BIAS = [-0.4, 0.0, 0.0, -0.2]


def kernel(channel, y, x):
    across, down = (x - 3.5) / 3.5, (y - 3.5) / 3.5
    return [1.0, across, down, 1.0 - abs(across) - abs(down)][channel] / 64.0


def dense_parts(channels):
    weights = [kernel(c, y, x) / channels for c in range(WIDTH) for _ in range(channels) for y in range(8) for x in range(8)]
    constants = [tensor("weights", [WIDTH, channels, 8, 8], weights), tensor("bias", [WIDTH], BIAS)]
    conv = node("Conv", ["image", "weights", "bias"], "descriptors", kernel_shape=[8, 8], strides=[STRIDE, STRIDE])
    return [conv], constants


def dense(channels=1, sides=("H", "W"), output="descriptors", image="image", **metadata):
    nodes, constants = dense_parts(channels)
    if (image, output) != ("image", "descriptors"):
        nodes = [node("Identity", [image], "image"), *nodes, node("Identity", ["descriptors"], output)]
        nodes = nodes[1:] if image == "image" else nodes[:-1]
    metadata = {"stride": "8", "multiple": "16", "channels": "rgb" if channels == 3 else "grey", **metadata}
    inputs = [value_info(image, [1, channels, *sides])]
    return model(nodes, constants, inputs, value_info(output, [1, WIDTH, "h", "w"]), **metadata)


def dense_of_halves():
    nodes, constants = dense_parts(1)
    nodes = [node("Cast", ["image"], "single", to=FLOAT), nodes[0].replace(b"\x0a\x05image", b"\x0a\x06single")]
    return model(nodes, constants, [value_info("image", [1, 1, "H", "W"], FLOAT16)], value_info("descriptors", [1, WIDTH, "h", "w"]))


def dense_without_channels():
    nodes, constants = dense_parts(1)
    nodes = [node("Unsqueeze", ["image", "axis"], "single"), nodes[0].replace(b"\x0a\x05image", b"\x0a\x06single")]
    constants.append(tensor("axis", [1], [1]))
    return model(nodes, constants, [value_info("image", [1, "H", "W"])], value_info("descriptors", [1, WIDTH, "h", "w"]))


def glue(width=WIDTH, points="M", transposed=False):
    """Dual softmax of 12 times the product of the descriptors plus the product of the key points."""
    nodes = [
        node("Transpose", ["desc1"], "desc1t", perm=[0, 2, 1]),
        node("MatMul", ["desc0", "desc1t"], "alike"),
        node("Mul", ["alike", "twelve"], "sharp"),
        node("Transpose", ["kpts1"], "kpts1t", perm=[0, 2, 1]),
        node("MatMul", ["kpts0", "kpts1t"], "near"),
        node("Add", ["sharp", "near"], "sum"),
        node("Softmax", ["sum"], "there", axis=2),
        node("Softmax", ["sum"], "back", axis=1),
        node("Mul", ["there", "back"], "both"),
        node("Transpose", ["both"], "scores", perm=[0, 2, 1]) if transposed else node("Identity", ["both"], "scores"),
    ]
    inputs = [
        value_info("kpts0", [1, points, 2]),
        value_info("kpts1", [1, "N", 2]),
        value_info("desc0", [1, points, width]),
        value_info("desc1", [1, "N", width]),
    ]
    return model(nodes, [tensor("twelve", [], [12.0])], inputs, value_info("scores", [1, "A", "B"]), kpt_scale="0.5")


def lines():
    """Sigmoid of the product of the lines' ends, times the mean brightness of both images."""
    nodes, constants = [], [tensor("flat", [3], [1, -1, 4]), tensor("hundred", [], [100.0]), tensor("half", [], [0.5])]
    for side in "01":
        nodes += [
            node("Reshape", ["lines" + side, "flat"], "flat" + side),
            node("Div", ["flat" + side, "hundred"], "ends" + side),
            node("ReduceMean", ["image" + side], "bright" + side, keepdims=0),
        ]
    nodes += [
        node("Transpose", ["ends1"], "ends1t", perm=[0, 2, 1]),
        node("MatMul", ["ends0", "ends1t"], "alike"),
        node("Sigmoid", ["alike"], "share"),
        node("Add", ["bright0", "bright1"], "bright"),
        node("Mul", ["bright", "half"], "mean"),
        node("Mul", ["share", "mean"], "line_scores"),
    ]
    inputs = [value_info("image" + side, [1, 1, "H" + side, "W" + side]) for side in "01"]
    inputs += [value_info("lines" + side, [1, "A" + side, 2, 2]) for side in "01"]
    return model(nodes, constants, inputs, value_info("line_scores", [1, "A", "B"]), multiple="16")


def wireframe():
    """Logarithm of a sigmoid of what the lines' junctions look like, where they are, and how the nodes score."""
    constants = [
        tensor("first", [1], [0]), tensor("middle", [1], [1]), tensor("four", [], [4.0]),
        tensor("pads", [6], [0, 0, 0, 0, 1, 1]), tensor("unmatched", [], [-3.0]), tensor("thousand", [], [1000.0]),
        tensor("six", [], [-6.0]),
    ]
    nodes = []
    for side in "01":
        nodes += [
            node("Transpose", ["desc" + side], "bynode" + side, perm=[0, 2, 1]),
            node("Squeeze", ["bynode" + side, "first"], "nodes" + side),
            node("Squeeze", ["junc" + side, "first"], "ends" + side),
            node("Gather", ["nodes" + side, "ends" + side], "atends" + side, axis=0),
            node("ReduceMean", ["atends" + side], "look" + side, axes=[1], keepdims=0),
            node("Squeeze", ["kpts" + side, "first"], "places" + side),
            node("Gather", ["places" + side, "ends" + side], "placed" + side, axis=0),
            node("ReduceMean", ["placed" + side], "centre" + side, axes=[1], keepdims=0),
            node("Div", ["centre" + side, "size" + side], "where" + side),
            node("ReduceMean", ["kpt_scores" + side], "level" + side, keepdims=0),
            node("ReduceMean", ["lines" + side], "mean" + side, keepdims=0),
            node("Div", ["mean" + side, "thousand"], "offset" + side),
            node("Add", ["level" + side, "offset" + side], "shift" + side),
        ]
    nodes += [
        node("Transpose", ["look1"], "look1t", perm=[1, 0]),
        node("MatMul", ["look0", "look1t"], "alike"),
        node("Mul", ["alike", "four"], "sharp"),
        node("Transpose", ["where1"], "where1t", perm=[1, 0]),
        node("MatMul", ["where0", "where1t"], "near"),
        node("Transpose", ["line_scores0"], "score0", perm=[1, 0]),
        node("MatMul", ["score0", "line_scores1"], "strong"),
        node("Sum", ["sharp", "near", "strong", "shift0", "shift1", "six"], "sum"),
        node("Sigmoid", ["sum"], "share"),
        node("Log", ["share"], "log"),
        node("Unsqueeze", ["log", "first"], "one"),
        node("Pad", ["one", "pads", "unmatched"], "line_log_assignment"),
    ]
    inputs = []
    for side in "01":
        points, n_lines = "N" + side, "A" + side
        inputs += [
            value_info("kpts" + side, [1, points, 2]), value_info("kpt_scores" + side, [1, points]),
            value_info("desc" + side, [1, WIDTH, points]), value_info("lines" + side, [1, n_lines, 2, 2]),
            value_info("line_scores" + side, [1, n_lines]), value_info("junc" + side, [1, n_lines, 2], INT64),
            value_info("size" + side, [1, 2]),
        ]
    return model(nodes, constants, inputs, value_info("line_log_assignment", [1, "A", "B"]))


# --- the same by hand -----------------------------------------------------------------------------------------------------------

SIZE = (64, 40)  # 40 rows are padded to 48
SEGMENTS = [
    [[4.0, 5.0, 52.0, 6.5], [10.5, 34.0, 11.0, 8.0], [11.5, 7.0, 60.0, 37.5], [58.0, 38.0, 20.0, 30.0], [3.0, 3.0, 8.0, 3.0]],
    [[0.5, 5.0, 46.0, 6.5], [5.0, 8.0, 4.5, 34.0], [53.5, 36.5, 5.5, 7.5], [30.0, 2.0, 60.0, 20.0]],
]


def level(image, x, y):
    """Gray levels of the two images, as in the tests: the second is the first, seen from 6 px further right."""
    x += 6 * image
    return ((3 * x * x + 5 * y * y + 7 * x * y) // 16 + 40 * ((x // 9 + y // 7) % 2)) % 256


def padded(image):
    width, height = (-(-side // MULTIPLE) * MULTIPLE for side in SIZE)
    return [[level(image, min(x, SIZE[0] - 1), min(y, SIZE[1] - 1)) / 255 for x in range(width)] for y in range(height)]


def described(image):
    pixels = padded(image)
    rows, cols = len(pixels) // STRIDE, len(pixels[0]) // STRIDE
    cell = lambda c, i, j: BIAS[c] + sum(
        kernel(c, y, x) * pixels[STRIDE * i + y][STRIDE * j + x] for y in range(8) for x in range(8))
    return [[[cell(c, i, j) for c in range(WIDTH)] for j in range(cols)] for i in range(rows)]


def sampled(cells, x, y):
    """Bilinear between the centres of the cells, which are at 8 j + 3.5, then of length 1."""
    u = min(max((x - (STRIDE - 1) / 2) / STRIDE, 0), len(cells[0]) - 1)
    v = min(max((y - (STRIDE - 1) / 2) / STRIDE, 0), len(cells) - 1)
    j, i = min(int(u), len(cells[0]) - 2), min(int(v), len(cells) - 2)
    a, b = u - j, v - i
    mixed = [(1 - b) * ((1 - a) * cells[i][j][c] + a * cells[i][j + 1][c]) + b * ((1 - a) * cells[i + 1][j][c] + a * cells[i + 1][j + 1][c])
             for c in range(WIDTH)]
    length = math.sqrt(sum(value * value for value in mixed))
    return [value / length for value in mixed]


def points(segment):
    x, y, to_x, to_y = segment
    n = max(2, int(math.hypot(to_x - x, to_y - y) // 12) + 1)
    return [(x + (to_x - x) * k / (n - 1), y + (to_y - y) * k / (n - 1)) for k in range(n)]


def dot(a, b):
    return sum(p * q for p, q in zip(a, b))


def sigmoid(value):
    return 1 / (1 + math.exp(-value))


def aligned(likeness):
    grid = [[0.0] * (len(likeness[0]) + 1) for _ in range(len(likeness) + 1)]
    for i, row in enumerate(likeness):
        for j, value in enumerate(row):
            grid[i + 1][j + 1] = max(grid[i][j] + value - 0.1, grid[i][j + 1], grid[i + 1][j])
    return grid[-1][-1]


def golden_dense(looks):
    def score(a, b):
        likeness = [[dot(p, q) for q in b] for p in a]
        return max(aligned(likeness), aligned([row[::-1] for row in likeness])) / min(len(a), len(b))
    return [[score(a, b) for b in looks[1]] for a in looks[0]]


def golden_glue(looks):
    # kpt_scale is 0.5: key points in quarters of the longer side, from the centre.
    unit = 0.5 * max(SIZE) / 2
    places = [[((x - SIZE[0] / 2) / unit, (y - SIZE[1] / 2) / unit) for line in side for x, y in points(line)] for side in SEGMENTS]
    flat = [[look for line in side for look in line] for side in looks]
    sums = [[12 * dot(a, b) + dot(p, q) for b, q in zip(flat[1], places[1])] for a, p in zip(flat[0], places[0])]
    of_row = [sum(math.exp(value) for value in row) for row in sums]
    of_col = [sum(math.exp(value) for value in col) for col in zip(*sums)]
    both = [[math.exp(value) ** 2 / of_row[i] / of_col[j] for j, value in enumerate(row)] for i, row in enumerate(sums)]
    owners = [[line for line, side in enumerate(looks[k]) for _ in side] for k in (0, 1)]
    scores = [[0.0] * len(looks[1]) for _ in looks[0]]
    for i, line in enumerate(owners[0]):
        for j, other in enumerate(owners[1]):
            scores[line][other] += both[i][j] / min(len(looks[0][line]), len(looks[1][other]))
    return scores


def golden_lines():
    bright = [sum(map(sum, padded(image))) / sum(map(len, padded(image))) for image in (0, 1)]
    return [[sigmoid(dot([v / 100 for v in a], [v / 100 for v in b])) * sum(bright) / 2 for b in SEGMENTS[1]] for a in SEGMENTS[0]]


def golden_wireframe(cells):
    sides = []
    for image, segments in enumerate(SEGMENTS):
        ends = [end for x, y, to_x, to_y in segments for end in ((x, y), (to_x, to_y))]
        group = list(range(len(ends)))
        for _ in ends:
            for a in range(len(ends)):
                for b in range(len(ends)):
                    if math.dist(ends[a], ends[b]) <= 3:
                        group[a] = group[b] = min(group[a], group[b])
        longest = max(math.hypot(c - a, d - b) for a, b, c, d in segments)
        scores = [math.sqrt(math.hypot(c - a, d - b) / longest) for a, b, c, d in segments]
        groups = sorted(set(group))
        mean = lambda values: sum(values) / len(values)
        members = {g: [k for k in range(len(ends)) if group[k] == g] for g in groups}
        places = {g: tuple(mean([ends[k][axis] for k in members[g]]) for axis in (0, 1)) for g in groups}
        looks = {g: sampled(cells[image], *places[g]) for g in groups}
        level = mean([mean([scores[k // 2] for k in members[g]]) for g in groups])
        merged = [[places[group[2 * k]], places[group[2 * k + 1]]] for k in range(len(segments))]
        shift = level + mean([value for line in merged for end in line for value in end]) / 1000
        lines = []
        for k, score in enumerate(scores):
            a, b = group[2 * k], group[2 * k + 1]
            look = [(p + q) / 2 for p, q in zip(looks[a], looks[b])]
            where = [(p + q) / 2 / side for p, q, side in zip(places[a], places[b], SIZE)]
            lines.append((look, where, score))
        sides.append((lines, shift, len(groups)))
    assert sides[0][2] < 2 * len(SEGMENTS[0]), "some ends must be merged, or the test shows nothing"
    (lines0, shift0, _), (lines1, shift1, _) = sides
    return [[sigmoid(4 * dot(a[0], b[0]) + dot(a[1], b[1]) + a[2] * b[2] + shift0 + shift1 - 6) for b in lines1] for a in lines0]


def golden():
    cells = [described(0), described(1)]
    looks = [[[sampled(cells[k], x, y) for x, y in points(line)] for line in SEGMENTS[k]] for k in (0, 1)]
    scores = {"dense": golden_dense(looks), "glue": golden_glue(looks), "lines": golden_lines(), "wireframe": golden_wireframe(cells)}
    rounded = {name: [[round(value, 5) for value in row] for row in rows] for name, rows in scores.items()}
    return {"segments": SEGMENTS, "scores": rounded}


def files():
    """Name and content of everything."""
    text = json.dumps(golden()).replace("]], ", "]],\n").replace("}, ", "},\n") + "\n"
    return {
        "dense.onnx": dense(),
        "dense_rgb_fixed.onnx": dense(channels=3, sides=(48, 64)),
        "glue.onnx": glue(),
        "lines.onnx": lines(),
        "wireframe.onnx": wireframe(),
        "golden.json": text.encode(),
        # Wrong on purpose.
        "bad_type.onnx": dense_of_halves(),
        "bad_rank.onnx": dense_without_channels(),
        "bad_names.onnx": dense(image="picture"),
        "bad_output.onnx": dense(output="features"),
        "bad_stride.onnx": dense(stride="4"),
        "bad_metadata.onnx": dense(multiple="many"),
        "bad_fixed_points.onnx": glue(points=16),
        "bad_width.onnx": glue(width=6),
        "bad_shape.onnx": glue(transposed=True),
    }


def main():
    if sys.argv[1:] == ["--check"]:
        wanted = files()
        there = {path.name for path in FOLDER.iterdir()}
        differing = [name for name, data in wanted.items() if name not in there or (FOLDER / name).read_bytes() != data]
        differing += sorted(there - set(wanted))
        if differing:
            sys.exit(f"{FOLDER}: not as scripts/tiny_models.py writes it: {', '.join(differing)}")
        print(f"{len(wanted)} files are as this script writes them")
    elif not sys.argv[1:]:
        FOLDER.mkdir(parents=True, exist_ok=True)
        for name, data in files().items():
            (FOLDER / name).write_bytes(data)
            print(f"{len(data):6} {name}")
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
