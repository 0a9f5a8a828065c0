#!/usr/bin/env bash
# Builds the Debian package: scripts/package.sh [--realsense] [OPTIONS OF cargo deb]; its place is the last line that is printed.
# --realsense: with live RealSense cameras, for which librealsense has to be installed with its development files.
# Needs cargo-deb (`cargo install cargo-deb --locked`).
set -euo pipefail
cd "$(dirname "$0")/.."

features=()
if [ "${1:-}" = --realsense ]; then
    shift
    pkg-config --modversion realsense2 >/dev/null ||
        { echo "$0: pkg-config finds no realsense2: install librealsense with its development files (docs/realsense.md)" >&2; exit 1; }
    features=(--features realsense)
fi
cargo build --release --locked "${features[@]}" >&2
cargo run --quiet --locked --example package_docs -- target/package-docs >&2
# The release profile keeps line tables for back traces; a robot has no use for them on its disk.
cargo deb --no-build --strip --locked "$@" | tail -n 1
