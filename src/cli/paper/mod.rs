//! `pelical evaluate --paper`: the two experiments of the paper's section IV with synthetic cameras.

mod configuration;
mod trial;
mod workers;

use super::args::EvaluateArgs;
use super::error::CliError;
use super::exit::Exit;
use super::interrupt::Interrupt;
use super::progress;
use crate::pipeline::PipelineOptions;
use configuration::Configuration;
use trial::Task;

/// Runs both.
pub fn run(args: &EvaluateArgs, options: &PipelineOptions) -> Result<Exit, CliError> {
    let interrupt = Interrupt::register()?;
    let e = &args.experiment;
    let tasks: Vec<Task> = (1..=e.seeds).flat_map(|seed| Configuration::grid(&e.angles, &e.distances).into_iter().map(move |configuration| Task { configuration, seed, sets: e.sets })).collect();
    let bar = progress::bar(Some(tasks.len() as u64), "trials");
    let start = std::time::Instant::now();
    let trials = workers::run_all(&tasks, (&bar, &interrupt), |task| { 
        let s = std::time::Instant::now();
        let t = trial::run(task, options)?;
        eprintln!("{:?} seed {} {:?} first {:?} err {:?} sigma {:?} worst {:?} n {} {:.1}s {:?}", t.configuration, t.seed, t.state, t.first_converged, t.error.map(|e| (e.rotation_deg, e.translation_mm)), t.sigma, t.worst_converged.map(|e| (e.rotation_deg, e.translation_mm)), t.matches, s.elapsed().as_secs_f64(), t.reason);
        Ok(t) })?;
    eprintln!("{} {:?}", trials.len(), start.elapsed());
    Ok(Exit::Done)
}
