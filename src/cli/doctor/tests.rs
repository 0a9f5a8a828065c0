//! A made-up system: what the doctor says of each thing that is wrong in it.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;
use std::time::Duration;

use super::daemon::is_there;
use super::finding::{DoctorDocument, Finding, Grade};
use super::room::shared_memory;
use super::system::{Space, System, User};
use crate::ipc::{ClientError, InstanceName, Transport};

const RULES: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/udev/60-pelical.rules"));
const USB_NODE: &str = "/dev/bus/usb/002/005";
const NODES: [&str; 4] = [USB_NODE, "/dev/video4", "/dev/hidraw1", "/dev/iio:device0"];

fn examine(system: &System) -> Vec<Finding> {
    let (config, about_config) = super::daemon::config(system, None).expect("the defaults are good");
    std::iter::once(about_config).chain(super::examine(system, &config)).collect()
}

/// A system below a temporary folder, with a D435i on USB 3 and everything as it should be.
struct MadeUp {
    folder: tempfile::TempDir,
    system: System,
}

impl MadeUp {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let gid = fs::metadata(folder.path()).expect("there").gid();
        let system = System {
            root: folder.path().to_owned(),
            uid: 77_001,
            gids: vec![gid],
            is_running: false,
            space: |_| Some(Space { free: 1 << 30, total: 2 << 30 }),
        };
        let made_up = Self { folder, system };
        // Every file belongs to whoever runs the test; its group stands for `pelical` and `video` here.
        let users =
            "root:x:0:0::/:/bin/sh\npelical:x:77002:77002::/:/bin/false\nann:x:77001:100::/:/bin/sh\n";
        made_up.write("/etc/passwd", users);
        made_up.write("/etc/group", &format!("users:x:100:\npelical:x:{gid}:pelical,ann\n"));
        let device = "/sys/bus/usb/devices/2-1";
        for (name, text) in [
            ("idVendor", "8086\n"),
            ("idProduct", "0b3a\n"),
            ("speed", "5000\n"),
            ("serial", "012345678901\n"),
            ("busnum", "2\n"),
            ("devnum", "5\n"),
        ] {
            made_up.write(&format!("{device}/{name}"), text);
        }
        for node in [
            "2-1:1.0/video4linux/video4",
            "2-1:1.5/0003:8086:0B3A.0001/hidraw/hidraw1",
            "2-1:1.5/0003:8086:0B3A.0001/HID-SENSOR-200073.1/iio:device0",
        ] {
            fs::create_dir_all(made_up.at(&format!("{device}/{node}"))).expect("made");
        }
        made_up.write("/sys/bus/usb/devices/1-3/idVendor", "046d\n");
        made_up.write("/sys/bus/usb/devices/1-3/idProduct", "c52b\n");
        for node in NODES {
            made_up.write(node, "");
            made_up.set_mode(node, 0o660);
        }
        made_up.write("/usr/lib/udev/rules.d/60-pelical.rules", RULES);
        made_up.write("/usr/lib/systemd/system/pelicald.service", "[Unit]\n");
        made_up.write("/etc/systemd/system/multi-user.target.wants/pelicald.service", "[Unit]\n");
        made_up.write("/run/systemd/timesync/synchronized", "");
        made_up.write("/etc/pelical/pelicald.yaml", "ipc: {variant: file}\n");
        for folder in ["/run/pelical", "/var/lib/pelical", "/dev/shm"] {
            fs::create_dir_all(made_up.at(folder)).expect("made");
            made_up.set_mode(folder, 0o770);
        }
        made_up
    }

    fn at(&self, absolute: &str) -> std::path::PathBuf {
        self.folder.path().join(absolute.trim_start_matches('/'))
    }

    fn write(&self, absolute: &str, text: &str) {
        let file = self.at(absolute);
        fs::create_dir_all(file.parent().expect("a folder")).expect("made");
        fs::write(file, text).expect("written");
    }

    fn remove(&self, absolute: &str) {
        fs::remove_file(self.at(absolute)).expect("it was there");
    }

    fn set_mode(&self, absolute: &str, mode: u32) {
        fs::set_permissions(self.at(absolute), fs::Permissions::from_mode(mode)).expect("set");
    }

    fn examine(&self) -> Vec<Finding> {
        examine(&self.system)
    }

    /// The findings of one check; each that is not good has cause and cure.
    fn findings(&self, check: &str) -> Vec<Finding> {
        let all = self.examine();
        for finding in &all {
            let is_wrong = finding.grade > Grade::Ok;
            assert_eq!(
                (finding.cause.is_some(), finding.cure.is_some()),
                (is_wrong, is_wrong),
                "{finding:?}"
            );
        }
        all.into_iter().filter(|finding| finding.check == check).collect()
    }

    #[track_caller]
    fn check(&self, check: &str, grade: Grade, parts: &[&str]) {
        let found = self.findings(check);
        let is_it = |finding: &Finding| {
            let text = format!("{finding:?}");
            finding.grade == grade && parts.iter().all(|part| text.contains(part))
        };
        assert!(found.iter().any(is_it), "{grade:?} {parts:?}: {found:#?}");
    }
}

