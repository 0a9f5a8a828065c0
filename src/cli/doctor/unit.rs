//! The service unit: installed, enabled, running; and why it ended last.

use std::collections::BTreeMap;
use std::process::Command;

use super::finding::Finding;
use super::system::System;

const CHECK: &str = "unit";
const UNIT: &str = "pelicald.service";
const FOLDERS: [&str; 3] = ["/etc/systemd/system", "/usr/lib/systemd/system", "/lib/systemd/system"];

/// Whether the unit's file is there.
pub fn is_installed(system: &System) -> bool {
    FOLDERS.iter().any(|folder| system.exists(format!("{folder}/{UNIT}")))
}

/// What is to say of the unit.
pub fn check(system: &System) -> Finding {
    if !is_installed(system) {
        return Finding::ok(CHECK, format!("{UNIT} is not installed: the daemon is started by hand"));
    }
    if system.is_running && system.exists("/run/systemd/system") {
        if let Some(shown) = show() {
            return judge(&shown);
        }
        let why = ("systemctl could not be asked", "look at `systemctl status pelicald` yourself");
        return Finding::warning(CHECK, "its state is not known", why);
    }
    let wants = "/etc/systemd/system/multi-user.target.wants";
    if system.exists(format!("{wants}/{UNIT}")) {
        return Finding::ok(CHECK, format!("{UNIT} is enabled; systemd does not run here"));
    }
    let why = ("it was disabled, or never enabled", "sudo systemctl enable pelicald");
    Finding::warning(CHECK, format!("{UNIT} is installed and does not start by itself"), why)
}

fn show() -> Option<String> {
    const PROPERTIES: &str = "ActiveState,SubState,UnitFileState,Result,ExecMainStatus,NRestarts,StatusText";
    let output = Command::new("systemctl").args(["show", UNIT, "--property", PROPERTIES]).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// From what `systemctl show` prints.
fn judge(shown: &str) -> Finding {
    let values: BTreeMap<&str, &str> = shown.lines().filter_map(|line| line.split_once('=')).collect();
    let value = |key: &str| values.get(key).copied().unwrap_or("");
    let (active, sub) = (value("ActiveState"), value("SubState"));
    let restarts: u32 = value("NRestarts").parse().unwrap_or(0);
    let log = "read why: journalctl -u pelicald -n 50";
    // Between two tries of one that fails again and again.
    let is_retried = sub.starts_with("auto-restart");
    match (active, value("ExecMainStatus")) {
        ("active" | "reloading", _) if restarts > 0 => Finding::warning(
            CHECK,
            format!("running, restarted {restarts} times since it was started: {}", value("StatusText")),
            (format!("it crashed or hung; the last result was `{}`", value("Result")), log),
        ),
        ("active" | "reloading", _) if value("UnitFileState") == "disabled" => {
            let why = ("it was started by hand", "sudo systemctl enable pelicald");
            Finding::warning(CHECK, "running, but not started at boot", why)
        }
        ("active" | "reloading", _) => Finding::ok(CHECK, format!("running: {}", value("StatusText"))),
        (_, "78") => Finding::problem(
            CHECK,
            format!("{active} ({sub}): the config is wrong"),
            (
                "pelicald ended with exit code 78, and systemd does not try again",
                "pelicald --config /etc/pelical/pelicald.yaml --check-config names the line; then sudo systemctl restart pelicald",
            ),
        ),
        ("activating", _) if !is_retried => Finding::warning(
            CHECK,
            format!("starting ({sub}): {}", value("StatusText")),
            (
                "systemd waits until the daemon says that it is ready (service.ready_when of the config)",
                "ask again in a moment; what it waits for: pelical status",
            ),
        ),
        ("failed" | "activating", code) => Finding::problem(
            CHECK,
            format!("{active} ({sub}), restarted {restarts} times"),
            (format!("its last end: {}, exit code {code}", value("Result")), log),
        ),
        _ => Finding::warning(
            CHECK,
            format!("not running: {active} ({sub})"),
            ("it was stopped, or never started", "sudo systemctl enable --now pelicald"),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Grade;
    use super::*;

    #[track_caller]
    fn check_judged(shown: &str, grade: Grade, part: &str) {
        let found = judge(shown);
        assert!(found.grade == grade && found.finding.contains(part), "{found:?}");
        assert_eq!(found.cure.is_some(), grade > Grade::Ok);
    }

    #[test]
    fn each_state_of_the_unit_has_its_grade() {
        let running =
            "ActiveState=active\nSubState=running\nUnitFileState=enabled\nNRestarts=0\nStatusText=watching";
        check_judged(running, Grade::Ok, "running: watching");
        check_judged(&running.replace("NRestarts=0", "NRestarts=7"), Grade::Warning, "7 times");
        check_judged(&running.replace("enabled", "disabled"), Grade::Warning, "not started at boot");
        check_judged("ActiveState=failed\nExecMainStatus=78", Grade::Problem, "config is wrong");
        check_judged(
            "ActiveState=activating\nSubState=auto-restart\nExecMainStatus=1\nNRestarts=9",
            Grade::Problem,
            "9 times",
        );
        let starting =
            "ActiveState=activating\nSubState=start\nExecMainStatus=0\nNRestarts=0\nStatusText=collecting";
        check_judged(starting, Grade::Warning, "starting (start): collecting");
        check_judged(
            &starting.replace("=start\n", "=auto-restart-queued\n"),
            Grade::Problem,
            "auto-restart-queued",
        );
        check_judged(&running.replace("=active", "=reloading"), Grade::Ok, "running: watching");
        check_judged("ActiveState=inactive\nSubState=dead\nExecMainStatus=0", Grade::Warning, "not running");
    }
}
