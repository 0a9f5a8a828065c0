#!/usr/bin/env python3
"""Checks what `pelical demo --json` or `pelical evaluate --json` printed, and prints it as a table.

usage: check_evaluation.py FILE...

The demo must have converged with every camera within its limit. Of an evaluation, no converged result may be wrong, what is not
converged must say why, and some recordings must converge within limits of their own. Exit 1 with every finding otherwise.
"""

import json
import os
import sys

# Largest error of rotation (deg) and translation (mm).
DEMO = (0.2, 5.0)
EVERY = (0.5, 15.0)
MUST_CONVERGE = {
    "office101_yaw00_b20": (0.15, 4.0),
    "lab105_stereo_near_b30": (0.15, 4.0),
    "living102_yaw60_b30_long": (0.3, 6.0),
    "kitchen103_yaw80_b45_long": (0.3, 6.0),
}


def worst(calibration):
    """Largest errors over the cameras; None where a camera has no place or there is no truth."""
    truth = calibration.get("truth") or []
    columns = [[entry[key] for entry in truth] for key in ("rotation_error_deg", "translation_error_mm")]
    return tuple(None if not column or None in column else max(column) for column in columns)


def check(name, calibration, limits, must_converge):
    """What is wrong with one calibration."""
    state, reason, errors = calibration["state"], calibration["reason"], worst(calibration)
    if state != "converged":
        if must_converge:
            yield f"{name}: {state}, but must converge: {reason}"
        if not reason or not reason.get("code") or not reason.get("sentence"):
            yield f"{name}: {state} without a reason"
    elif None in errors:
        yield f"{name}: converged, but a camera has no place or no truth"
    elif errors[0] > limits[0] or errors[1] > limits[1]:
        yield f"{name}: converged {errors[0]:.3f} deg and {errors[1]:.1f} mm off; limits {limits[0]} deg, {limits[1]} mm"


def row(name, calibration):
    """One line of the table."""
    state, reason, errors = calibration["state"], calibration["reason"], worst(calibration)
    figures = [f"{error:.{digits}f}" if error is not None else "" for error, digits in zip(errors, (3, 1))]
    total_ms = calibration["timing_ms"]["total"]
    sets = calibration["frame_sets"]
    seconds = f"{total_ms / 1e3:.1f}" if total_ms is not None else ""
    verdict = state if state == "converged" else f"{state}: {reason['code'] if reason else '?'}"
    return f"| {name} | {verdict} | {' | '.join(figures)} | {sets['used']} of {sets['seen']} | {seconds} |"


def calibrations(document):
    """Name, calibration, limits and whether it must converge, for everything in a document."""
    if document["schema"] == "pelical.calibration/1":
        yield "demo", document, DEMO, True
        return
    if document["schema"] != "pelical.evaluation/1":
        raise ValueError(f"unknown schema {document['schema']!r}")
    for recording in document["recordings"]:
        name = os.path.basename(os.path.normpath(recording["path"]))
        limits = MUST_CONVERGE.get(name, EVERY)
        yield name, recording["calibration"], limits, name in MUST_CONVERGE


def findings(document):
    """Everything wrong with a document."""
    names = set()
    for name, calibration, limits, must_converge in calibrations(document):
        names.add(name)
        yield from check(name, calibration, limits, must_converge)
    if document["schema"] == "pelical.evaluation/1":
        yield from (f"{name}: not evaluated" for name in MUST_CONVERGE if name not in names)
        if document["wrong"]:
            yield f"the program itself counts {document['wrong']} wrong"


def main(paths):
    """Checks all files; the number of findings decides the exit code."""
    wrong = []
    for path in paths:
        with open(path, encoding="utf-8") as file:
            document = json.load(file)
        print("| recording | state | deg | mm | frame sets | s |\n|---|---|---|---|---|---|")
        print("\n".join(row(name, calibration) for name, calibration, _, _ in calibrations(document)))
        wrong += findings(document)
    print("\n".join(f"WRONG: {finding}" for finding in wrong) or "all within their limits")
    return 1 if wrong else 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1:]))
