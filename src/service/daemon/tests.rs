//! A pipeline with a bug.

use std::sync::Arc;

use super::start::{MAX_RESTARTS, run_rig};
use super::*;
use crate::capture::RgbdFrame;
use crate::capture::synthetic::{SyntheticFactory, SyntheticOptions};
use crate::geometry::Camera;
use crate::ipc::InstanceName;
use crate::pipeline::{CameraSlot, FindTimes, FoundLines, LineFinder, Parts, PipelineOptions};
use crate::service::config::ReadyWhen;
use crate::service::manager::ServiceManager;
use crate::service::rig::Rig;

struct Broken;

impl LineFinder for Broken {
    fn find(&mut self, _: &RgbdFrame, _: &Camera, _: &mut FoundLines) -> FindTimes {
        panic!("a bug in the line stage");
    }
}

fn broken_parts(options: &PipelineOptions) -> Parts {
    Parts { line_finder: Box::new(|| Box::new(Broken)), ..Parts::new(options) }
}

#[test]
fn a_pipeline_that_panics_again_and_again_ends_the_daemon_with_a_word() {
    let instance: InstanceName = format!("bug-{}", std::process::id()).parse().expect("valid");
    let server = Server::start(&instance).expect("nobody else has this name");
    let factory = Arc::new(SyntheticFactory::new(SyntheticOptions::pair(0.0, 0.2, 3)));
    let slot = CameraSlot { factory, serial: "synthetic-01".to_owned(), name: "left".to_owned() };
    let identity =
        CameraIdentity { name: "left".to_owned(), serial: "synthetic-01".to_owned(), firmware: None };
    let rig = Rig {
        slots: vec![slot],
        identities: vec![identity],
        options: PipelineOptions::default(),
        make_parts: broken_parts,
    };
    let config = crate::service::config::load_or_default(None).expect("the defaults are valid");
    let supervisor = Supervisor::new(ServiceManager::default(), ReadyWhen::Started);
    let mut daemon = Daemon::new(&config, Storing::default(), (supervisor, None));
    let error = run_rig(&rig, &server, (&mut daemon, &Stop::default())).expect_err("it cannot work");
    let message = error.to_string();
    assert!(message.contains("lines-0") && message.contains(&MAX_RESTARTS.to_string()), "{message}");
}
