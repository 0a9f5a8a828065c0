#!/usr/bin/env python3
"""OpenCV's line segment detector (LSD) beside this crate's: the segments it finds, and the time it takes on one core.

    pip install opencv-python-headless
    scripts/compare_detectors.py segments RECORDING... -o FILE   then  cargo run --release --example shared_lines -- --segments FILE
    scripts/compare_detectors.py time IMAGE...   all three on the same images in one run: OpenCV, this crate and the crate lsdetect

`segments` writes per image a line `image RECORDING/CAMERA/STAMP` and lines `x1 y1 x2 y2`, px, pixel centres at whole numbers.
"""
import argparse
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np

# OpenCV's segments lie this much to the left of and above the edge, px: measured on rendered steps at many angles, and put right
# here, so that it is compared at its best.
OFFSET_PX = 0.12


def detector():
    cv2.setNumThreads(1)
    return cv2.createLineSegmentDetector()


def find(lsd, gray):
    lines = lsd.detect(gray)[0]
    return np.empty((0, 4)) if lines is None else lines.reshape(-1, 4) + OFFSET_PX


def images_of(recording):
    return sorted(p for p in Path(recording).glob("*/color/*") if p.suffix in (".jpg", ".png"))


def write_segments(args):
    lsd = detector()
    with open(args.output, "w", encoding="ascii") as out:
        for recording in args.recordings:
            for path in images_of(recording):
                gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
                name = Path(recording).resolve().name
                print(f"image {name}/{path.parent.parent.name}/{path.stem}", file=out)
                for segment in find(lsd, gray):
                    print(*(f"{value:.4f}" for value in segment), file=out)


def median_ms(rounds, work):
    times = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        times.append(1e3 * (time.process_time() - start))
    return statistics.median(times)


def compare_times(args):
    """Medians of processor time on one thread; each image by all detectors in turn, so that load falls on all alike."""
    lsd = detector()
    own = ["cargo", "run", "--quiet", "--release", "--example", "detect_time", "--", "--rounds", str(args.rounds)]
    environment = dict(os.environ, RAYON_NUM_THREADS="1")
    total = np.zeros(4)
    print("ms per image: own (gray)  own (colour)  lsdetect  OpenCV LSD")
    for image in args.images:
        gray = cv2.imread(image, cv2.IMREAD_GRAYSCALE)
        opencv_ms = median_ms(args.rounds, lambda: lsd.detect(gray))
        line = subprocess.run(own + [image], env=environment, check=True, capture_output=True, text=True).stdout
        times = np.array([float(value) for value in line.split()[-3:]] + [opencv_ms])
        total += times
        print(*(f"{value:8.2f}" for value in times), f"{gray.shape[1]}x{gray.shape[0]}", image)
    print(*(f"{value:8.2f}" for value in total / len(args.images)), "mean")
    print(f"the faster one of the others takes {min(total[2:]) / total[0]:.2f} times as long as own (gray)")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    segments = commands.add_parser("segments", help="write the segments of recordings")
    segments.add_argument("recordings", nargs="+")
    segments.add_argument("-o", "--output", required=True)
    segments.set_defaults(run=write_segments)
    times = commands.add_parser("time", help="time three detectors on images")
    times.add_argument("images", nargs="+")
    times.add_argument("--rounds", type=int, default=20)
    times.set_defaults(run=compare_times)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    sys.exit(main())
