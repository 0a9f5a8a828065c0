//! Independent jobs on every core; the results come in the order of the jobs, whichever was done first.

use std::sync::atomic::{AtomicUsize, Ordering};

use indicatif::ProgressBar;

use crate::cli::error::CliError;
use crate::cli::interrupt::Interrupt;

/// Does every job. After the first failure, or Ctrl-C, no further one is begun.
///
/// # Errors
/// The failure of the first failed job, or the interruption.
pub fn run_all<J: Sync, R: Send>(
    jobs: &[J],
    (bar, interrupt): (&ProgressBar, &Interrupt),
    run: impl Fn(&J) -> Result<R, CliError> + Sync,
) -> Result<Vec<R>, CliError> {
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut done: Vec<(usize, Result<R, CliError>)> = Vec::new();
        while !interrupt.is_set() && done.iter().all(|(_, result)| result.is_ok()) {
            // Relaxed: every number is handed out once; results come back by joining.
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(index) else { break };
            done.push((index, run(job)));
            bar.inc(1);
        }
        done
    };
    let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut done = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..n_threads).map(|_| scope.spawn(worker)).collect();
        let joined = threads.into_iter().map(|thread| thread.join());
        joined.collect::<Result<Vec<_>, _>>().map(|parts| parts.into_iter().flatten().collect::<Vec<_>>())
    })
    .map_err(|_| CliError::Failed("a worker of the experiment ended early".to_owned()))?;
    done.sort_by_key(|(index, _)| *index);
    let results: Vec<R> = done.into_iter().map(|(_, result)| result).collect::<Result<_, _>>()?;
    if results.len() < jobs.len() {
        return Err(CliError::Failed("interrupted".to_owned()));
    }
    Ok(results)
}
