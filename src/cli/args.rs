//! The command lines of both programs. Flags are not config: they say what to do, the config file says how.

use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};

use super::address::Address;
use super::association_choice::AssociationChoice;
use crate::capture::CaptureError;
use crate::capture::recording::Recording;

/// Calibrates the cameras of a robot against each other while it runs, and publishes the result over shared memory.
#[derive(Debug, Parser)]
#[command(name = "pelicald", version)]
pub struct DaemonArgs {
    /// Config file (YAML).
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Check the config file, print the effective values and exit.
    #[arg(long)]
    pub check_config: bool,
}

/// Extrinsics of RGB-D cameras from straight edges, without a target.
#[derive(Debug, Parser)]
#[command(name = "pelical", version)]
pub struct ClientArgs {
    /// Which daemon.
    #[command(flatten)]
    pub daemon: Address,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What the client can do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a synthetic three-camera rig through daemon and client, and print the result against its truth.
    Demo(Output),
    /// Calibrate from a recording, without a daemon.
    Calibrate(CalibrateArgs),
    /// Play a recording through the live pipeline, as a daemon would see it, until its result or the recording's end.
    Replay(ReplayArgs),
    /// Calibrate every recording below that has ground_truth.yaml, and print the errors.
    Evaluate(EvaluateArgs),
    /// Solve sets of matched line pairs with the estimators alone, and print poses, errors and times.
    Solve(SolveArgs),
    /// Show the lines of a recording's frame sets and which of them are matched; with ground truth, how well.
    Match(MatchArgs),
    /// Measure the time of every stage with the frames of a recording, on one core and in the live pipeline, and what is dropped.
    Bench(BenchArgs),
    /// Print what the daemon is doing.
    Status(Output),
    /// Print every result and the progress of the daemon until stopped.
    Watch(Output),
    /// Ask the daemon to forget its evidence and calibrate again.
    Recalibrate(RecalibrateArgs),
    /// Ask the daemon to stop collecting evidence.
    Cancel(Output),
    /// List the calibrations that the daemon has kept, newest first.
    History(Output),
    /// Ask the daemon to go back to an older calibration of its history.
    Rollback(RollbackArgs),
    /// Print the published calibration, or an older one, in a form that other programs read.
    Export(ExportArgs),
    /// Write a recording from the cameras of a config file.
    Record(RecordArgs),
    /// List the cameras of a config file's back end.
    Devices(DevicesArgs),
    /// Check cameras, USB speed, permissions, service and system; say of each finding its cause and its cure. Exit code 1 with a problem.
    Doctor(DoctorArgs),
    /// The daemon of the demo, in a process of its own.
    #[command(hide = true)]
    DemoDaemon,
}

/// Form of the answer.
#[derive(Debug, Clone, Copy, Args)]
pub struct Output {
    /// Print one JSON document on stdout instead of text.
    #[arg(long)]
    pub json: bool,
}

/// A recording, by one path or several.
#[derive(Debug, Clone, Args)]
pub struct RecordingArgs {
    /// Folder with recording.yaml; or RealSense .bag files, one per camera or with several devices in one, or a folder with them.
    #[arg(required = true, value_name = "RECORDING")]
    pub recording: Vec<PathBuf>,
}

impl RecordingArgs {
    /// Opens it.
    ///
    /// # Errors
    /// When it is not usable.
    pub fn open(&self) -> Result<Recording, CaptureError> {
        Recording::open_all(&self.recording)
    }

    /// What it is called by in documents: the first path.
    pub fn path(&self) -> &Path {
        self.recording.first().map_or(Path::new(""), PathBuf::as_path)
    }
}

/// `calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    /// What was recorded.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Config file whose sections `sync`, `lines` and `estimate` are used.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

/// `replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// What was recorded.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Play as fast as the pipeline takes the frame sets, none of which is lost then, instead of at the recorded pace.
    #[arg(long)]
    pub fast: bool,
    /// Config file whose sections `sync`, `lines`, `estimate` and `matcher` are used.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

/// `evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    /// Folders that are searched for recordings.
    #[arg(required_unless_present = "paper", conflicts_with = "paper", value_name = "DIR")]
    pub folders: Vec<PathBuf>,
    /// Repeat the paper's two experiments with synthetic cameras instead, and print the errors beside the paper's.
    #[arg(long)]
    pub paper: bool,
    /// Evaluate several sources of candidate matches side by side, and say from how many frame sets on each converges.
    #[arg(long, value_enum, value_delimiter = ',', conflicts_with = "paper", value_name = "LIST")]
    pub association: Vec<AssociationChoice>,
    /// What to do of the paper's experiments.
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    /// Config file whose sections `sync`, `lines` and `estimate` are used.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

