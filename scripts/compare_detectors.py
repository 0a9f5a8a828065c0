#!/usr/bin/env python3
"""OpenCV's line segment detector (LSD) beside this crate's: the segments it finds, and the time it takes on one core.

    pip install opencv-python-headless
    scripts/compare_detectors.py segments RECORDING... -o FILE   then  cargo run --release --example shared_lines -- --segments FILE
    scripts/compare_detectors.py time IMAGE_OR_RECORDING...       runs the example detect_time beside it

`segments` writes per image a line `image RECORDING/CAMERA/STAMP` and lines `x1 y1 x2 y2`, px, pixel centres at whole numbers.
"""
import argparse
import sys
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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    segments = commands.add_parser("segments", help="write the segments of recordings")
    segments.add_argument("recordings", nargs="+")
    segments.add_argument("-o", "--output", required=True)
    segments.set_defaults(run=write_segments)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    sys.exit(main())
