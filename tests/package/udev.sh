#!/usr/bin/env bash
# The udev rules on cameras that are not there: umockdev pretends them, `udevadm test` says what the rules make of them.
# Needs root, umockdev and udev. The machine's own rules, groups and devices are not touched: a mount namespace hides them.
#   tests/package/udev.sh
set -euo pipefail
cd "$(dirname "$0")/../.."

if [ "${1:-}" != inside ]; then
    for tool in umockdev-run udevadm unshare; do
        command -v "$tool" >/dev/null || { echo "SKIPPED: $tool is not installed (packages umockdev, udev)"; exit 77; }
    done
    [ "$(id -u)" -eq 0 ] || { echo "SKIPPED: root is needed for a mount namespace"; exit 77; }
    exec unshare --mount bash "$0" inside
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p /run/udev
mount -t tmpfs tmpfs /run/udev
mkdir -p /run/udev/rules.d
cp udev/60-pelical.rules /run/udev/rules.d/
{ grep -v '^pelical:\|^plugdev:' /etc/group; echo 'pelical:x:64990:'; echo 'plugdev:x:64991:'; } >"$work/group"
chmod 644 "$work/group"
mount --bind "$work/group" /etc/group

usb=/devices/pci0000:00/0000:00:14.0/usb2/2-1
hid=$usb/2-1:1.5/0003:8086:0B3A.0001
describe() { # describe VENDOR PRODUCT: a camera with its HID parts, as umockdev wants it
    cat <<DEVICES
P: $usb
N: bus/usb/002/002
E: BUSNUM=002
E: DEVNAME=/dev/bus/usb/002/002
E: DEVNUM=002
E: DEVTYPE=usb_device
E: DRIVER=usb
E: MAJOR=189
E: MINOR=129
E: SUBSYSTEM=usb
A: idProduct=$2
A: idVendor=$1

P: $hid/hidraw/hidraw0
N: hidraw0
E: DEVNAME=/dev/hidraw0
E: MAJOR=240
E: MINOR=0
E: SUBSYSTEM=hidraw

P: $hid/HID-SENSOR-200073.1.auto/iio:device0
N: iio:device0
E: DEVNAME=/dev/iio:device0
E: DEVTYPE=iio_device
E: MAJOR=235
E: MINOR=0
E: SUBSYSTEM=iio
A: name=accel_3d

DEVICES
}

passed=0 failed=0
said() { # said VENDOR PRODUCT DEVICE: what the rules say
    describe "$1" "$2" >"$work/devices"
    umockdev-run -d "$work/devices" -- udevadm test --action=add "/sys$3" 2>&1 || true
}
check() { # check WHAT PATTERN yes|no TEXT
    local found=no
    if grep -q -- "$2" <<<"$4"; then found=yes; fi
    if [ "$found" = "$3" ]; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        printf 'FAIL %s: "%s" should be there: %s\n%s\n' "$1" "$2" "$3" "$4"
    fi
}

# Every product that the rules name.
while read -r product name; do
    text=$(said 8086 "$product" "$usb")
    check "$name" 'GROUP 64990' yes "$text"
    check "$name" 'MODE 0660' yes "$text"
    check "$name" "PELICAL_CAMERA=$name\$" yes "$text"
    check "$name" 'TAGS=.*:systemd:' yes "$text"
    check "$name" 'writing' no "$text"
done < <(sed -n 's/^ATTR{idProduct}=="\(....\)", ENV{PELICAL_CAMERA}="\(.*\)"$/\1 \2/p' udev/60-pelical.rules)

for other in '8086 0b3b' '1d6b 0b3a'; do
    # shellcheck disable=SC2086 # two words
    text=$(said $other "$usb")
    check "a device that is no camera ($other)" 'GROUP 64990\|PELICAL_CAMERA' no "$text"
done

for part in "$hid/hidraw/hidraw0" "$hid/HID-SENSOR-200073.1.auto/iio:device0"; do
    text=$(said 8086 0b3a "$part")
    check "IMU of a D435i, $part" 'GROUP 64990' yes "$text"
    check "IMU of a D435i, $part" 'MODE 0660' yes "$text"
    text=$(said 8086 0b07 "$part")
    check "the same of a D435, which has no IMU" 'GROUP 64990' no "$text"
done
text=$(said 8086 0b3a "$hid/HID-SENSOR-200073.1.auto/iio:device0")
check "sysfs of the IMU" "chgrp -R pelical /sys$hid/HID-SENSOR-200073.1.auto/iio:device0" yes "$text"

# librealsense's rules beside ours, before and behind: theirs win, and everybody may use the camera, the daemon too.
for file in 60-librealsense2-udev-rules.rules 99-realsense-libusb.rules; do
    rule='SUBSYSTEMS=="usb", ATTRS{idVendor}=="8086", ATTRS{idProduct}=="0b3a", MODE:="0666", GROUP:="plugdev"'
    echo "$rule" >"/run/udev/rules.d/$file"
    text=$(said 8086 0b3a "$usb")
    check "with $file" 'MODE 0666' yes "$text"
    check "with $file" 'PELICAL_CAMERA=D435i$' yes "$text"
    rm "/run/udev/rules.d/$file"
done

# The test can fail: a rule that sets what it should compare.
sed -i 's/ATTR{idVendor}=="8086", GOTO/ATTR{idVendor}="8086", GOTO/' /run/udev/rules.d/60-pelical.rules
check "a rule that writes to the device is noticed" 'ATTR.*writing' yes "$(said 1d6b 0b3a "$usb")"

echo "$passed checks of the udev rules passed, $failed failed"
[ "$failed" -eq 0 ]