/// `solve`.
#[derive(Debug, Args)]
pub struct SolveArgs {
    /// File with one problem a line, as JSON.
    #[arg(value_name = "PAIRS.jsonl")]
    pub pairs: PathBuf,
    /// Which estimator solves.
    #[arg(long, value_enum, default_value_t)]
    pub estimator: EstimatorChoice,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

/// An estimator of one pose from matched line pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Estimator {
    /// Consensus over the matches.
    Consensus,
    /// The paper's.
    Pelical,
}

impl Estimator {
    /// Its name in arguments and documents.
    pub fn name(self) -> &'static str {
        match self {
            Estimator::Consensus => "consensus",
            Estimator::Pelical => "pelical",
        }
    }
}

/// What `--estimator` asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum EstimatorChoice {
    /// Consensus over the matches.
    #[default]
    Consensus,
    /// The paper's, corrected but otherwise as published.
    Pelical,
    /// Both, side by side.
    Both,
}

impl EstimatorChoice {
    /// The estimators, in the order of their answers.
    pub fn estimators(self) -> &'static [Estimator] {
        match self {
            EstimatorChoice::Consensus => &[Estimator::Consensus],
            EstimatorChoice::Pelical => &[Estimator::Pelical],
            EstimatorChoice::Both => &[Estimator::Consensus, Estimator::Pelical],
        }
    }
}

/// `evaluate --paper`: fewer or more trials than the paper's grid.
#[derive(Debug, Clone, Args)]
pub struct ExperimentArgs {
    /// With --paper: rooms in which every configuration is tried; each has its own furniture, paths and noise.
    #[arg(long, requires = "paper", conflicts_with = "folders", default_value_t = 5, value_name = "COUNT",
        value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
    /// With --paper: frame sets of each trial.
    #[arg(long, requires = "paper", conflicts_with = "folders", default_value_t = 48, value_name = "COUNT",
        value_parser = clap::value_parser!(u64).range(1..=64))]
    pub sets: u64,
    /// With --paper: angles between the cameras, deg.
    #[arg(long, requires = "paper", conflicts_with = "folders", default_value = "0,20,40,60,80",
        value_delimiter = ',', value_name = "LIST", value_parser = clap::value_parser!(u32).range(0..=180))]
    pub angles: Vec<u32>,
    /// With --paper: distances between the cameras, cm.
    #[arg(long, requires = "paper", conflicts_with = "folders", default_value = "20,25,30,35,40,45",
        value_delimiter = ',', value_name = "LIST", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub distances: Vec<u32>,
    /// With --paper: folder for the page with the tables, the heat map (SVG and PNG) and the JSON document.
    #[arg(long = "output", requires = "paper", conflicts_with = "folders", value_name = "FOLDER")]
    pub folder: Option<PathBuf>,
}

/// `match`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
A match is a target line and a source line that are each other's best candidate and likelier one edge than two: with a score above ln n \
nats, where n is the larger number of lines of the two images, and above 5 nats where descriptors alone are asked.

With ground truth each match is judged by geometry: the lifted line, moved by the true pose, lies on the other segment within 3 px and \
3 degrees, at its depth within 3 sigma, along 30 % of the shorter of both (a shared edge), or the two lifted lines continue each other.
precision = right / (right + wrong), without matches that have too little depth to be judged;
recall = shared edges matched / shared edges, both counted one-to-one.")]
pub struct MatchArgs {
    /// What was recorded.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Only this frame set, from 0; without it all of them.
    #[arg(long, value_name = "N")]
    pub set: Option<usize>,
    /// Draw one frame set as PNG: that of --set, else the one with most matches.
    #[arg(short = 'o', long = "output", value_name = "OVERLAY.png")]
    pub overlay: Option<PathBuf>,
    /// Who proposes matches, instead of what the config says.
    #[arg(long, value_enum)]
    pub association: Option<AssociationChoice>,
    /// Leave out shorter segments, px; 0 takes all that the detector finds.
    #[arg(long, value_name = "PX", default_value = "60", value_parser = length_px)]
    pub min_length_px: f64,
    /// Config file whose sections `lines`, `estimate` and `matcher` are used.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

/// `bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Its first 40 frame sets are played from memory, round and round.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// How long each of the two parts runs, s.
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = duration_s)]
    pub seconds: std::time::Duration,
    /// Frame sets per second for the pipeline; without it as many as it can take.
    #[arg(long, value_name = "HZ", value_parser = rate_hz)]
    pub rate_hz: Option<f64>,
    /// Who proposes matches, instead of what the config says.
    #[arg(long, value_enum)]
    pub association: Option<AssociationChoice>,
    /// Config file whose sections `sync`, `lines`, `estimate` and `matcher` are used.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

fn rate_hz(text: &str) -> Result<f64, String> {
    let rate: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of frame sets per second"))?;
    if (0.1..=1000.0).contains(&rate) {
        return Ok(rate);
    }
    Err(format!("{text} Hz is out of range: allowed is 0.1 to 1000"))
}

