#!/usr/bin/env python3
"""Checks what `pelical match --json` printed: precision and recall of its matches.

usage: check_matching.py FILE PRECISION RECALL      the least that is allowed, 0 to 1; exit 1 below
"""

import json
import sys


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    with open(sys.argv[1], encoding="utf-8") as file:
        document = json.load(file)
    failed = False
    for name, least in zip(("precision", "recall"), map(float, sys.argv[2:])):
        found = document[name]
        is_enough = found is not None and found >= least
        failed |= not is_enough
        print(f"{name} {'unknown' if found is None else round(found, 3)}, at least {least}{'' if is_enough else ': TOO LOW'}")
    print("counts", document["counts"], "timing_ms", document["timing_ms"])
    sys.exit(failed)


if __name__ == "__main__":
    main()
