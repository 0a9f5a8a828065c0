//! The udev rules, and the group of those who may talk to the daemon.

use super::finding::Finding;
use super::system::{SERVICE, System};

/// The rules of this release.
const SHIPPED: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/udev/60-pelical.rules"));
const RULES: &str = "60-pelical.rules";
/// Where udev looks; of files of one name the first counts.
const FOLDERS: [&str; 5] = [
    "/etc/udev/rules.d",
    "/run/udev/rules.d",
    "/usr/local/lib/udev/rules.d",
    "/usr/lib/udev/rules.d",
    "/lib/udev/rules.d",
];

/// Whether the rules are installed, and those of this release.
pub fn udev_rule(system: &System, is_needed: bool) -> Finding {
    const CHECK: &str = "udev_rule";
    let files = FOLDERS.map(|folder| format!("{folder}/{RULES}"));
    let Some((file, text)) = files.iter().find_map(|file| Some((file, system.read(file)?))) else {
        let finding = format!("{RULES} is not installed");
        let why = (
            "without it cameras belong to root, and the service may not open them",
            "install the package, or copy udev/60-pelical.rules to /etc/udev/rules.d, then sudo udevadm control --reload && sudo \
             udevadm trigger --action=change --subsystem-match=usb",
        );
        return if is_needed {
            Finding::problem(CHECK, finding, why)
        } else {
            Finding::warning(CHECK, finding, why)
        };
    };
    if text == SHIPPED.trim() {
        return Finding::ok(CHECK, format!("{file} is that of this release"));
    }
    Finding::warning(
        CHECK,
        format!("{file} differs from that of this release"),
        (
            "an older package, or a copy made by hand, which hides the one of the package",
            format!("remove {file} if it was not changed on purpose, and install the package again"),
        ),
    )
}

/// Whether the group is there, and who asks is in it.
pub fn group(system: &System, is_needed: bool) -> Finding {
    const CHECK: &str = "group";
    let Some((gid, members)) = system.group(SERVICE) else {
        let finding = format!("there is no group `{SERVICE}`");
        let why = (
            "the package makes it; cameras and the daemon's folder belong to it",
            format!("install the package, or sudo groupadd --system {SERVICE}"),
        );
        return if is_needed {
            Finding::problem(CHECK, finding, why)
        } else {
            Finding::warning(CHECK, finding, why)
        };
    };
    if system.uid == 0 {
        return Finding::ok(CHECK, format!("there is a group `{SERVICE}`; root needs not be in it"));
    }
    let Some(user) = system.asker() else {
        return Finding::ok(
            CHECK,
            format!("there is a group `{SERVICE}`; user {} is not of this system", system.uid),
        );
    };
    let name = &user.name;
    if !members.contains(name) && !user.gids.contains(&gid) {
        return Finding::warning(
            CHECK,
            format!("{name} is not in the group `{SERVICE}`"),
            (
                "only its members may talk to the installed daemon",
                format!("sudo usermod -aG {SERVICE} {name}, then log in again"),
            ),
        );
    }
    if system.is_running && !system.gids.contains(&gid) {
        return Finding::warning(
            CHECK,
            format!("{name} is in the group `{SERVICE}`, but this session is not"),
            ("it began before the user was added", "log in again"),
        );
    }
    Finding::ok(CHECK, format!("{name} is in the group `{SERVICE}`"))
}
