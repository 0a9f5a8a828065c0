//! Cameras whose frames never meet, in words: the estimator, which sees none of them, can only say that it saw no lines.

use std::time::Duration;

use super::skew::PairSkew;
use crate::solver::{Reason, ReasonCode, RigCalibration, State};

/// So many moments in a row without a common frame set are no chance, even where there was one before.
const MIN_IN_A_ROW: u64 = 3;

/// How far apart the frames of each two cameras of a rig are, with all that words need.
#[derive(Debug, Clone, Copy)]
pub struct Skews<'a> {
    /// Every pair.
    pub pairs: &'a [PairSkew],
    /// Names of the cameras.
    pub names: &'a [String],
    /// The limit.
    pub max_skew: Duration,
}

impl Skews<'_> {
    /// The pair whose frames meet least; `None` while no pair is apart.
    pub fn worst(&self) -> Option<&PairSkew> {
        let of_own_clock = self.pairs.iter().find(|pair| pair.own_clock.is_some());
        // Backwards, since of equals the last one counts.
        let apart = || self.pairs.iter().rev().filter(|pair| is_apart(pair)).max_by_key(|pair| pair.in_a_row);
        of_own_clock.or_else(apart)
    }

    /// Why the worst pair has no frame set, as the reason of a result that has not converged.
    pub fn reason(&self) -> Option<Reason> {
        self.worst().map(|pair| self.reason_of(pair))
    }

    /// Tells of every camera without a place that it has none because its frames meet no others.
    pub fn explain(&self, calibration: &mut RigCalibration) {
        if calibration.state == State::Converged {
            return;
        }
        let has_place = |camera: usize| calibration.cameras.get(camera).is_some_and(Option::is_some);
        let lacks_place = |pair: &PairSkew| !has_place(pair.first) || !has_place(pair.second);
        if let Some(worst) = self.worst().filter(|worst| lacks_place(worst)) {
            calibration.reason = Some(self.reason_of(worst));
        }
        for pair in calibration.pairs.iter_mut().filter(|pair| pair.state != State::Converged) {
            if let Some(unmet) = self.unmet((pair.target.min(pair.source), pair.target.max(pair.source))) {
                pair.reason = Some(self.reason_of(unmet));
            }
        }
    }

    /// What keeps two cameras from meeting; of a camera that is nearer to a third one, how far it is from that.
    fn unmet(&self, (first, second): (usize, usize)) -> Option<&PairSkew> {
        let pair = self.pairs.iter().find(|pair| (pair.first, pair.second) == (first, second))?;
        let shares = |other: &&PairSkew| {
            [first, second].iter().any(|camera| [other.first, other.second].contains(camera))
        };
        if is_apart(pair) {
            return Some(pair);
        }
        let is_never_met = pair.within.count == 0;
        self.pairs.iter().filter(|other| is_never_met && is_apart(other)).find(shares)
    }

    fn reason_of(&self, pair: &PairSkew) -> Reason {
        let name = |camera: usize| self.names.get(camera).map_or("?", String::as_str);
        let (first, second) = (name(pair.first), name(pair.second));
        let sentence = match pair.own_clock {
            Some(camera) => {
                let other = if camera == pair.first { second } else { first };
                let own = name(camera);
                format!(
                    "{own} stamps its frames by a clock of its own, which tells nothing of {other}'s: set \
                     cameras.realsense.global_time to true; where it is, wait until the SDK knows the camera's clock"
                )
            }
            None => {
                let limit_ms = self.max_skew.as_micros() as f64 / 1e3;
                let gap = in_words(pair.nearest_beyond_ms);
                format!(
                    "frames of {first} and {second} are at least {gap} apart, the limit is {limit_ms} ms: check the cameras' clocks \
                     and frame rates, or raise sync.max_skew_ms"
                )
            }
        };
        Reason { code: ReasonCode::NotEnoughEvidence, sentence }
    }
}

fn is_apart(pair: &PairSkew) -> bool {
    let is_never_met = pair.in_a_row > 0 && pair.within.count == 0;
    pair.own_clock.is_some() || is_never_met || pair.in_a_row >= MIN_IN_A_ROW
}

