//! What the daemon does about results: takes them from the pipeline or the store, publishes them, and notes whether they still hold.

use super::{Daemon, Live};
use crate::ipc::{CalibrationMessage, CameraIdentity, Outcome, Provenance, Server};
use crate::pipeline::{Answer, Command, PipelineEvent, Solved};
use crate::service::config::OnMoved;
use crate::service::rig::with_firmware;
use crate::service::storing;
use crate::service::telling::{log_moved, wall_clock_ns};
use crate::solver::{RigCalibration, State, WatchReport};
use crate::store::StoredCalibration;

impl Daemon {
    /// The cameras are known: serves their newest calibration of earlier runs, if there is one.
    pub(super) fn serve_newest(&mut self, identities: Vec<CameraIdentity>, server: &Server) {
        self.identities = identities;
        if let Some(newest) = self.storing.newest_for(&self.identities) {
            let age_s = wall_clock_ns().saturating_sub(newest.made_ns) / 1_000_000_000;
            tracing::info!(
                id = newest.id,
                age_s,
                "serving the stored calibration until live lines confirm it"
            );
            self.publish_stored(&newest, server);
        }
    }

    /// Publishes a calibration of an earlier time, which is not verified.
    fn publish_stored(&mut self, stored: &StoredCalibration, server: &Server) {
        self.life.on_stored();
        self.served = Some(stored.calibration.clone());
        self.progress.note(&stored.calibration);
        self.publish(storing::message(stored, State::Stored), server);
    }

    pub(super) fn handle(&mut self, event: PipelineEvent, live: &Live<'_>) {
        match event {
            PipelineEvent::Progress(progress) => {
                self.life.on_frames();
                let message = self.progress.message(&progress, self.identities.len(), &self.life);
                self.note(live.server.publish_progress(&message));
            }
            // One that was under way when a client asked for a new calibration is not the answer to that.
            PipelineEvent::Calibration(solved) if solved.round != live.pipeline.round() => {}
            PipelineEvent::Calibration(solved) => self.take(*solved, live),
            PipelineEvent::Watched(watched) if watched.round != live.pipeline.round() => {}
            PipelineEvent::Watched(watched) => self.watched(watched.report, live),
            // The pipeline has logged it, health tells it, and a bug has ended the loop.
            PipelineEvent::Camera { .. } | PipelineEvent::Bug { .. } => {}
        }
    }

    fn take(&mut self, mut solved: Solved, live: &Live<'_>) {
        self.apart.explain(&mut solved.calibration, &live.pipeline.snapshot());
        self.life.on_solved(&solved);
        self.progress.note(&solved.calibration);
        self.keeps_result &= self.life.state() != State::Converged;
        let (state, ms) = (solved.calibration.state.name(), solved.took.as_millis());
        let sentence = solved.calibration.reason.as_ref().map_or("", |reason| reason.sentence.as_str());
        if self.life.state() == State::Converged {
            tracing::info!(state, ms, frame_sets = solved.calibration.frame_sets_used, "calibrated");
        } else {
            tracing::debug!(state, ms, sentence, "not yet");
        }
        if !self.keeps_result {
            self.publish_solved(solved.calibration, live);
        }
    }

    fn publish_solved(&mut self, calibration: RigCalibration, live: &Live<'_>) {
        let mut message = CalibrationMessage {
            sequence: 0,
            stamp_ns: wall_clock_ns(),
            provenance: Provenance {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                config_hash: self.config_hash.clone(),
                ..Provenance::default()
            },
            cameras: with_firmware(&self.identities, &live.pipeline.snapshot()),
            calibration,
        };
        if message.calibration.state == State::Converged {
            let counts = self.progress.frame_sets(&live.pipeline.snapshot().counts);
            message.provenance.id = self.storing.add(&message, counts.into());
        }
        self.publish(message, live.server);
    }

    fn publish(&mut self, mut message: CalibrationMessage, server: &Server) {
        message.sequence = self.published.as_ref().map_or(0, |before| before.sequence) + 1;
        self.note(server.publish_calibration(&message));
        self.published = Some(message);
    }

    /// Live lines agree with the result of an earlier run: it is published again, as one of this run.
    fn publish_verified(&mut self, server: &Server) {
        let Some(mut message) = self.published.clone() else { return };
        tracing::info!(id = message.provenance.id, "the stored calibration is verified");
        message.calibration.state = State::Converged;
        self.publish(message, server);
    }

    /// The newest word on how the result stands.
    fn watched(&mut self, report: WatchReport, live: &Live<'_>) {
        let pipeline = &live.pipeline;
        let is_news = self.life.on_watched(report);
        if self.life.on_verified() {
            self.publish_verified(live.server);
        }
        if !is_news {
            return;
        }
        let moved = self.life.watch().map(|watch| watch.moved.as_slice()).unwrap_or_default();
        if moved.is_empty() {
            tracing::info!("every camera stands again as calibrated");
            return;
        }
        moved.iter().for_each(|moved| log_moved(moved, &self.identities));
        if self.on_moved == OnMoved::Recalibrate {
            let before = pipeline.snapshot();
            if pipeline.command(Command::Recalibrate) == Answer::Accepted {
                tracing::info!(
                    "calibrating again because a camera was moved: the old result stays until then"
                );
                self.life.on_moved_restart();
                self.progress.restart(before.counts);
                self.keeps_result = true;
                self.served = None;
            }
        }
    }

    /// Publishes an older calibration and watches it like one of an earlier run.
    pub(super) fn go_back(&mut self, id: u64, live: &Live<'_>) -> Outcome {
        let stored = match self.storing.go_back(id, &self.identities, wall_clock_ns()) {
            Ok(stored) => stored,
            Err((code, sentence)) => return Outcome::Refused { code, sentence },
        };
        tracing::info!(id, new_id = stored.id, "going back to an older calibration");
        self.keeps_result = false;
        self.progress.restart(live.pipeline.snapshot().counts);
        self.publish_stored(&stored, live.server);
        live.pipeline.watch(stored.calibration);
        Outcome::Accepted
    }
}
