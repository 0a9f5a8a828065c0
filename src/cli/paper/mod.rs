//! `pelical evaluate --paper`: the two experiments of the paper's section IV with synthetic cameras, on every core.

mod board;
mod change;
mod configuration;
mod document;
mod drawing;
mod grid;
mod heat_map;
mod page;
mod published;
mod stereo;
mod tables;
mod trial;
mod workers;

use super::args::{EvaluateArgs, ExperimentArgs};
use super::error::CliError;
use super::exit::Exit;
use super::interrupt::Interrupt;
use super::{output, progress};
use crate::pipeline::PipelineOptions;
use crate::solver::State;
use configuration::Configuration;
use document::PaperDocument;
use grid::Grid;
use stereo::{StereoTask, StereoTrial};
use trial::{Task, Trial};

/// Runs both and prints them beside the paper's figures. Ends with [`Exit::Failed`] when a converged solution was wrong.
///
/// # Errors
/// When interrupted, or when the output cannot be written.
pub fn run(args: &EvaluateArgs, options: &PipelineOptions) -> Result<Exit, CliError> {
    let interrupt = Interrupt::register()?;
    let experiment = ordered(&args.experiment);
    let trials = run_grid(&experiment, options, &interrupt)?;
    let stereo = run_stereo(&trials, &interrupt)?;
    let grid = Grid { angles_deg: &experiment.angles, distances_cm: &experiment.distances, trials: &trials };
    let document = PaperDocument::new(&grid, (experiment.seeds, experiment.sets), &stereo);
    if let Some(folder) = &experiment.folder {
        page::write(folder, &document, &command(&experiment))?;
    }
    if args.output.json {
        output::print_json(&document)?;
    } else {
        let tables: Vec<String> = tables::all(&document).iter().map(tables::Table::as_text).collect();
        output::print_text(&format!("{}\n{}", tables.join("\n"), tables::summary(&document)))?;
    }
    Ok(if document.wrong == 0 { Exit::Done } else { Exit::Failed })
}

/// Settings in ascending order, each once.
fn ordered(args: &ExperimentArgs) -> ExperimentArgs {
    let mut ordered = args.clone();
    for settings in [&mut ordered.angles, &mut ordered.distances] {
        settings.sort_unstable();
        settings.dedup();
    }
    ordered
}

/// The command that repeats the experiment.
fn command(experiment: &ExperimentArgs) -> String {
    let list = |settings: &[u32]| settings.iter().map(u32::to_string).collect::<Vec<_>>().join(",");
    let ExperimentArgs { seeds, sets, angles, distances, .. } = experiment;
    let mut command = format!("pelical evaluate --paper --seeds {seeds} --sets {sets}");
    if *angles != published::ANGLES_DEG || *distances != published::DISTANCES_CM {
        command += &format!(" --angles {} --distances {}", list(angles), list(distances));
    }
    command + " --output docs"
}

fn run_grid(
    experiment: &ExperimentArgs,
    options: &PipelineOptions,
    interrupt: &Interrupt,
) -> Result<Vec<Trial>, CliError> {
    let ExperimentArgs { seeds, sets, angles, distances, .. } = experiment;
    let configurations = Configuration::grid(angles, distances);
    let of_room = |seed| {
        let task = move |&configuration: &Configuration| Task { configuration, seed, sets: *sets };
        configurations.iter().map(task)
    };
    let tasks: Vec<Task> = (1..=*seeds).flat_map(of_room).collect();
    let bar = progress::bar(Some(tasks.len() as u64), "trials");
    let trials = workers::run_all(&tasks, (&bar, interrupt), |task| Ok(trial::run(task, options)?));
    bar.finish_and_clear();
    trials
}

/// The board in every room in which a parallel pair at one of the baselines has converged.
fn run_stereo(trials: &[Trial], interrupt: &Interrupt) -> Result<Vec<StereoTrial>, CliError> {
    let is_stereo = |trial: &&Trial| {
        let Configuration { angle_deg, distance_cm } = trial.configuration;
        angle_deg == 0 && stereo::BASELINES_CM.contains(&distance_cm) && trial.state == State::Converged
    };
    let task = |trial: &Trial| {
        let baseline_cm = trial.configuration.distance_cm;
        Some(StereoTask { baseline_cm, seed: trial.seed, target_from_source: trial.target_from_source? })
    };
    let tasks: Vec<StereoTask> = trials.iter().filter(is_stereo).filter_map(task).collect();
    let bar = progress::bar(Some(tasks.len() as u64), "boards");
    let boards = workers::run_all(&tasks, (&bar, interrupt), |task| Ok(stereo::run(task)?));
    bar.finish_and_clear();
    Ok(boards?.into_iter().flatten().collect())
}