fn in_words(gap_ms: f64) -> String {
    match gap_ms {
        ..10.0 => format!("{gap_ms:.2} ms"),
        ..10_000.0 => format!("{gap_ms:.1} ms"),
        _ => format!("{:.1} s", gap_ms * 1e-3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::StampNs;
    use crate::pipeline::skew::SkewBook;
    use crate::solver::PairEstimate;

    const LIMIT: Duration = Duration::from_millis(8);

    fn names() -> Vec<String> {
        ["left", "right", "rear"].map(str::to_owned).to_vec()
    }

    fn note(book: &SkewBook, stamps_ms: &[i64], times: usize) {
        for _ in 0..times {
            book.note_set(stamps_ms.iter().map(|ms| Some(StampNs(ms * 1_000_000))), LIMIT);
        }
    }

    fn sentence(book: &SkewBook) -> Option<String> {
        let (pairs, names) = (book.pairs(), names());
        let skews = Skews { pairs: &pairs, names: &names, max_skew: LIMIT };
        skews.reason().map(|reason| reason.sentence)
    }

    #[test]
    fn two_cameras_out_of_step_are_told_with_gap_limit_and_what_to_check() {
        let book = SkewBook::new(2);
        note(&book, &[0, 3], 1);
        note(&book, &[0, 12], 2);
        assert_eq!(sentence(&book), None, "two may be chance");
        note(&book, &[0, 12], 1);
        assert_eq!(
            sentence(&book).as_deref(),
            Some(
                "frames of left and right are at least 12.0 ms apart, the limit is 8 ms: check the cameras' clocks and frame rates, or \
                 raise sync.max_skew_ms"
            )
        );
        note(&book, &[0, 3], 1);
        assert_eq!(sentence(&book), None, "they meet again");
        note(&book, &[0, 3_600_000], 3);
        assert!(sentence(&book).is_some_and(|sentence| sentence.contains("3600.0 s apart")), "and no more");
    }

    #[test]
    fn of_cameras_that_never_met_the_first_moment_tells() {
        let book = SkewBook::new(2);
        note(&book, &[0, 12], 1);
        assert!(sentence(&book).is_some());
    }

    #[test]
    fn a_clock_of_its_own_is_told_with_its_camera_and_cure() {
        let book = SkewBook::new(3);
        book.note_own_clocks(0b100);
        let told = sentence(&book).expect("it can meet no other");
        assert!(told.starts_with("rear stamps its frames by a clock of its own"), "{told}");
        assert!(told.contains("left") && told.contains("cameras.realsense.global_time"), "{told}");
        book.note_own_clocks(0);
        assert_eq!(sentence(&book), None);
    }

    fn unsolved() -> RigCalibration {
        let pair = |target, source| PairEstimate {
            reason: Some(Reason { code: ReasonCode::NoLines, sentence: "check its lens cover".to_owned() }),
            ..PairEstimate::collecting(target, source)
        };
        let pairs = vec![pair(0, 1), pair(0, 2), pair(1, 2)];
        let reason = pairs[2].reason.clone();
        let (state, cameras) = (State::Collecting, vec![None; 3]);
        RigCalibration { state, reason, reference: 0, cameras, pairs, frame_sets_used: 9 }
    }

    #[test]
    fn only_what_the_camera_out_of_step_lacks_is_laid_to_its_skew() {
        let book = SkewBook::new(3);
        for _ in 0..5 {
            book.note_set([0, 1].into_iter().map(|ms| Some(StampNs(ms * 1_000_000))), LIMIT);
            book.note_beyond((2, 1), Duration::from_millis(19));
        }
        let (pairs, names) = (book.pairs(), names());
        let mut calibration = unsolved();
        Skews { pairs: &pairs, names: &names, max_skew: LIMIT }.explain(&mut calibration);
        let told =
            |reason: &Option<Reason>| reason.as_ref().map_or_else(String::new, |why| why.sentence.clone());
        assert!(told(&calibration.reason).starts_with("frames of right and rear are at least 19.0 ms apart"));
        let is_skew =
            calibration.pairs.iter().map(|pair| told(&pair.reason).starts_with("frames of right and rear"));
        assert_eq!(is_skew.collect::<Vec<_>>(), [false, true, true]);
    }

    #[test]
    fn a_converged_result_is_left_alone() {
        let book = SkewBook::new(3);
        note(&book, &[0, 12, 24], 5);
        let (pairs, names) = (book.pairs(), names());
        let converged = RigCalibration { state: State::Converged, reason: None, ..unsolved() };
        let mut calibration = converged.clone();
        Skews { pairs: &pairs, names: &names, max_skew: LIMIT }.explain(&mut calibration);
        assert_eq!(calibration, converged);
    }
}
