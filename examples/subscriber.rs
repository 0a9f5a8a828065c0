//! Prints every calibration that a daemon publishes, as it comes. Started before the daemon, it waits for it; started after the
//! result, it gets the last one at once.
//!
//! `cargo run --example subscriber [INSTANCE]`

use std::time::Duration;

use pelical::ipc::{CalibrationMessage, Client, ClientError, InstanceName};

/// How long to wait for the daemon, or for its next result, before looking again.
const PAUSE: Duration = Duration::from_secs(1);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let instance: InstanceName = match std::env::args().nth(1) {
        Some(name) => name.parse()?,
        None => InstanceName::default(),
    };
    let mut client = connect(&instance)?;
    loop {
        match client.wait_calibration(PAUSE) {
            Ok(Some(message)) => print(&message),
            Ok(None) => {}
            // The daemon ended; this client goes on when it is back.
            Err(ClientError::NotRunning { .. }) => std::thread::sleep(PAUSE),
            Err(error) => return Err(error.into()),
        }
    }
}

fn connect(instance: &InstanceName) -> Result<Client, ClientError> {
    loop {
        match Client::connect(instance) {
            Err(ClientError::NotRunning { .. }) => {
                eprintln!("waiting for the daemon '{instance}'");
                std::thread::sleep(PAUSE);
            }
            other => return other,
        }
    }
}

fn print(message: &CalibrationMessage) {
    let result = &message.calibration;
    println!("calibration {}: {}", message.sequence, result.state.name());
    if let Some(reason) = &result.reason {
        println!("  {}: {}", reason.code.name(), reason.sentence);
    }
    for (camera, pose) in message.cameras.iter().zip(&result.cameras) {
        let Some(pose) = pose else {
            println!("  {}: pose unknown", camera.name);
            continue;
        };
        let t_m = pose.reference_from_camera.translation.vector;
        let q = pose.reference_from_camera.rotation.coords;
        println!(
            "  {}: translation_m [{:.4}, {:.4}, {:.4}] rotation_xyzw [{:.5}, {:.5}, {:.5}, {:.5}]",
            camera.name, t_m.x, t_m.y, t_m.z, q.x, q.y, q.z, q.w
        );
    }
}
