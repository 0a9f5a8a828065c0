#!/usr/bin/env python3
"""Writes tests/fixtures/bags: recordings as librealsense's own recorder makes them, and what they must say.

    python3 -m venv venv && venv/bin/pip install pyrealsense2==2.56.5.9235 numpy
    venv/bin/python scripts/make_bags.py tests/fixtures/bags

Two cameras of a software device each see a room of plain boxes (no textures: recordings in the repository have to be small); depth
comes from an imager of its own beside each colour camera. `wrap.bag` is of one camera whose hardware clock wraps. Development only.
"""
import hashlib
import json
import sys
from pathlib import Path

import numpy as np
import pyrealsense2 as rs

COLOR = (424, 240)
DEPTH = (212, 120)
UNIT_M = 0.004
N_SETS = 12
FIRST_MS = 1_760_000_000_000.0
PERIOD_MS = 500.0
GYRO_PER_FRAME = 4


def rotation(pitch_deg, yaw_deg, roll_deg):
    p, y, r = np.radians([pitch_deg, yaw_deg, roll_deg])
    about_x = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    return about_y @ about_x @ about_z


def boxes(random):
    """Centre, half size and yaw of the furniture, and of thin panels on the walls. y points down, the floor is at 1.2 m."""
    found = []
    for place in range(16):
        angle = 2 * np.pi * place / 16 + random.uniform(-0.1, 0.1)
        size = random.uniform([0.15, 0.2, 0.15], [0.45, 0.75, 0.4])
        away = random.uniform(1.5, 2.3)
        centre = np.array([away * np.sin(angle), 1.2 - size[1], away * np.cos(angle)])
        found.append((centre, size, random.uniform(0, np.pi)))
        high = random.uniform([0.2, 0.12, 0.01], [0.5, 0.3, 0.03])
        centre = np.array([2.6 * np.sin(angle + 0.2), random.uniform(-0.8, -0.2), 2.6 * np.cos(angle + 0.2)])
        found.append((centre, high, angle + 0.2))
    return found


def hit(origin, rays, box, inside):
    """Depth along z of the camera (rays have z = 1 there) and face of a box; infinite where it is missed."""
    centre, half, yaw = box
    turn = rotation(0, np.degrees(-yaw), 0)
    start, way = turn @ (origin - centre), rays @ turn.T
    way = np.where(np.abs(way) < 1e-12, 1e-12, way)
    one, other = (-half - start) / way, (half - start) / way
    enter, leave = np.minimum(one, other), np.maximum(one, other)
    if inside:
        return leave.min(axis=1), leave.argmin(axis=1) + 3 * (way[np.arange(len(way)), leave.argmin(axis=1)] > 0)
    near, far = enter.max(axis=1), leave.min(axis=1)
    missed = (near > far) | (near < 0.1)
    face = enter.argmax(axis=1)
    return np.where(missed, np.inf, near), face + 3 * (way[np.arange(len(way)), face] > 0)


def look(scene, colours, room_from_camera, pixels):
    """Depth and colour of pixel positions, normalised to z = 1."""
    turn, origin = room_from_camera
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ turn.T
    room = (np.array([0, 0, 0.0]), np.array([3.2, 1.2, 2.9]), 0.3)
    depth, face = hit(origin, rays, room, inside=True)
    colour = colours[0][face]
    for number, box in enumerate(scene, start=1):
        near, face = hit(origin, rays, box, inside=False)
        closer = near < depth
        depth, colour = np.where(closer, near, depth), np.where(closer[:, None], colours[number][face], colour)
    return depth, colour


def intrinsics(size, focal_px, model=rs.distortion.none, coeffs=(0, 0, 0, 0, 0)):
    made = rs.intrinsics()
    made.width, made.height = size
    made.fx, made.fy, made.ppx, made.ppy = focal_px, focal_px + 0.5, size[0] / 2 + 1.25, size[1] / 2 - 2.5
    made.model, made.coeffs = model, list(coeffs)
    return made


def grid(made, steps):
    """Normalised positions of all pixels, each as steps x steps samples."""
    offsets = (np.arange(steps) + 0.5) / steps - 0.5
    y, x, dy, dx = np.meshgrid(np.arange(made.height), np.arange(made.width), offsets, offsets, indexing="ij")
    return np.column_stack([((x + dx).ravel() - made.ppx) / made.fx, ((y + dy).ravel() - made.ppy) / made.fy])


