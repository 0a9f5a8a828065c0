#!/usr/bin/env bash
# The installed service in a booted container: start, clients of other users, crash, freeze, hang, reload, upgrade, removal, purge.
#   service.sh ROOT DEB NEWER_DEB        (container.sh up ROOT before)
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$1 deb=$2 newer=$3
passed=0 failed=0

in_root() { "$here/container.sh" exec "$root" "$@"; }
check() { # check WHAT COMMAND...: the command has to succeed
    local what=$1 output
    shift
    if output=$("$@" 2>&1); then
        passed=$((passed + 1))
        echo "ok    $what"
    else
        failed=$((failed + 1))
        printf 'FAIL  %s\n%s\n' "$what" "$output"
    fi
}
fails() { ! "$@"; }
patiently() { # patiently SECONDS COMMAND...: until it succeeds
    local end=$((SECONDS + $1))
    shift
    until "$@" >/dev/null 2>&1; do
        [ "$SECONDS" -lt "$end" ] || { "$@"; return 1; }
        sleep 0.2
    done
}
property() { in_root systemctl show -p "$1" --value pelicald; }
is() { # is PROPERTY VALUE
    local value
    value=$(property "$1")
    [ "$value" = "$2" ] || { echo "$1 is $value"; return 1; }
}
as() { # as USER COMMAND...
    local user=$1
    shift
    in_root runuser -u "$user" -- "$@"
}
says() { # says PATTERN COMMAND...: the output has it
    local pattern=$1 output
    shift
    output=$("$@" 2>&1)
    grep -q -- "$pattern" <<<"$output" || { echo "$output"; return 1; }
}
is_new_process() { # is_new_process OLD_PID
    local pid
    pid=$(property MainPID)
    [ "$pid" != 0 ] && [ "$pid" != "$1" ] && is ActiveState active
}
has_result() { says '"state":"converged"' as robotapp sh -c 'timeout 10 pelical watch --json | head -n 1'; }
everything() { # what there is on the disk, without what changes by itself
    in_root find / -xdev \( -path /proc -o -path /sys -o -path /var/log -o -path /var/cache -o -path /var/lib/apt \) -prune -o -print |
        grep -v '^/srv/\|^/etc/\(passwd\|group\|shadow\|gshadow\|subuid\|subgid\)-$\|^/var/lib/dpkg/.*-old$' | sort
}
journal() { in_root journalctl -u pelicald --no-pager -o cat; }
install() { # install DEB
    cp "$1" "$root/srv/pelical.deb"
    in_root apt-get install -qy --no-install-recommends -o Dpkg::Options::=--force-confold /srv/pelical.deb
}
config=$root/etc/pelical/pelicald.yaml

everything >"$root.before"
check "the package is installed" install "$deb"
[ "$failed" -eq 0 ] || exit 1
check "the service is ready, with nobody's help" patiently 60 is ActiveState active
check "it is enabled" says enabled in_root systemctl is-enabled pelicald
check "it runs as its own user" is User pelical
check "no unit failed" fails in_root systemctl is-failed pelicald
check "the status is told in words" patiently 60 says '3 of 3 cameras deliver frames' property StatusText
check "manual pages are there" in_root sh -c "cd /usr/share/man; test -s man1/pelical.1.gz -a -s man1/pelical-status.1.gz -a -s man8/pelicald.8.gz"
check "completions are there" in_root test -s /usr/share/bash-completion/completions/pelical

in_root useradd -M -G pelical robotapp
in_root useradd -M stranger
# Cameras are told once a second.
check "a member of the group asks, without any option" patiently 10 says 'streaming' as robotapp pelical status
check "a stranger is refused" says 'no permission' as stranger pelical status
check "a stranger is refused with a failure" fails as stranger pelical status
check "nothing of it is in /dev/shm" fails in_root sh -c 'ls /dev/shm | grep -q iox2'
check "the synthetic rig is calibrated" patiently 300 has_result

check "and the watchdog had nothing to do so far" is NRestarts 0
pid=$(property MainPID)
in_root systemctl kill --kill-whom=main -s KILL pelicald
check "after kill -9 it is back" patiently 30 is_new_process "$pid"
check "and answers" patiently 30 as robotapp pelical status

pid=$(property MainPID) began=$SECONDS
in_root systemctl kill --kill-whom=main -s STOP pelicald
check "after SIGSTOP systemd restarts it" patiently 60 is_new_process "$pid"
echo "      within $((SECONDS - began)) s"
check "because of the watchdog" says 'Watchdog timeout' in_root journalctl -u pelicald --no-pager -o cat
check "and it answers" patiently 30 as robotapp pelical status

# A camera's driver that hangs while everything else goes on: the process lives, but one thread does not move.
cp "$config" "$root.config"
sed -i 's/^  backend: synthetic/&\n  faults: {list: [{serial: "synthetic-01", fault: hang, at_frame: 6}]}/' "$config"
check "what needs a restart is refused by a reload" in_root systemctl reload pelicald
check "and named in the log" patiently 20 says 'cameras.faults.list cannot be changed' journal
in_root systemctl restart pelicald
pid=$(property MainPID) began=$SECONDS
check "after a hang of one thread systemd restarts it" patiently 90 is_new_process "$pid"
echo "      within $((SECONDS - began)) s"
check "the log names the thread" says 'cap-front' journal
cp "$root.config" "$config"
in_root systemctl restart pelicald
check "without the fault it runs again" patiently 60 is ActiveState active

echo 'log: {level: loud}' >"$config"
check "a wrong config fails the reload" fails in_root systemctl reload pelicald
check "and the daemon goes on" as robotapp pelical status
sed 's/^  format: human/&\n  level: debug/' "$root.config" >"$config"
check "a change of the log level is taken" in_root systemctl reload pelicald
check "and said" patiently 20 says 'config read again' journal
check "it stays ready" is ActiveState active

in_root sh -c 'echo kept >/var/lib/pelical/marker'
pid=$(property MainPID)
check "the package is upgraded" install "$newer"
check "the new daemon runs" patiently 60 is_new_process "$pid"
check "the edited config is kept" grep -q 'level: debug' "$config"
check "the state is kept" in_root grep -q kept /var/lib/pelical/marker
check "clients connect again" patiently 30 as robotapp pelical status

check "it stops" in_root systemctl stop pelicald
check "cleanly" is Result success
check "its runtime directory is gone" in_root test ! -e /run/pelical
check "without it clients are told so" says 'start pelicald' as robotapp pelical status
in_root systemctl start pelicald

check "the package is removed" in_root apt-get remove -qy pelical
check "no process of it is left" fails in_root sh -c 'grep -lx pelicald /proc/[0-9]*/comm'
check "config and state stay" in_root test -e /etc/pelical/pelicald.yaml -a -e /var/lib/pelical/marker
in_root userdel robotapp
in_root userdel stranger
check "the package is purged" in_root apt-get purge -qy pelical
everything >"$root.after"
check "nothing is left on the disk" diff "$root.before" "$root.after"
check "nor its user and group" fails in_root sh -c 'getent passwd pelical || getent group pelical'

echo "$passed passed, $failed failed"
[ "$failed" -eq 0 ]
