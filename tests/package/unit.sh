#!/usr/bin/env bash
# What systemd has against the unit: nothing at all, in a root with the package installed, and an exposure of at most 1.5.
#   unit.sh ROOT
set -euo pipefail
cd "$(dirname "$0")/../.."
root=$1

# Old releases only print what they do not know, and exit with 0.
said=$(systemd-analyze verify --man=no --root="$root" pelicald.service 2>&1) || said="failed: $said"
[ -z "$said" ] || { printf 'systemd-analyze verify says:\n%s\n' "$said"; exit 1; }

systemd-analyze security --offline=true --threshold=15 --no-pager systemd/pelicald.service | tail -n 1

# The check can fail: without its filter of system calls the unit is more exposed.
open=$(mktemp --suffix=.service)
trap 'rm -f "$open"' EXIT
grep -v '^SystemCallFilter=' systemd/pelicald.service >"$open"
if systemd-analyze security --offline=true --threshold=15 --no-pager "$open" >/dev/null; then
    echo "a unit without a filter of system calls passes too: the limit limits nothing"
    exit 1
fi
