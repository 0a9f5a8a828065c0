//! Where the campaign happens: a folder of its own, the built programs, a recording whose truth is known, and for each row a daemon with
//! an instance, a folder for clients and a state directory of its own.

use std::cell::{Cell, OnceCell};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use pelical::geometry::motion::Motion;
use pelical::ipc::{Archived, Client, ClientError, InstanceName, Response, Snapshot, Transport};

use crate::audit::Audit;
use crate::daemon::Daemon;
use crate::rig::{self, CAMERAS, SIGMA_INVERSE_DEPTH_PER_M};

/// Longest wait for what must come at some time.
pub const PATIENCE: Duration = Duration::from_secs(90);
/// Longest wait for one answer.
pub const ANSWER: Duration = Duration::from_secs(5);
/// Serial numbers of the rig.
pub const SERIALS: [&str; 3] = [CAMERAS[0].0, CAMERAS[1].0, CAMERAS[2].0];

const FIRST: &str = "calibration-000001.yaml";

/// The campaign's own place.
pub struct Site {
    folder: tempfile::TempDir,
    programs: PathBuf,
    recording: PathBuf,
    pub truth: Vec<Motion>,
    pub seed: u64,
    next: Cell<u32>,
    /// The file of a calibration that a daemon of this campaign has made; empty before the first is needed.
    made: OnceCell<Vec<u8>>,
}

/// One daemon's place.
pub struct Place {
    pub instance: InstanceName,
    pub transport: Transport,
    pub config: PathBuf,
    pub state: PathBuf,
    pub folder: PathBuf,
    programs: PathBuf,
    truth: Vec<Motion>,
}

/// What differs from place to place.
#[derive(Default)]
pub struct Wishes {
    /// Faults as the config writes them, without braces.
    pub faults: Vec<String>,
    /// Over iceoryx2's shared memory instead of files.
    pub shared_memory: bool,
    /// Frames are decoded as they are played: less memory at the start.
    pub is_lazy: bool,
    /// Calibrations that are kept.
    pub keep: u32,
    /// The section `cameras.recovery`, without braces; the default for the rest.
    pub recovery: &'static str,
    /// How long a silent camera is waited for before it is opened again, s.
    pub reopen_after_s: Option<f64>,
}

impl Site {
    /// Renders the recording; takes seconds.
    pub fn new(programs: PathBuf, seed: u64) -> Result<Self> {
        let folder = tempfile::Builder::new().prefix("flt").tempdir()?;
        let recording = folder.path().join("rig");
        let truth = rig::record(&recording, seed)?;
        Ok(Self { folder, programs, recording, truth, seed, next: Cell::new(0), made: OnceCell::new() })
    }

    /// A new place.
    pub fn place(&self, wishes: &Wishes) -> Result<Place> {
        let number = self.next.replace(self.next.get() + 1);
        let folder = self.folder.path().join(format!("p{number}"));
        let ipc = folder.join("ipc");
        let state = folder.join("state");
        std::fs::create_dir_all(&state)?;
        let instance: InstanceName = format!("faults-{}-{number}", std::process::id()).parse()?;
        let transport = if wishes.shared_memory { Transport::SharedMemory } else { Transport::files(&ipc) };
        let config = folder.join("pelicald.yaml");
        let (programs, truth) = (self.programs.clone(), self.truth.clone());
        let place = Place { instance, transport, config, state, folder, programs, truth };
        self.configure(&place, wishes)?;
        Ok(place)
    }

    /// Writes the config of a place, for its next daemon.
    pub fn configure(&self, place: &Place, wishes: &Wishes) -> Result<()> {
        Ok(std::fs::write(&place.config, self.text(wishes, (&place.instance, &place.transport)))?)
    }

    /// Puts a calibration of an earlier run, number 1, into a place.
    pub fn put_calibration(&self, place: &Place) -> Result<()> {
        let made = match self.made.get() {
            Some(made) => made,
            None => {
                let made = self.make_calibration()?;
                self.made.get_or_init(|| made)
            }
        };
        std::fs::create_dir_all(place.kept())?;
        Ok(std::fs::write(place.kept().join(FIRST), made)?)
    }

    fn make_calibration(&self) -> Result<Vec<u8>> {
        let place = self.place(&Wishes::default())?;
        let mut daemon = place.start()?;
        let file = place.kept().join(FIRST);
        let until = Instant::now() + PATIENCE;
        while !file.exists() {
            ensure!(Instant::now() < until, "no calibration: {}", daemon.tail());
            std::thread::sleep(Duration::from_millis(20));
        }
        daemon.stop(PATIENCE)?;
        // Its folder carries the name of another instance; the file does not.
        Ok(std::fs::read(file)?)
    }

