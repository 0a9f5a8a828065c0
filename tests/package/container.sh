#!/usr/bin/env bash
# A Debian root, booted with systemd in a container; no systemd of the host is needed, only root and systemd-nspawn.
#   container.sh make ROOT               a fresh root, by debootstrap from the host's own mirror
#   container.sh up ROOT                 boots it, until systemd says that it runs
#   container.sh exec ROOT COMMAND...    runs a command in it
#   container.sh down ROOT
set -euo pipefail
verb=$1 root=$2
shift 2
packages=systemd,systemd-sysv,udev,dbus,libpam-systemd,kmod

case $verb in
make)
    mirror=$(apt-get indextargets --format '$(REPO_URI) $(CODENAME)' 'Created-By: Packages' |
        awk '$2 == "bookworm" { print $1; exit }')
    [ -n "$mirror" ] || { echo "apt's sources name no mirror of Debian 12 (bookworm)" >&2; exit 1; }
    debootstrap --variant=minbase --include="$packages" bookworm "$root" "$mirror"
    ;;
up)
    systemd-nspawn --quiet --register=no --keep-unit -D "$root" --hostname=robot --boot </dev/null >"$root.console" 2>&1 &
    nspawn=$!
    echo "$nspawn" >"$root.pid"
    for _ in $(seq 600); do
        leader=$(ps -o pid= --ppid "$nspawn" | head -n 1 | tr -d ' ' || true)
        if [ -n "$leader" ] && [ -S "/proc/$leader/root/run/systemd/private" ]; then
            echo "$leader" >"$root.leader"
            state=$(nsenter -t "$leader" -a -- systemctl is-system-running --wait 2>/dev/null || true)
            [ "$state" = running ] && exit 0
            echo "the container is $state" >&2
            nsenter -t "$leader" -a -- systemctl --no-pager --failed >&2
            exit 1
        fi
        kill -0 "$nspawn" 2>/dev/null || { tail -n 5 "$root.console" >&2; exit 1; }
        sleep 0.1
    done
    echo "the container did not boot within a minute" >&2
    exit 1
    ;;
exec)
    exec nsenter -t "$(cat "$root.leader")" -a -- env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 \
        TERM=dumb DEBIAN_FRONTEND=noninteractive SYSTEMD_PAGER= "$@"
    ;;
down)
    [ -f "$root.pid" ] || exit 0
    nspawn=$(cat "$root.pid")
    kill -TERM "$nspawn" 2>/dev/null || true
    for _ in $(seq 300); do
        kill -0 "$nspawn" 2>/dev/null || break
        sleep 0.1
    done
    kill -KILL "$nspawn" 2>/dev/null || true
    rm -f "$root.pid" "$root.leader"
    # What nspawn leaves behind where no systemd runs the machine; another container's are not empty and stay.
    find /sys/fs/cgroup/{systemd,unified}/{payload,supervisor} -depth -type d -exec rmdir {} \; 2>/dev/null || true
    ;;
*)
    echo "what is $verb?" >&2
    exit 2
    ;;
esac
