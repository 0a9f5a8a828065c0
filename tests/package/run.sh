#!/usr/bin/env bash
# Builds the package, installs it into a fresh Debian, boots that with systemd and tries everything; and the udev rules besides.
# Exit code 77 says that this machine cannot do it, and why. The base root is kept in target/package-root for the next run.
#   tests/package/run.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
here=tests/package base=target/package-root root=target/package-test

for tool in systemd-nspawn debootstrap nsenter; do
    command -v "$tool" >/dev/null ||
        { echo "SKIPPED: $tool is not installed (packages systemd-container, debootstrap, util-linux)"; exit 77; }
done
[ "$(id -u)" -eq 0 ] || { echo "SKIPPED: root is needed to boot a container"; exit 77; }
cargo deb --version >/dev/null 2>&1 || { echo "SKIPPED: cargo-deb is not installed: cargo install cargo-deb --locked"; exit 77; }

$here/udev.sh || [ $? -eq 77 ]

# The newer one first and in another folder: cargo deb clears its own folder of other versions.
newer=$(scripts/package.sh --deb-version 99.0.0-1 --output target/newer/)
deb=$(scripts/package.sh)
[ -x "$base/usr/bin/systemctl" ] || { rm -rf "$base"; $here/container.sh make "$base" >"$base.log" || { tail -n 5 "$base.log"; exit 1; }; }
rm -rf "$root"
cp -a "$base" "$root"
root=$(realpath "$root")

trap '$here/container.sh down "$root"; rm -rf "$root"' EXIT
$here/container.sh up "$root" ||
    { echo "SKIPPED: systemd-nspawn cannot boot here; its last words are above"; exit 77; }
cp "$deb" "$root/srv/pelical.deb"
$here/container.sh exec "$root" apt-get install -qy --no-install-recommends /srv/pelical.deb >/dev/null
$here/unit.sh "$root"
$here/container.sh exec "$root" apt-get purge -qy pelical >/dev/null
$here/service.sh "$root" "$deb" "$newer"