#[test]
fn a_system_in_order_has_neither_problem_nor_warning() {
    let findings = MadeUp::new().examine();
    assert!(findings.iter().all(|finding| finding.grade == Grade::Ok), "{findings:#?}");
    for check in [
        "devices",
        "usb_speed",
        "permissions",
        "udev_rule",
        "group",
        "clock",
        "unit",
        "versions",
        "config",
        "state_directory",
    ] {
        assert!(findings.iter().any(|finding| finding.check == check), "no finding of {check}");
    }
    assert_eq!(
        findings.iter().filter(|finding| finding.check == "usb_speed").count(),
        1,
        "a mouse is no camera"
    );
}

#[test]
fn a_camera_at_usb_2_is_a_problem_with_its_name_and_cure() {
    let made_up = MadeUp::new();
    made_up.write("/sys/bus/usb/devices/2-1/speed", "480\n");
    made_up.check("usb_speed", Grade::Problem, &["D435i (2-1, 012345678901)", "480", "USB 3 cable"]);
    made_up.remove("/sys/bus/usb/devices/2-1/speed");
    made_up.check("usb_speed", Grade::Warning, &["not known"]);
}

#[test]
fn a_camera_in_recovery_mode_is_told() {
    let made_up = MadeUp::new();
    made_up.write("/sys/bus/usb/devices/2-1/idProduct", "0adb\n");
    made_up.check("devices", Grade::Problem, &["D4xx-recovery", "firmware"]);
}

#[test]
fn every_node_that_the_service_may_not_use_is_named() {
    for node in NODES {
        let made_up = MadeUp::new();
        made_up.set_mode(node, 0o600);
        made_up.check("permissions", Grade::Problem, &["D435i", node, "mode 0600", "udevadm"]);
        made_up.set_mode(node, 0o606);
        made_up.check("permissions", Grade::Problem, &[node]);
        made_up.remove(node);
        made_up.check("permissions", Grade::Problem, &[node, "not there"]);
    }
    // As librealsense's own rules have it.
    let made_up = MadeUp::new();
    made_up.write("/etc/group", "users:x:100:\npelical:x:77002:ann\n");
    made_up.check("permissions", Grade::Problem, &[USB_NODE]);
    NODES.iter().for_each(|node| made_up.set_mode(node, 0o666));
    made_up.check("permissions", Grade::Ok, &["all 4 nodes"]);
}

#[test]
fn owner_group_and_others_count_as_the_kernel_counts_them() {
    let rights = |mode| super::system::Rights { uid: 5, gid: 50, mode };
    let user = |uid, gid| User { name: "x".into(), uid, gids: vec![gid] };
    assert!(user(5, 1).may_use(rights(0o600)) && !user(5, 50).may_use(rights(0o066)));
    assert!(user(6, 50).may_use(rights(0o060)) && !user(6, 50).may_use(rights(0o606)));
    assert!(user(6, 51).may_use(rights(0o006)) && !user(6, 51).may_use(rights(0o664)));
    assert!(user(0, 0).may_use(rights(0)));
}

