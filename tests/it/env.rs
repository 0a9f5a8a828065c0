//! What every black-box test needs: a folder and an instance name of its own, the built programs, and nothing left behind.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Longest wait for anything; a hang is a failure, a slow machine is not.
pub const PATIENCE: Duration = Duration::from_secs(120);

static NEXT: AtomicU32 = AtomicU32::new(0);

/// A test's own folder and instance name.
pub struct TestEnv {
    folder: tempfile::TempDir,
    pub instance: String,
}

impl TestEnv {
    pub fn new() -> Self {
        // Relaxed: only the count matters.
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let instance = format!("t{}-{number}", std::process::id());
        Self { folder: tempfile::tempdir().expect("a temporary folder"), instance }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file of this test.
    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).expect("written");
        path
    }

    /// Writes a config for this test's instance.
    pub fn config(&self, sections: &str) -> PathBuf {
        self.write("pelicald.yaml", &format!("instance: {}\n{sections}", self.instance))
    }

    /// The client with this test's instance, run to its end.
    pub fn pelical(&self, arguments: &[&str]) -> Ended {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pelical"));
        command.args(["--instance", &self.instance]).args(arguments);
        Ended::of(command.current_dir(self.folder.path()))
    }

    /// The daemon, run to its end.
    pub fn pelicald(&self, arguments: &[&str]) -> Ended {
        Ended::of(
            Command::new(env!("CARGO_BIN_EXE_pelicald")).args(arguments).current_dir(self.folder.path()),
        )
    }

    /// The daemon, left running.
    pub fn start_daemon(&self, config: &Path) -> Running {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pelicald"));
        Running::start(command.arg("--config").arg(config), self.path("daemon"))
    }

    /// The daemon, left running with these variables in its environment.
    pub fn start_daemon_with(&self, config: &Path, variables: &[(&str, &str)]) -> Running {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pelicald"));
        command.arg("--config").arg(config).envs(variables.iter().copied());
        Running::start(&mut command, self.path("daemon"))
    }

    /// The client with this test's instance, left running.
    pub fn start_pelical(&self, arguments: &[&str]) -> Running {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pelical"));
        command.args(["--instance", &self.instance]).args(arguments).current_dir(self.folder.path());
        Running::start(&mut command, self.path("client"))
    }

    /// Asks for the status until `accept` likes it; the last status as JSON.
    #[track_caller]
    pub fn wait_for_status(
        &self,
        what: &str,
        accept: impl Fn(&serde_json::Value) -> bool,
    ) -> serde_json::Value {
        let mut last = String::new();
        let found = poll(|| {
            let ended = self.pelical(&["status", "--json"]);
            last = format!("{}{}", ended.stdout, ended.stderr);
            (ended.code == 0).then(|| ended.json()).filter(|status| accept(status))
        });
        found.unwrap_or_else(|| panic!("no status with {what}; the last one: {last}"))
    }
}

/// Tries until there is something, at most [`PATIENCE`].
pub fn poll<T>(mut attempt: impl FnMut() -> Option<T>) -> Option<T> {
    let start = Instant::now();
    loop {
        if let Some(found) = attempt() {
            return Some(found);
        }
        if start.elapsed() > PATIENCE {
            return None;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// The first line once its end is there too: half a line is no document.
fn first_line(text: impl Fn() -> String) -> String {
    poll(|| text().split_once('\n').map(|(line, _)| line.to_owned())).expect("a whole line")
}

/// A program that has ended.
#[derive(Debug)]
pub struct Ended {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Ended {
    fn of(command: &mut Command) -> Self {
        let output: Output = command.stdin(Stdio::null()).output().expect("the program was built");
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        Self {
            code: output.status.code().unwrap_or(-1),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }

    /// Fails unless the program ended with this code.
    #[track_caller]
    pub fn expect_code(self, code: i32) -> Self {
        assert_eq!(self.code, code, "{self:#?}");
        assert!(!self.stderr.contains("panicked"), "{self:#?}");
        self
    }

    /// Fails unless stderr has every part.
    #[track_caller]
    pub fn expect_talk(self, parts: &[&str]) -> Self {
        for part in parts {
            assert!(self.stderr.contains(part), "{part:?} is not in {:?}", self.stderr);
        }
        self
    }

    /// stdout as one JSON document.
    #[track_caller]
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {self:#?}"))
    }
}

/// A program that runs; killed when dropped.
pub struct Running {
    child: Child,
    stdout: PathBuf,
    stderr: PathBuf,
}

impl Running {
    fn start(command: &mut Command, log: PathBuf) -> Self {
        // Several may run at once, each with files of its own.
        static STARTED: AtomicU32 = AtomicU32::new(0);
        let number = STARTED.fetch_add(1, Ordering::Relaxed);
        let (stdout, stderr) =
            (log.with_extension(format!("{number}.out")), log.with_extension(format!("{number}.err")));
        let file = |path: &Path| std::fs::File::create(path).expect("a log file");
        let child = command.stdin(Stdio::null()).stdout(file(&stdout)).stderr(file(&stderr)).spawn();
        Self { child: child.expect("the program was built"), stdout, stderr }
    }

    /// Sends a signal by its name, as `TERM`.
    pub fn signal(&self, name: &str) {
        use rustix::process::{Pid, Signal, kill_process};
        let signal = match name {
            "INT" => Signal::INT,
            "TERM" => Signal::TERM,
            "KILL" => Signal::KILL,
            "HUP" => Signal::HUP,
            "STOP" => Signal::STOP,
            other => panic!("no test sends {other}"),
        };
        let pid = Pid::from_raw(self.child.id() as i32).expect("a process id");
        kill_process(pid, signal).unwrap_or_else(|error| panic!("signal {name}: {error}"));
        if signal == Signal::STOP {
            // Until one thread has taken the signal, the others go on.
            poll(|| self.is_stopped().then_some(())).expect("it stops");
        }
    }

    fn is_stopped(&self) -> bool {
        let threads = std::fs::read_dir(format!("/proc/{}/task", self.child.id())).expect("it runs");
        let stat = |thread: std::io::Result<std::fs::DirEntry>| {
            std::fs::read_to_string(thread.expect("readable").path().join("stat")).unwrap_or_default()
        };
        // The state follows the name, which is in brackets.
        threads.map(stat).all(|stat| stat.rsplit_once(") ").is_none_or(|(_, rest)| rest.starts_with('T')))
    }

    /// What it has printed so far.
    pub fn printed(&self) -> String {
        std::fs::read_to_string(&self.stdout).unwrap_or_default()
    }

    /// What it has said on stderr so far.
    pub fn talk(&self) -> String {
        std::fs::read_to_string(&self.stderr).unwrap_or_default()
    }

    /// The first whole line of what it prints.
    pub fn first_printed(&self) -> String {
        first_line(|| self.printed())
    }

    /// The first whole line of what it says on stderr.
    pub fn first_talk(&self) -> String {
        first_line(|| self.talk())
    }

    /// Waits for its end; what it printed comes back.
    #[track_caller]
    pub fn wait(mut self) -> Ended {
        let status = poll(|| self.child.try_wait().expect("a child of ours"));
        let status = status.unwrap_or_else(|| panic!("it did not end: {}", self.talk()));
        Ended { code: status.code().unwrap_or(-1), stdout: self.printed(), stderr: self.talk() }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