fn length_px(text: &str) -> Result<f64, String> {
    let length: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of px"))?;
    if (0.0..=16_384.0).contains(&length) {
        return Ok(length);
    }
    Err(format!("{text} px is out of range: allowed is 0 to 16384"))
}

/// `recalibrate`.
#[derive(Debug, Args)]
pub struct RecalibrateArgs {
    /// Wait for the verdict.
    #[arg(long)]
    pub wait: bool,
    /// Longest time to wait, s.
    #[arg(long, value_name = "SECONDS", default_value = "120", requires = "wait", value_parser = duration_s)]
    pub timeout: std::time::Duration,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

/// `rollback`.
#[derive(Debug, Args)]
pub struct RollbackArgs {
    /// Number of the calibration in `pelical history`.
    #[arg(value_name = "ID", value_parser = clap::value_parser!(u64).range(1..))]
    pub id: u64,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

/// `export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Form of the output.
    #[arg(long, value_enum, default_value_t)]
    pub format: ExportFormat,
    /// Number of a calibration in `pelical history`; without it, the published one.
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u64).range(1..))]
    pub id: Option<u64>,
    /// Axes of the frames that are told, for ros-tf and urdf.
    #[arg(long, value_enum, default_value_t)]
    pub frame: ExportFrame,
}

/// Form of an exported calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum ExportFormat {
    /// The document of `calibrate --json`, with its provenance.
    #[default]
    Json,
    /// Poses by camera name, the layout of `ground_truth.yaml`.
    Yaml,
    /// A launch file of ROS 2 with static transforms.
    RosTf,
    /// Links and fixed joints.
    Urdf,
}

/// Axes of exported frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum ExportFrame {
    /// x right, y down, z forward: `<camera>_color_optical_frame`.
    #[default]
    Optical,
    /// x forward, y left, z up: `<camera>_color_frame`.
    Body,
}

/// `record`.
#[derive(Debug, Args)]
pub struct RecordArgs {
    /// Folder to write; must not exist, or be empty.
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
    /// Config file whose section `cameras` is used.
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Frame sets to write.
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    pub sets: Option<u64>,
    /// Longest time to record, s.
    #[arg(long, value_name = "SECONDS", value_parser = duration_s)]
    pub duration: Option<std::time::Duration>,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

fn duration_s(text: &str) -> Result<std::time::Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of seconds"))?;
    if (0.001..=86_400.0).contains(&seconds) {
        return Ok(std::time::Duration::from_secs_f64(seconds));
    }
    Err(format!("{text} s is out of range: allowed is 0.001 to 86400"))
}

/// `devices`.
#[derive(Debug, Args)]
pub struct DevicesArgs {
    /// Config file whose section `cameras` is used; without it, that of the installed service, else the defaults.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

/// `doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Config file; without it, that of the installed service, else the defaults.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Look at the files of a system below this folder, such as a mounted image, instead of those of the running one.
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Form of the answer.
    #[command(flatten)]
    pub output: Output,
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use super::{ClientArgs, DaemonArgs};

    #[test]
    fn both_command_lines_are_consistent() {
        ClientArgs::command().debug_assert();
        DaemonArgs::command().debug_assert();
    }

    #[test]
    fn values_that_cannot_be_meant_are_refused() {
        for line in [
            vec!["pelical", "--instance", "a b", "status"],
            vec!["pelical", "--ipc-directory", "relative", "status"],
            vec!["pelical", "evaluate"],
            vec!["pelical", "calibrate"],
            vec!["pelical", "replay"],
            vec!["pelical", "evaluate", "folder", "--paper"],
            vec!["pelical", "evaluate", "folder", "--seeds", "3"],
            vec!["pelical", "evaluate", "--seeds", "3"],
            vec!["pelical", "evaluate", "folder", "--association", "auto,lbd"],
            vec!["pelical", "evaluate", "--paper", "--association", "auto"],
            vec!["pelical", "evaluate", "--paper", "--seeds", "0"],
            vec!["pelical", "evaluate", "--paper", "--angles", "20,x"],
            vec!["pelical", "record", "x", "--config", "c", "--sets", "0"],
            vec!["pelical", "match", "x", "--set", "-1"],
            vec!["pelical", "match", "x", "--min-length-px", "nan"],
            vec!["pelical", "match", "x", "--association", "guess"],
            vec!["pelical", "bench", "x", "--seconds", "0"],
            vec!["pelical", "bench", "x", "--rate-hz", "inf"],
            vec!["pelical", "record", "x", "--config", "c", "--duration", "nan"],
        ] {
            assert!(ClientArgs::try_parse_from(&line).is_err(), "{line:?}");
        }
    }

    #[test]
    fn the_instance_may_stand_behind_the_command() {
        let args = ClientArgs::try_parse_from(["pelical", "status", "--instance", "rig2"]).expect("valid");
        assert_eq!(args.daemon.instance.as_str(), "rig2");
    }
}
