use super::*;
use crate::geometry::ScoredMatch;

/// Says the same of every set.
struct Fixed(Vec<ScoredMatch>);

impl MatchSource for Fixed {
    fn score(&mut self, _: &[Option<SeenLines<'_>>], _: &dyn Fn() -> bool) -> Vec<PairScores> {
        vec![PairScores { target: 0, source: 1, matches: self.0.clone() }]
    }
}

fn says(target: u32, source: u32, nats: f64) -> ScoredMatch {
    ScoredMatch { target, source, nats }
}

#[test]
fn of_two_sources_the_one_that_says_more_is_heard_and_nothing_is_lost() {
    let first = Fixed(vec![says(0, 0, 2.0), says(0, 1, -0.5), says(2, 2, 1.0)]);
    let second = Fixed(vec![says(0, 0, 1.0), says(0, 1, 0.25), says(1, 1, 0.5)]);
    let scores = Auto::new(Box::new(first), Box::new(second)).score(&[], &|| true);
    let expected = vec![says(0, 0, 2.0), says(0, 1, -0.5), says(1, 1, 0.5), says(2, 2, 1.0)];
    assert_eq!(scores, [PairScores { target: 0, source: 1, matches: expected }]);
}

#[test]
fn a_learned_matcher_that_cannot_be_loaded_is_complained_of_once_and_done_without() {
    let learned = LearnedOptions { models: vec!["/nowhere/to/be/found.onnx".into()], ..Default::default() };
    for association in [Association::Onnx, Association::Auto] {
        let mut source = source(&AssociateOptions { association, learned: learned.clone() });
        let complaint = source.complaint().expect("a sentence");
        assert!(complaint.starts_with("no learned matcher: "), "{complaint}");
        assert_eq!(source.complaint(), None, "once");
        assert_eq!(source.score(&[None, None], &|| true), []);
    }
}

#[test]
fn without_models_auto_asks_descriptors_alone_and_misses_nothing() {
    let mut source = source(&AssociateOptions::default());
    assert_eq!(source.complaint(), None);
    assert!(!AssociateOptions::default().needs_images() && AssociateOptions::default().needs_looks());
}

#[test]
fn every_pair_of_cameras_that_are_there_is_compared_once() {
    let there = [Some(0), None, Some(2), Some(3)];
    let found: Vec<(usize, usize)> = pairs(&there).map(|(a, b)| (a.0, b.0)).collect();
    assert_eq!(found, [(0, 2), (0, 3), (2, 3)]);
}
