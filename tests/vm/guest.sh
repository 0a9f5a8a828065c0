#!/bin/bash
# In the virtual machine: a USB gadget with the ids of a D435i, plugged into the dummy host controller of the same kernel.
exec >/dev/ttyS0 2>&1
failed=0
check() { # check WHAT COMMAND...
    local what=$1 end=$((SECONDS + 240))
    shift
    until "$@" >/dev/null 2>&1; do
        [ "$SECONDS" -lt "$end" ] || { echo "VM: FAIL $what"; "$@"; failed=1; return; }
        sleep 0.5
    done
    echo "VM: ok   $what"
}
node() { # the camera's device node
    local device
    for device in /sys/bus/usb/devices/*; do
        if [ "$(cat "$device/idVendor" 2>/dev/null):$(cat "$device/idProduct" 2>/dev/null)" = 8086:0b3a ]; then
            printf '/dev/bus/usb/%03d/%03d\n' "$(cat "$device/busnum")" "$(cat "$device/devnum")"
            return
        fi
    done
    return 1
}
is_ours() { [ "$(stat -c '%U:%G %a' "$(node)")" = 'root:pelical 660' ]; }
is_named() { udevadm info --name "$(node)" | grep -q 'PELICAL_CAMERA=D435i'; }
is_readable_by() { runuser -u "$1" -- head -c 1 "$(node)"; }
is_gone() { ! node; }

# An emulated processor takes longer to render one frame than any camera may take to deliver one.
mkdir -p /run/systemd/system/pelicald.service.d
printf '[Service]\nWatchdogSec=10min\nTimeoutStartSec=10min\n' >/run/systemd/system/pelicald.service.d/slow.conf
systemctl daemon-reload
systemctl start systemd-udevd.service
systemctl start --no-block pelicald.service
modprobe dummy_hcd
modprobe libcomposite
mount -t configfs none /sys/kernel/config 2>/dev/null
gadget=/sys/kernel/config/usb_gadget/d435i
mkdir -p "$gadget" && cd "$gadget" || exit 1
echo 0x8086 >idVendor
echo 0x0b3a >idProduct
mkdir -p strings/0x409 configs/c.1 functions/SourceSink.0
echo 'Intel(R) RealSense(TM) Depth Camera 435i' >strings/0x409/product
echo 012345678901 >strings/0x409/serialnumber
ln -s functions/SourceSink.0 configs/c.1/
port=$(ls /sys/class/udc | head -n 1)

for time in plugged 'plugged again'; do
    echo "$port" >UDC
    check "$time: the node belongs to root and the group, 0660" is_ours
    check "$time: it is named" is_named
    check "$time: the daemon's user may read it" is_readable_by pelical
    if is_readable_by stranger 2>/dev/null; then echo "VM: FAIL $time: a stranger may read it"; failed=1; fi
    echo '' >UDC
    check "unplugged: the node is gone" is_gone
done
check "the service runs all the while" systemctl is-active pelicald
check "and was started once" test "$(systemctl show -p NRestarts --value pelicald)" = 0
if [ "$failed" -eq 0 ]; then echo "VM: all passed"; fi