    fn text(&self, wishes: &Wishes, (instance, transport): (&InstanceName, &Transport)) -> String {
        let ipc = match transport {
            Transport::SharedMemory => "{variant: default}".to_owned(),
            Transport::Files { directory } => {
                format!("{{variant: file, directory: {}}}", directory.display())
            }
        };
        let listed = CAMERAS.map(|(serial, name, ..)| format!("{{name: {name}, serial: {serial}}}"));
        let faults: Vec<String> = wishes.faults.iter().map(|fault| format!("{{{fault}}}")).collect();
        format!(
            "instance: {instance}\nipc: {ipc}\ncameras:\n  backend: replay\n  replay: {{recording: {}, loop: true, preload: {}}}\n  \
             list: [{}]\n  recovery: {{{}}}\n  faults: {{seed: {}, list: [{}]}}\n\
             sync: {{stalled_after_ms: 700.0, reopen_after_ms: {:.1}, wait_ms: 500.0}}\n\
             lines: {{sigma_inverse_depth_per_m: {SIGMA_INVERSE_DEPTH_PER_M}}}\nestimate: {{min_new_sets: 10}}\nstore: {{directory: state, keep: {}}}\n",
            self.recording.display(),
            !wishes.is_lazy,
            listed.join(", "),
            wishes.recovery,
            self.seed,
            faults.join(", "),
            1e3 * wishes.reopen_after_s.unwrap_or(10.0),
            if wishes.keep == 0 { 50 } else { wishes.keep },
        )
    }
}

impl Place {
    /// How the daemon is started.
    pub fn command(&self) -> Command {
        let mut command = Command::new(self.program("pelicald"));
        command.arg("--config").arg(&self.config);
        command
    }

    /// One of the built programs.
    pub fn program(&self, name: &str) -> PathBuf {
        self.programs.join(name)
    }

    pub fn start(&self) -> Result<Daemon> {
        Daemon::start(self.command())
    }

    /// Looks at everything that is published from now on.
    pub fn audit(&self) -> Audit {
        Audit::start(self.transport.clone(), self.instance.clone(), self.truth.clone())
    }

    /// Connects as soon as there is a daemon.
    pub fn client(&self, limit: Duration) -> Result<Client> {
        let until = Instant::now() + limit;
        loop {
            match self.try_client() {
                Ok(client) => return Ok(client),
                Err(error) if Instant::now() >= until => bail!("no daemon within {limit:?}: {error}"),
                // A look costs the daemon time of the same processor.
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    }

    pub fn try_client(&self) -> Result<Client, ClientError> {
        Client::connect_over(&self.transport, &self.instance)
    }

    /// Where the daemon keeps its calibrations.
    pub fn kept(&self) -> PathBuf {
        self.state.join(self.instance.as_str())
    }

    /// The numbers of the calibrations that are on the disk.
    pub fn kept_ids(&self) -> Vec<u64> {
        ids_in(&self.kept())
    }
}

/// The numbers of the calibrations in a folder, oldest first.
pub fn ids_in(folder: &Path) -> Vec<u64> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut ids: Vec<u64> = entries
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            name.strip_prefix("calibration-")?.strip_suffix(".yaml")?.parse().ok()
        })
        .collect();
    ids.sort_unstable();
    ids
}

/// Asks for the status until `accept` likes it.
pub fn wait_for_status(
    client: &mut Client,
    (what, limit): (&str, Duration),
    accept: impl Fn(&Snapshot) -> bool,
) -> Result<(Response, Instant)> {
    let until = Instant::now() + limit;
    loop {
        let answer = client.status(ANSWER)?;
        if accept(&answer.snapshot) {
            return Ok((answer, Instant::now()));
        }
        if Instant::now() >= until {
            bail!("not {what} within {limit:?}; the last status: {:?}", answer.snapshot);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The numbers of the whole history as clients see it, newest first.
pub fn history(client: &mut Client) -> Result<Vec<u64>> {
    let (mut ids, mut below) = (Vec::new(), u64::MAX);
    loop {
        match client.archived_below(below, ANSWER)? {
            Archived::Found(message) => {
                below = message.provenance.id.context("a kept calibration without a number")?;
                ids.push(below);
            }
            Archived::NoOlder => return Ok(ids),
            Archived::NotKept { sentence } => bail!("no history: {sentence}"),
        }
    }
}