#[test]
fn a_missing_or_changed_rule_is_told() {
    let made_up = MadeUp::new();
    made_up.write("/etc/udev/rules.d/60-pelical.rules", "# nothing\n");
    made_up.check("udev_rule", Grade::Warning, &["/etc/udev/rules.d/60-pelical.rules differs"]);
    made_up.remove("/etc/udev/rules.d/60-pelical.rules");
    made_up.check("udev_rule", Grade::Ok, &["/usr/lib/udev/rules.d"]);
    made_up.remove("/usr/lib/udev/rules.d/60-pelical.rules");
    made_up.check("udev_rule", Grade::Problem, &["not installed", "udevadm control --reload"]);
    // Nothing needs the rules where there is no camera.
    made_up.write("/sys/bus/usb/devices/2-1/idVendor", "046d\n");
    made_up.check("udev_rule", Grade::Warning, &["not installed"]);
}

#[test]
fn the_group_and_its_members_are_looked_at() {
    let made_up = MadeUp::new();
    made_up.write("/etc/group", "users:x:100:\npelical:x:90:bob\n");
    made_up.check("group", Grade::Warning, &["ann is not in the group", "usermod -aG pelical ann"]);
    made_up.write("/etc/group", "users:x:100:\n");
    made_up.check("group", Grade::Problem, &["no group `pelical`"]);
    let of_root = MadeUp { system: System { uid: 0, ..made_up.system.clone() }, ..MadeUp::new() };
    let of_root =
        MadeUp { system: System { root: of_root.folder.path().to_owned(), ..of_root.system }, ..of_root };
    of_root.check("group", Grade::Ok, &["root"]);
}

#[test]
fn a_full_or_missing_memory_file_system_is_told() {
    let mut made_up = MadeUp::new();
    let files = Transport::files("/run/pelical");
    let check = |made_up: &MadeUp, transport: &Transport, is_daemon_there, (grade, part): (Grade, &str)| {
        let found = shared_memory(&made_up.system, transport, is_daemon_there);
        assert!(found.grade == grade && found.finding.contains(part), "{part:?}: {found:?}");
    };
    made_up.system.space = |_| Some(Space { free: 31 << 20, total: 64 << 20 });
    let for_a_start = "has 31744 KiB of 64 MiB free, the daemon needs 32768 KiB";
    for transport in [&files, &Transport::SharedMemory] {
        check(&made_up, transport, false, (Grade::Problem, for_a_start));
        check(&made_up, transport, true, (Grade::Ok, "has 31 of 64 MiB free"));
    }
    made_up.system.space = |_| Some(Space { free: 100 << 10, total: 64 << 20 });
    check(&made_up, &files, true, (Grade::Problem, "has 100 KiB of 64 MiB free, a client needs 256 KiB"));
    fs::remove_dir(made_up.at("/dev/shm")).expect("it was there");
    check(&made_up, &Transport::SharedMemory, false, (Grade::Problem, "/dev/shm is not there"));
}

#[test]
fn only_a_daemon_that_is_not_there_gives_its_memory_back() {
    let instance = InstanceName::default();
    assert!(!is_there(&Err(ClientError::NotRunning { instance: instance.clone() })));
    let hangs = Err(ClientError::NoAnswer { instance: instance.clone(), waited: Duration::ZERO });
    assert!(is_there(&hangs));
    let full = Err(ClientError::NoRoom { instance: instance.clone(), free: 0, needed: 1 });
    let found = super::daemon::daemon(&instance, &full, true);
    assert!(is_there(&full) && found.cure.is_some_and(|cure| cure.contains("`shared_memory`")));
}

#[test]
fn a_state_directory_that_cannot_be_written_or_is_full_is_told() {
    let mut made_up = MadeUp::new();
    made_up.set_mode("/var/lib/pelical", 0o750);
    made_up.check("state_directory", Grade::Problem, &["cannot be written by pelical", "chown pelical"]);
    made_up.set_mode("/var/lib/pelical", 0o770);
    made_up.system.space = |_| Some(Space { free: 3 << 20, total: 64 << 20 });
    made_up.check("state_directory", Grade::Problem, &["3 MiB free", "full"]);
    fs::remove_dir(made_up.at("/var/lib/pelical")).expect("it was there");
    made_up.check("state_directory", Grade::Warning, &["not kept", "store.directory"]);
    made_up.write("/etc/pelical/pelicald.yaml", "store: {directory: /data/rig}\n");
    made_up.check("state_directory", Grade::Warning, &["/data/rig is not there"]);
}

