#!/usr/bin/env bash
# Builds the Debian package: scripts/package.sh [OPTIONS OF cargo deb]; its place is the last line that is printed.
# Needs cargo-deb (`cargo install cargo-deb --locked`).
set -euo pipefail
cd "$(dirname "$0")/.."

cargo build --release --locked >&2
cargo run --quiet --locked --example package_docs -- target/package-docs >&2
# The release profile keeps line tables for back traces; a robot has no use for them on its disk.
cargo deb --no-build --strip --locked "$@" | tail -n 1
