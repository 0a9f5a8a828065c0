//! A daemon as a process: its log with the time of each line, its memory and files, its end.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use rustix::process::{Pid, Signal, kill_process};

/// A line of the log and when it was written.
pub type Line = (Instant, String);

/// A running daemon; killed when dropped.
pub struct Daemon {
    child: Child,
    log: Arc<Mutex<Vec<Line>>>,
    pub started: Instant,
}

/// What a process holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resources {
    pub rss_kib: u64,
    pub fds: usize,
}

/// How a daemon ended.
pub struct Ended {
    /// `None`: by a signal.
    pub code: Option<i32>,
    pub took: Duration,
}

impl Daemon {
    pub fn start(mut command: Command) -> Result<Self> {
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let started = Instant::now();
        let mut child = command.spawn().with_context(|| format!("{command:?}"))?;
        let log = Arc::new(Mutex::new(Vec::new()));
        let (lines, stderr) = (Arc::clone(&log), child.stderr.take());
        std::thread::spawn(move || {
            for line in stderr.into_iter().flat_map(|stderr| BufReader::new(stderr).lines()) {
                let Ok(line) = line else { return };
                lines.lock().unwrap_or_else(PoisonError::into_inner).push((Instant::now(), line));
            }
        });
        Ok(Self { child, log, started })
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Every line so far.
    pub fn log(&self) -> Vec<Line> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The lines with all these parts.
    pub fn lines_with(&self, parts: &[&str]) -> Vec<Line> {
        let is_meant = |(_, line): &Line| parts.iter().all(|part| line.contains(part));
        self.log().into_iter().filter(is_meant).collect()
    }

    /// Waits for so many lines with all these parts; when the last of them was written.
    pub fn wait_for_lines(&self, parts: &[&str], n: usize, limit: Duration) -> Result<Instant> {
        let until = Instant::now() + limit;
        while Instant::now() < until {
            if let Some((at, _)) = self.lines_with(parts).get(n - 1) {
                return Ok(*at);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        bail!("the log does not say {parts:?} {n} times within {limit:?}: {}", self.tail())
    }

    /// The last lines, for whoever must find out.
    pub fn tail(&self) -> String {
        let log = self.log();
        let lines: Vec<&str> = log.iter().rev().take(6).rev().map(|(_, line)| line.as_str()).collect();
        lines.join(" // ")
    }

    /// Lines that no daemon may ever write.
    pub fn panics(&self) -> Vec<String> {
        let is_bad = |line: &String| line.contains("panicked") || line.contains("which is a bug");
        self.log().into_iter().map(|(_, line)| line).filter(is_bad).collect()
    }

    pub fn is_alive(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    pub fn resources(&self) -> Result<Resources> {
        let folder = std::path::PathBuf::from(format!("/proc/{}", self.pid()));
        let status = std::fs::read_to_string(folder.join("status"))?;
        let rss = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let rss = rss.and_then(|text| text.trim().trim_end_matches("kB").trim().parse().ok());
        let fds = std::fs::read_dir(folder.join("fd"))?.count();
        Ok(Resources { rss_kib: rss.context("no VmRSS")?, fds })
    }

    pub fn signal(&self, signal: Signal) -> Result<()> {
        let pid = Pid::from_raw(i32::try_from(self.pid())?).context("a process id")?;
        Ok(kill_process(pid, signal)?)
    }

    /// Waits for its end.
    pub fn wait(&mut self, limit: Duration) -> Result<Ended> {
        let since = Instant::now();
        while since.elapsed() < limit {
            if let Some(status) = self.child.try_wait()? {
                return Ok(Ended { code: status.code(), took: since.elapsed() });
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        bail!("it did not end within {limit:?}: {}", self.tail())
    }

    /// SIGTERM, as a service manager does it.
    pub fn stop(&mut self, limit: Duration) -> Result<Ended> {
        self.signal(Signal::TERM)?;
        self.wait(limit)
    }

    /// SIGKILL.
    pub fn kill(&mut self) -> Result<()> {
        self.child.kill()?;
        self.child.wait()?;
        Ok(())
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.kill();
    }
}
