//! `pelical doctor`: looks at everything that a calibration needs of the system, and says of each finding what causes and what cures it.
//!
//! It only looks: nothing is changed, no root rights and no network are needed.

mod bandwidth;
mod cameras;
mod clock;
mod daemon;
mod finding;
mod rights;
mod room;
mod system;
#[cfg(test)]
mod tests;
mod unit;
mod versions;

use std::path::Path;

use super::address::Address;
use super::args::DoctorArgs;
use super::error::CliError;
use super::exit::Exit;
use super::output;
use crate::service::config::Config;
use finding::{DoctorDocument, Finding, Grade};
use system::System;

/// Looks and prints; failed where there is a problem.
///
/// # Errors
/// When there is no such root, or stdout cannot be written.
pub fn run(address: &Address, args: &DoctorArgs) -> Result<Exit, CliError> {
    if let Some(root) = args.root.as_deref().filter(|root| !root.is_dir()) {
        return Err(CliError::BadInput(format!("{}: there is no such folder", root.display())));
    }
    let system = System::new(args.root.as_deref());
    let (config, about_config) = daemon::config(&system, args.config.as_deref())?;
    let mut findings = vec![about_config];
    findings.extend(examine(&system, &config));
    // An image has neither memory nor processes.
    if system.is_running {
        let address = daemon::address_of(address, &config);
        let answered = daemon::ask(&address);
        findings.push(room::shared_memory(&system, &config.transport, daemon::is_there(&answered)));
        findings.push(daemon::daemon(&address.instance, &answered, unit::is_installed(&system)));
    }
    let document = DoctorDocument::new(findings);
    if args.output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&document.text())?;
    }
    Ok(if document.grade == Grade::Problem { Exit::Failed } else { Exit::Done })
}

/// Everything but the config itself, and what only a running system has.
fn examine(system: &System, config: &Config) -> Vec<Finding> {
    let needs_realsense = daemon::needs_realsense(&config.cameras);
    let cameras = cameras::on_bus(system);
    let needs_service = unit::is_installed(system);
    let state = config.store.directory.as_deref().unwrap_or(Path::new(room::INSTALLED_STATE));
    let mut findings = cameras::check(system, &cameras, needs_realsense);
    findings.extend(bandwidth::check(system, &cameras, &config.cameras));
    findings.push(daemon::back_end(&config.cameras));
    findings.push(rights::udev_rule(system, needs_realsense || !cameras.is_empty()));
    findings.push(rights::group(system, needs_service));
    findings.push(room::state_directory(system, config.store.directory.as_ref()));
    findings.extend(clock::check(system, Some(state)));
    findings.push(unit::check(system));
    findings.extend(versions::check(system, &config.pipeline.associate.learned, needs_realsense));
    findings
}