def compose(a, b):
    """a after b, each a rotation and a translation."""
    return a[0] @ b[0], a[0] @ b[1] + a[1]


def write(path, camera, frames):
    """One bag. Everything is local: the file is whole only when every reference to the recorder is gone."""
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Intel RealSense D435I")
    device.register_info(rs.camera_info.serial_number, camera["serial"])
    device.register_info(rs.camera_info.firmware_version, camera["firmware"])

    def video(sensor, kind, uid, made, fmt, bpp):
        stream = rs.video_stream()
        stream.type, stream.index, stream.uid, stream.fps = kind, 0, uid, 30
        stream.width, stream.height, stream.bpp, stream.fmt, stream.intrinsics = made.width, made.height, bpp, fmt, made
        return sensor.add_video_stream(stream)

    depths, colours, motion = (device.add_sensor(name) for name in ("Stereo Module", "RGB Camera", "Motion Module"))
    depth = video(depths, rs.stream.depth, 0, camera["depth"], rs.format.z16, 2)
    colour = video(colours, rs.stream.color, 1, camera["color"], camera["format"], 3)
    stream = rs.motion_stream()
    stream.type, stream.index, stream.uid, stream.fps, stream.fmt = rs.stream.gyro, 0, 2, 200, rs.format.motion_xyz32f
    gyro = motion.add_motion_stream(stream)
    depths.add_read_only_option(rs.option.depth_units, camera["unit_m"])
    between = rs.extrinsics()
    turn, at_m = camera["color_from_depth"]
    between.rotation, between.translation = list(turn.T.ravel()), list(at_m)
    depth.register_extrinsics_to(colour, between)
    recorder = rs.recorder(str(path), device)
    for sensor, profile in ((depths, depth), (colours, colour), (motion, gyro)):
        sensor.open(profile)
        sensor.start(lambda _: None)
    for number, frame in enumerate(frames):
        for rate in frame["gyro_rad_per_s"]:
            sample, value = rs.software_motion_frame(), rs.vector()
            value.x, value.y, value.z = 0.0, rate, 0.0
            sample.data, sample.timestamp = value, frame["gyro_ms"]
            sample.domain, sample.frame_number, sample.profile = camera["domain"], number, gyro.as_motion_stream_profile()
            motion.on_motion_frame(sample)
        for sensor, profile, image, late_ms in ((depths, depth, frame["depth"], -2.0), (colours, colour, frame["rgb"], 0.0)):
            sensor.set_metadata(rs.frame_metadata_value.time_of_arrival, int(frame["arrival_ms"]))
            sent = rs.software_video_frame()
            sent.pixels, sent.bpp = np.ascontiguousarray(image), image.itemsize * (image.ndim == 2 or 3)
            sent.stride = image.strides[0]
            sent.timestamp, sent.domain, sent.frame_number = frame["ms"] + late_ms * frame["late"], camera["domain"], number
            sent.profile = profile.as_video_stream_profile()
            if image.ndim == 2:
                sent.depth_units = camera["unit_m"]
            sensor.on_video_frame(sent)
    for sensor in (depths, colours, motion):
        sensor.stop()
        sensor.close()


def told(camera, frames):
    """What a reader has to find."""
    def lens(made):
        return {"width": made.width, "height": made.height, "fx": made.fx, "fy": made.fy, "cx": made.ppx, "cy": made.ppy,
                "model": str(made.model).rsplit(".", 1)[-1], "coeffs": list(made.coeffs)}

    def sha(image):
        return hashlib.sha256(np.ascontiguousarray(image).tobytes()).hexdigest()

    turn, at_m = camera["color_from_depth"]
    return {
        "serial": camera["serial"], "firmware": camera["firmware"], "depth_unit_m": camera["unit_m"],
        "color": lens(camera["color"]), "depth": lens(camera["depth"]),
        "color_from_depth": {"rotation_rows": turn.tolist(), "translation_m": list(at_m)},
        "frames": [{"stamp_ns": frame["stamp_ns"], "rgb": sha(frame["rgb"][:, :, :: frame["order"]]), "depth": sha(frame["depth"]),
                    "max_rad_per_s": max(np.float32(frame["gyro_rad_per_s"]).tolist())} for frame in frames],
    }