#[test]
fn clock_and_unit_are_looked_at() {
    let made_up = MadeUp::new();
    made_up.remove("/run/systemd/timesync/synchronized");
    made_up.check("clock", Grade::Warning, &["not synchronised", "no server yet"]);
    fs::remove_dir(made_up.at("/run/systemd/timesync")).expect("it was there");
    made_up.check("clock", Grade::Warning, &["nobody keeps the clock right"]);
    made_up.write("/run/chrony/chronyd.pid", "7\n");
    made_up.check("clock", Grade::Ok, &["chrony"]);
    made_up.write("/var/lib/pelical/rig/0001.yaml", "");
    let file =
        fs::File::options().write(true).open(made_up.at("/var/lib/pelical/rig/0001.yaml")).expect("there");
    let future = std::time::SystemTime::now() + std::time::Duration::from_secs(7200);
    file.set_modified(future).expect("set");
    made_up.check("clock", Grade::Warning, &["future", "set back"]);
    made_up.remove("/etc/systemd/system/multi-user.target.wants/pelicald.service");
    made_up.check("unit", Grade::Warning, &["does not start by itself", "systemctl enable"]);
}

#[test]
fn a_wrong_config_is_named_with_its_line_and_the_rest_is_still_looked_at() {
    let made_up = MadeUp::new();
    made_up.write("/etc/pelical/pelicald.yaml", "log: {}\nsync:\n  max_skew_ms: fast\n");
    made_up.check("config", Grade::Problem, &["pelicald.yaml:3: sync.max_skew_ms", "correct that line"]);
    made_up.check("usb_speed", Grade::Ok, &["5000"]);
}

#[test]
fn each_kind_of_unusable_config_has_a_cure_of_its_own() {
    let made_up = MadeUp::new();
    let cure = |file: &Path| {
        let (_, finding) = super::daemon::config(&made_up.system, Some(file)).expect("the defaults are good");
        assert_eq!(finding.grade, Grade::Problem);
        finding.cure.expect("a problem has one")
    };
    assert!(cure(&made_up.at("/nowhere.yaml")).contains("--config"));
    assert!(cure(&made_up.at("/etc")).contains("text file"));
    fs::write(made_up.at("/etc/latin.yaml"), b"# \xe9\n{}\n").expect("written");
    assert!(cure(&made_up.at("/etc/latin.yaml")).contains("UTF-8"));
    made_up.write("/etc/typo.yaml", "sink: {}\n");
    assert!(cure(&made_up.at("/etc/typo.yaml")).contains("correct that line"));
    if !crate::capture::realsense::IS_BUILT_IN {
        made_up.write("/etc/cameras.yaml", "cameras: {backend: realsense}\n");
        assert!(cure(&made_up.at("/etc/cameras.yaml")).contains("docs/realsense.md"));
    }
}

#[test]
fn cures_name_the_user_as_the_system_knows_it() {
    let made_up = MadeUp::new();
    let users = "root:x:0:0::/:/bin/sh\nann:x:77001:100::/:/bin/sh\n";
    made_up.write("/etc/passwd", users);
    made_up.set_mode("/var/lib/pelical", 0o500);
    made_up.check("state_directory", Grade::Problem, &["sudo chown ann /var/lib/pelical"]);
    made_up.write("/etc/passwd", "root:x:0:0::/:/bin/sh\n");
    made_up.check("state_directory", Grade::Problem, &["sudo chown 77001 /var/lib/pelical"]);
}

