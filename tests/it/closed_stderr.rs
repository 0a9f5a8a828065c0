//! Nobody listens on stderr, as behind `2>&1 | head -1`: that is no reason to fail.

use std::process::{Command, Stdio};

use crate::env::{TestEnv, poll};
use crate::fixture::Fixture;

/// A pipe without a reader.
fn broken_pipe() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

#[test]
fn commands_keep_their_exit_codes() {
    let env = TestEnv::new();
    let good = crate::synthetic_pair::recording().parent().unwrap().display().to_string();
    for (arguments, code) in
        [(&["calibrate", "nowhere"][..], 65), (&["status"], 3), (&["evaluate", &good], 0), (&["devices"], 0)]
    {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pelical"));
        command.args(["--instance", &env.instance]).args(arguments).current_dir(env.path("."));
        let status = command.stdout(Stdio::null()).stderr(broken_pipe()).status().unwrap();
        assert_eq!(status.code(), Some(code), "{arguments:?}");
    }
}

#[test]
fn the_daemon_runs_in_every_format_of_its_log() {
    for format in ["human", "json"] {
        let env = TestEnv::new();
        let fixture = Fixture::new(3);
        let config = env.config(&format!(
            "log: {{format: {format}, level: debug}}\ncameras: {{backend: replay, replay: {{recording: {}, loop: true}}}}\n",
            fixture.path().display()
        ));
        let mut command = Command::new(env!("CARGO_BIN_EXE_pelicald"));
        command.arg("--config").arg(config).stdout(Stdio::null()).stderr(broken_pipe());
        let mut daemon = command.spawn().unwrap();
        env.wait_for_status("frames", |status| status["cameras"][0]["state"] == "streaming");
        let pid = daemon.id().to_string();
        assert!(Command::new("kill").args(["-s", "TERM", &pid]).status().unwrap().success());
        let status = poll(|| daemon.try_wait().unwrap()).expect("it stops");
        assert_eq!(status.code(), Some(0), "{format}");
    }
}