def pair(folder):
    random = np.random.default_rng(5)
    scene = boxes(random)
    colours = random.integers(3, 16, (len(scene) + 1, 6, 3)) * 16.0
    left_from_right = (rotation(2.0, 35.0, -1.5), np.array([0.22, 0.012, -0.03]))
    cameras = {
        "left": {"serial": "0123456789", "in_rig": (np.eye(3), np.zeros(3))},
        "right": {"serial": "042222070001", "in_rig": left_from_right},
    }
    expected = {}
    for number, (name, camera) in enumerate(cameras.items()):
        camera |= {"firmware": "5.16.0.1", "unit_m": UNIT_M, "domain": rs.timestamp_domain.global_time, "format": rs.format.rgb8,
                   "color": intrinsics(COLOR, 308.0 + number), "depth": intrinsics(DEPTH, 160.0 + number),
                   "color_from_depth": (rotation(0.2, -0.3, 0.4 + number), np.array([0.015, 0.0004, -0.0003]))}
        frames = []
        for view in range(N_SETS):
            room_from_rig = (rotation(-6 + 11 * (view % 3), 30.0 * view + 7 * (view % 2), 6 - 4 * (view % 4)),
                             np.array([0.5 * np.sin(2.0 * view), 0.15 * np.sin(view), 0.5 * np.cos(3.1 * view)]))
            room_from_color = compose(room_from_rig, camera["in_rig"])
            _, colour = look(scene, colours, room_from_color, grid(camera["color"], 3))
            rgb = colour.reshape(COLOR[1], COLOR[0], 9, 3).mean(axis=2).round().astype(np.uint8)
            room_from_depth = compose(room_from_color, camera["color_from_depth"])
            depth_m, _ = look(scene, colours, room_from_depth, grid(camera["depth"], 1))
            counts = (depth_m / UNIT_M).round().astype(np.uint16).reshape(DEPTH[1], DEPTH[0])
            ms = FIRST_MS + PERIOD_MS * view + 0.5 * number
            rates = [0.01 * (view + number) + 0.002 * sample for sample in range(GYRO_PER_FRAME)]
            frames.append({"ms": ms, "stamp_ns": round(ms * 1e6), "arrival_ms": ms + 20, "rgb": rgb, "depth": counts, "late": 1,
                           "order": 1, "gyro_rad_per_s": rates, "gyro_ms": ms - 10})
        write(folder / f"{name}.bag", camera, frames)
        expected[name] = told(camera, frames)
    turn, at_m = left_from_right
    truth = f"poses:\n  left: {{translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}}\n" \
            f"  right: {{translation_m: {at_m.tolist()}, quaternion_xyzw: {quaternion_xyzw(turn)}}}\n"
    (folder / "ground_truth.yaml").write_text(truth)
    return expected


def quaternion_xyzw(turn):
    w = np.sqrt(1 + np.trace(turn)) / 2
    axis = (turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
    return [float(part / (4 * w)) for part in axis] + [float(w)]


def wrap(folder):
    """A clock that counts microseconds in 32 bits and begins again after the third frame; a lens; bgr8."""
    camera = {"serial": "7", "firmware": "5.12.7.150", "unit_m": 0.001, "domain": rs.timestamp_domain.hardware_clock,
              "format": rs.format.bgr8, "color": intrinsics((48, 32), 40.0, rs.distortion.inverse_brown_conrady,
                                                           (0.125, -0.25, 0.001, 0.002, 0.0625)),
              "depth": intrinsics((32, 24), 20.0, rs.distortion.brown_conrady),
              "color_from_depth": (rotation(0.0, 5.0, 0.0), np.array([0.015, 0.0, 0.0]))}
    wrap_ms, frames = 2**32 / 1000, []
    for number in range(6):
        ms = wrap_ms - 90.0 + 33.25 * number
        rgb = np.add.outer(np.arange(32) * 7, np.arange(48 * 3) * (number + 1)).astype(np.uint8).reshape(32, 48, 3)
        depth = np.add.outer(np.arange(24), 30 * np.arange(32) + 700 * number).astype(np.uint16)
        frames.append({"ms": ms % wrap_ms, "stamp_ns": round(ms * 1e6), "arrival_ms": FIRST_MS + ms, "rgb": rgb, "depth": depth,
                       "late": 0, "order": -1, "gyro_rad_per_s": [0.5 + number], "gyro_ms": (ms - 5) % wrap_ms})
    write(folder / "wrap.bag", camera, frames)
    return told(camera, frames)


def main():
    folder = Path(sys.argv[1])
    for name in ("pair", "single"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    expected = pair(folder / "pair") | {"wrap": wrap(folder / "single")}
    (folder / "expected.json").write_text(json.dumps(expected, indent=1) + "\n")


main()
