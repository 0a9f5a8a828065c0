//! File systems that only the daemon sees: a mount namespace of its own, held open by a process that sleeps.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};

/// Why rows that need it are skipped elsewhere.
pub const NEEDS_ROOT: &str = "needs root, for a mount namespace (unshare, nsenter)";

/// A mount namespace; gone when dropped.
pub struct Private {
    holder: Child,
}

impl Private {
    /// Whether this machine lets us.
    pub fn is_possible() -> bool {
        let mut tried = Command::new("unshare");
        tried.args(["-m", "nsenter", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
        tried.status().is_ok_and(|status| status.success())
    }

    /// Runs a script (mounts) in a new namespace.
    pub fn new(script: &str) -> Result<Self> {
        let script = format!("{script} && echo ready && exec sleep 7200");
        let mut command = Command::new("unshare");
        command.args(["-m", "sh", "-ec", &script]).stdin(Stdio::null()).stdout(Stdio::piped());
        let mut holder = command.spawn().context("unshare")?;
        let mut said = String::new();
        let out = holder.stdout.take().context("no output")?;
        std::io::BufRead::read_line(&mut std::io::BufReader::new(out), &mut said)?;
        ensure!(said.trim() == "ready", "the mounts failed: {script}");
        Ok(Self { holder })
    }

    /// The same command inside; the process id stays that of the program.
    pub fn inside(&self, command: &Command) -> Command {
        let mut inside = Command::new("nsenter");
        inside.args(["-t", &self.holder.id().to_string(), "-m"]);
        inside.arg(command.get_program()).args(command.get_args());
        inside
    }

    /// Runs a program inside to its end.
    pub fn run(&self, program: &[&str]) -> Result<()> {
        let mut command = Command::new(program[0]);
        command.args(&program[1..]);
        let status = self.inside(&command).status()?;
        ensure!(status.success(), "{program:?}: {status}");
        Ok(())
    }

    /// A path inside as it is called outside.
    pub fn seen(&self, path: &Path) -> PathBuf {
        let root = PathBuf::from(format!("/proc/{}/root", self.holder.id()));
        root.join(path.strip_prefix("/").unwrap_or(path))
    }

    /// Writes a file until the file system is full, leaving so many bytes.
    pub fn fill(&self, folder: &Path, leave: u64) -> Result<()> {
        let folder = self.seen(folder);
        let found = rustix::fs::statvfs(&folder)?;
        let free = (found.f_bavail * found.f_frsize).saturating_sub(leave);
        let written = std::fs::write(folder.join("filler"), vec![7u8; usize::try_from(free)?]);
        ensure!(leave == 0 || written.is_ok(), "cannot fill {}", folder.display());
        // The last page, where the size was not a round one.
        if leave == 0 {
            let _ = std::fs::write(folder.join("filler2"), vec![7u8; 1 << 16]);
        }
        Ok(())
    }

    /// Removes what [`Private::fill`] wrote.
    pub fn free(&self, folder: &Path) -> Result<()> {
        let folder = self.seen(folder);
        let _ = std::fs::remove_file(folder.join("filler2"));
        Ok(std::fs::remove_file(folder.join("filler"))?)
    }
}

impl Drop for Private {
    fn drop(&mut self) {
        let _ = self.holder.kill();
        let _ = self.holder.wait();
    }
}

/// Tries until it holds; how long that took.
pub fn wait_until(what: &str, limit: Duration, mut holds: impl FnMut() -> Result<bool>) -> Result<Duration> {
    let since = Instant::now();
    while !holds()? {
        ensure!(since.elapsed() < limit, "not {what} within {limit:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(since.elapsed())
}
