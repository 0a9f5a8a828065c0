#!/usr/bin/env bash
# Plugs, unplugs and plugs again a fake D435i (8086:0b3a) in a virtual machine with a real kernel and a real udev, with the package
# installed. Optional: about four minutes, and 100 MB of downloads. Needs root, a booted-once base root of tests/package/run.sh, and the
# packages qemu-system-x86 busybox-static cpio e2fsprogs kmod. The kernel is Debian's, unpacked, not installed.
#   tests/vm/run.sh            exit code 77: this machine cannot do it
set -euo pipefail
cd "$(dirname "$0")/../.."
base=target/package-root work=target/vm

for tool in qemu-system-x86_64 busybox cpio mke2fs depmod; do
    command -v "$tool" >/dev/null || PATH=$PATH:/usr/sbin:/sbin command -v "$tool" >/dev/null ||
        { echo "SKIPPED: $tool is not installed"; exit 77; }
done
[ "$(id -u)" -eq 0 ] || { echo "SKIPPED: root is needed"; exit 77; }
[ -x "$base/usr/bin/systemctl" ] || { echo "SKIPPED: no base root: run tests/package/run.sh first"; exit 77; }
deb=$(ls -t target/debian/pelical_*.deb | head -n 1)

rm -rf "$work"
mkdir -p "$work/kernel" "$work/out"
kernel=$(apt-cache depends linux-image-amd64 | awk '/Depends: linux-image/ { print $2; exit }')
(cd "$work" && apt-get download "$kernel" >/dev/null && dpkg-deb -x "$kernel"_*.deb kernel)
version=$(ls "$work/kernel/lib/modules")
modules=$work/kernel/lib/modules/$version

# The guest: the base root, the package, the modules that a USB device needs.
cp -a "$base" "$work/root"
cp "$deb" "$work/root/srv/pelical.deb"
PATH=$PATH:/usr/sbin:/sbin chroot "$work/root" sh -c 'dpkg -i /srv/pelical.deb >/dev/null 2>&1 && useradd -M stranger'
mkdir -p "$work/root/usr/lib/modules/$version"
for part in modules.builtin modules.builtin.modinfo modules.order kernel/drivers/usb kernel/fs/configfs kernel/lib kernel/crypto; do
    [ -e "$modules/$part" ] || continue
    mkdir -p "$work/root/usr/lib/modules/$version/$(dirname "$part")"
    cp -a "$modules/$part" "$work/root/usr/lib/modules/$version/$(dirname "$part")/"
done
PATH=$PATH:/usr/sbin:/sbin chroot "$work/root" depmod -a "$version"
cp tests/vm/guest.sh "$work/root/srv/guest.sh"

# A small first root that finds the disk.
first=$work/first
mkdir -p "$first"/{bin,proc,sys,dev,new,m}
cp "$(command -v busybox)" "$first/bin/busybox"
order=
for module in virtio_ring virtio virtio_pci_legacy_dev virtio_pci_modern_dev virtio_pci virtio_blk crc16 mbcache jbd2 \
    crc32c_generic libcrc32c ext4; do
    file=$(find "$modules" -name "$module.ko" | head -n 1)
    [ -z "$file" ] || { cp "$file" "$first/m/"; order="$order $module"; }
done
cat >"$first/init" <<INIT
#!/bin/busybox sh
/bin/busybox mount -t proc proc /proc; /bin/busybox mount -t devtmpfs dev /dev; /bin/busybox mount -t sysfs sys /sys
for m in $order; do /bin/busybox insmod /m/\$m.ko; done
for n in $(seq -s ' ' 50); do [ -b /dev/vda ] && break; /bin/busybox sleep 0.2; done
/bin/busybox mount -t ext4 -o rw,noatime /dev/vda /new || /bin/busybox poweroff -f
/bin/busybox umount /proc; /bin/busybox umount /sys; /bin/busybox mount --move /dev /new/dev
exec /bin/busybox switch_root /new /lib/systemd/systemd
INIT
chmod +x "$first/init"
(cd "$first" && find . | cpio -o -H newc --quiet | gzip -1) >"$work/out/initrd.gz"
truncate -s 1500M "$work/out/root.img"
PATH=$PATH:/usr/sbin:/sbin mke2fs -q -t ext4 -O ^has_journal -d "$work/root" "$work/out/root.img"

accelerator=tcg,thread=multi
[ -w /dev/kvm ] && [ -n "${VM_KVM:-}" ] && accelerator=kvm
timeout -k 5 900 qemu-system-x86_64 -accel "$accelerator" -cpu max -smp 2 -m 1024 -nographic -nodefaults -no-reboot \
    -serial stdio -monitor none -nic none -kernel "$work/kernel/boot/vmlinuz-$version" -initrd "$work/out/initrd.gz" \
    -drive "file=$work/out/root.img,format=raw,if=virtio,cache=unsafe" \
    -append "console=ttyS0 quiet mitigations=off tsc=unstable random.trust_cpu=on systemd.run=/srv/guest.sh \
systemd.run_success_action=poweroff systemd.run_failure_action=poweroff systemd.show_status=0" </dev/null |
    tee "$work/console.log"
grep -q '^VM: all passed' "$work/console.log"