#[test]
fn cameras_of_the_config_that_the_back_end_lacks_are_named() {
    let made_up = MadeUp::new();
    let list = "{name: a, serial: synthetic-01}, {name: b, serial: \"007\"}";
    made_up.write("/etc/pelical/pelicald.yaml", &format!("cameras: {{list: [{list}]}}\n"));
    made_up.check("devices", Grade::Problem, &["not there: b (007)", "synthetic-01, synthetic-02"]);
    made_up.write("/etc/pelical/pelicald.yaml", "cameras: {backend: replay, replay: {recording: gone}}\n");
    made_up.check("devices", Grade::Problem, &["back end of the config cannot be used", "gone"]);
}

#[test]
fn libraries_are_looked_for_where_the_config_needs_them() {
    let made_up = MadeUp::new();
    made_up.write("/usr/lib/x86_64-linux-gnu/librealsense2.so.2.56.5", "");
    made_up.check("versions", Grade::Ok, &["librealsense2.so.2.56.5", "needs none"]);
    made_up.write(
        "/etc/pelical/pelicald.yaml",
        "matcher: {runtime: /opt/libonnxruntime.so, models: [/opt/m.onnx]}\n",
    );
    made_up.check("versions", Grade::Problem, &["no file /opt/libonnxruntime.so"]);
    made_up.write("/opt/libonnxruntime.so", "");
    made_up.check("versions", Grade::Problem, &["no file /opt/m.onnx"]);
    made_up.write("/opt/m.onnx", "");
    made_up.check("versions", Grade::Ok, &["ONNX Runtime: /opt/libonnxruntime.so"]);
}

#[test]
fn the_newest_librealsense_that_is_there_counts_and_an_old_one_is_a_problem() {
    use std::os::unix::fs::symlink;

    let made_up = MadeUp::new();
    let check = |grade: Grade, part: &str| {
        let found = super::versions::librealsense(&made_up.system, true);
        let text = format!("{found:?}");
        assert!(found.grade == grade && text.contains(part), "{part:?}: {text}");
    };
    let folder = "/usr/lib/x86_64-linux-gnu";
    fs::create_dir_all(made_up.at(folder)).expect("made");
    symlink("gone.so", made_up.at(&format!("{folder}/librealsense2.so.2.99.0"))).expect("made");
    symlink("librealsense2.so.2.98", made_up.at(&format!("{folder}/librealsense2.so.2.98"))).expect("made");
    check(Grade::Problem, "not installed");
    made_up.write(&format!("{folder}/librealsense2.so"), "");
    check(Grade::Warning, "unknown version");
    made_up.write(&format!("{folder}/librealsense2.so.2.9.0"), "");
    check(Grade::Problem, "2.9.0 is too old");
    check(Grade::Problem, "install librealsense2 2.56 or newer");
    // Longer, older, and in a folder with a longer name.
    made_up.write(&format!("{folder}/librealsense2.so.2.50.12345"), "");
    made_up.write("/opt/librealsense2.so.2.56.5", "");
    // As the image has it, not this machine.
    symlink("/opt/librealsense2.so.2.56.5", made_up.at("/usr/lib/librealsense2.so.2.56")).expect("made");
    check(Grade::Ok, "/opt/librealsense2.so.2.56.5");
    assert!(crate::capture::realsense::how_to_build().contains("2.56"));
}

#[test]
fn the_worst_finding_grades_the_whole_and_the_text_has_cause_and_cure() {
    let made_up = MadeUp::new();
    assert_eq!(DoctorDocument::new(made_up.examine()).grade, Grade::Ok);
    made_up.write("/sys/bus/usb/devices/2-1/speed", "480\n");
    let document = DoctorDocument::new(made_up.examine());
    assert_eq!((document.grade, document.schema), (Grade::Problem, "pelical.doctor/1"));
    let text = document.text();
    for part in [
        "PROBLEM: usb_speed: D435i",
        "cause: a USB 2 cable",
        "cure:  use a USB 3 port",
        "1 problems, 0 warnings",
    ] {
        assert!(text.contains(part), "{part:?} is not in {text}");
    }
}

#[test]
fn an_empty_root_is_looked_at_to_the_end() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let system = System { root: Path::new(folder.path()).to_owned(), ..MadeUp::new().system };
    let findings = examine(&system);
    assert!(findings.len() > 8, "{findings:#?}");
}
