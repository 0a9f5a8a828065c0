//! `pelical demo`: this program once more as the daemon of a synthetic rig, and a client that waits for its result and compares
//! it with the truth. The result comes over the same shared memory as a real one.

use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::args::Output;
use super::error::CliError;
use super::exit::Exit;
use super::online::{self, Wanted};
use super::progress;
use super::talk::say;
use crate::ipc::{Client, ClientError, InstanceName, Transport};
use crate::service::config;

/// Longest time until the daemon is there; it plans the rig's path meanwhile.
const START_WITHIN: Duration = Duration::from_secs(60);
/// Longest time until the result; about ten times what a slow machine needs.
const RESULT_WITHIN: Duration = Duration::from_secs(300);
/// How long the daemon may take to stop before it is killed.
const STOP_WITHIN: Duration = Duration::from_secs(2);
/// Between two looks.
const GLANCE: Duration = Duration::from_millis(20);

/// Runs the demo.
///
/// # Errors
/// When the daemon cannot be started, or ends before its result.
pub fn run(output: Output) -> Result<Exit, CliError> {
    let cameras = config::demo()?.cameras;
    let truth = cameras.truth(&cameras.rig(cameras.factory()?.as_ref())?);
    let instance: InstanceName = format!("demo-{}", std::process::id())
        .parse()
        .map_err(|error: crate::ipc::InstanceNameError| CliError::Failed(error.to_string()))?;
    let what = "a synthetic rig of three cameras that hardly overlap; the daemon is instance";
    say(format_args!("{what} {instance}"));
    // From here on Ctrl-C ends the wait, so that the daemon is always stopped.
    let interrupt = super::interrupt::Interrupt::register()?;
    let mut daemon = DaemonProcess::start(&instance)?;
    let mut client = daemon.connect(&instance, &interrupt)?;
    let mut verdict =
        online::await_verdict(&mut client, &Wanted { after_sequence: 0, within: RESULT_WITHIN })?;
    verdict.add_stage_times(&mut client)?;
    verdict.print(truth.as_deref(), output)
}

/// The daemon of the demo; asked to stop, then killed, when dropped.
struct DaemonProcess(Child);

impl DaemonProcess {
    fn start(instance: &InstanceName) -> Result<Self, CliError> {
        let this = std::env::current_exe().map_err(CliError::system("cannot find this program"))?;
        let child = Command::new(this)
            .args(["demo-daemon", "--instance", instance.as_str()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            // Ctrl-C on the terminal is for the client alone, which then stops the daemon.
            .process_group(0)
            .spawn();
        child.map(Self).map_err(CliError::system("cannot start the daemon"))
    }

    /// Joins the daemon as soon as it is there.
    fn connect(
        &mut self,
        instance: &InstanceName,
        interrupt: &super::interrupt::Interrupt,
    ) -> Result<Client, CliError> {
        let start = Instant::now();
        let bar = progress::spinner("starting the daemon");
        loop {
            match Client::connect_over(&Transport::SharedMemory, instance) {
                Err(ClientError::NotRunning { .. }) if start.elapsed() < START_WITHIN => {}
                connected => {
                    bar.finish_and_clear();
                    return Ok(connected?);
                }
            }
            if let Ok(Some(status)) = self.0.try_wait() {
                return Err(CliError::Failed(format!("the daemon ended at once: {status}")));
            }
            if interrupt.is_set() {
                return Err(CliError::Failed("interrupted".to_owned()));
            }
            std::thread::sleep(GLANCE);
        }
    }
}

impl Drop for DaemonProcess {
    fn drop(&mut self) {
        let pid = i32::try_from(self.0.id()).ok().and_then(rustix::process::Pid::from_raw);
        if let Some(pid) = pid {
            // An error says that it has ended already.
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
        let start = Instant::now();
        while start.elapsed() < STOP_WITHIN {
            if let Ok(Some(_)) = self.0.try_wait() {
                return;
            }
            std::thread::sleep(GLANCE);
        }
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
