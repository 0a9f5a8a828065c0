//! Scores by the learned matcher: every image goes through the network once, then every pair of them is compared.

use super::{MatchSource, SeenLines, pairs};
use crate::geometry::{PairScores, Segment};
use crate::learned::{ImageFeatures, LearnedError, LearnedMatcher, LearnedOptions};

/// The learned matcher, as long as there is one.
#[derive(Debug)]
pub struct Learned {
    /// `None` where it could not be loaded, and after it has failed: it would fail again.
    matcher: Option<LearnedMatcher>,
    complaint: Option<String>,
    /// What is done without it, in words.
    otherwise: &'static str,
}

impl Learned {
    /// Loads runtime and models.
    pub fn load(options: &LearnedOptions, otherwise: &'static str) -> Self {
        let mut learned = Self { matcher: None, complaint: None, otherwise };
        match LearnedMatcher::load(options) {
            Ok(matcher) => learned.matcher = Some(matcher),
            Err(error) => learned.give_up(&error),
        }
        learned
    }

    fn give_up(&mut self, error: &LearnedError) {
        self.matcher = None;
        self.complaint = Some(format!("no learned matcher: {error}; {}", self.otherwise));
    }
}

/// What the network saw of a camera, and the segments of its lines.
type Features = (ImageFeatures, Vec<Segment>);

fn score(
    matcher: &mut LearnedMatcher,
    seen: &[Option<SeenLines<'_>>],
    keep_going: &dyn Fn() -> bool,
) -> Result<Vec<PairScores>, LearnedError> {
    let mut features: Vec<Option<Features>> = Vec::with_capacity(seen.len());
    for seen in seen.iter().take_while(|_| keep_going()) {
        let image = seen.as_ref().and_then(|seen| Some((seen, seen.image?)));
        let of_image = image.map(|(seen, image)| {
            let segments = seen.lines.iter().map(|line| line.segment).collect();
            matcher.image_features(&image).map(|features| (features, segments))
        });
        features.push(of_image.transpose()?);
    }
    let mut scores = Vec::new();
    for ((target, a), (source, b)) in pairs(&features).take_while(|_| keep_going()) {
        let matches = matcher.score_lines((&a.0, &a.1), (&b.0, &b.1))?;
        scores.push(PairScores { target, source, matches });
    }
    Ok(scores)
}

impl MatchSource for Learned {
    fn score(&mut self, seen: &[Option<SeenLines<'_>>], keep_going: &dyn Fn() -> bool) -> Vec<PairScores> {
        let Some(matcher) = &mut self.matcher else { return Vec::new() };
        score(matcher, seen, keep_going).unwrap_or_else(|error| {
            self.give_up(&error);
            Vec::new()
        })
    }

    fn complaint(&mut self) -> Option<String> {
        self.complaint.take()
    }
}
