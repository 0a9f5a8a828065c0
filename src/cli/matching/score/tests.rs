use super::*;

const SHARED: SameEdge = SameEdge::Shared { overlap_px: 50.0 };

fn scored(target: u32, source: u32, nats: f64) -> ScoredMatch {
    ScoredMatch { target, source, nats }
}

fn lines(matches: &[Match]) -> Vec<(usize, usize)> {
    matches.iter().map(|found| (found.target, found.source)).collect()
}

fn matched(lines: &[(usize, usize)]) -> Vec<Match> {
    lines.iter().map(|&(target, source)| Match { target, source, nats: None }).collect()
}

#[test]
fn a_match_is_the_best_of_both_its_lines_and_likelier_than_not() {
    let candidates = [
        scored(0, 0, 2.0),
        scored(0, 1, 3.0),
        scored(1, 1, 4.0),
        scored(2, 2, -0.5),
        scored(3, 3, 0.0),
        scored(4, 5, 0.1),
    ];
    let found = mutual_best((&candidates, 0.0), [1, 1]);
    assert_eq!(lines(&found), [(1, 1), (4, 5)]);
    assert_eq!(found[0].nats, Some(4.0));
}

#[test]
fn the_more_lines_there_are_the_more_a_score_must_say() {
    let candidates = [scored(0, 0, 3.0), scored(1, 1, 4.0), scored(2, 2, 5.0)];
    for (n_lines, n_matches) in
        [([20, 3], 3), ([21, 3], 2), ([3, 54], 2), ([3, 55], 1), ([149, 10], 0), ([0, 0], 3)]
    {
        assert_eq!(mutual_best((&candidates, 0.0), n_lines).len(), n_matches, "{n_lines:?}");
    }
    assert_eq!(
        lines(&mutual_best((&candidates, 3.5), [1, 1])),
        [(1, 1), (2, 2)],
        "a source may ask for more"
    );
}

#[test]
fn of_equal_scores_the_first_is_matched_and_no_line_twice() {
    let equal = [scored(0, 0, 2.0), scored(0, 1, 2.0), scored(1, 0, 2.0)];
    assert_eq!(lines(&mutual_best((&equal, 0.0), [2, 2])), [(0, 0)]);
    assert_eq!(mutual_best((&[], 0.0), [5, 5]), []);
}

#[test]
fn what_a_pose_explains_is_one_to_one_with_the_longest_first() {
    let long = SameEdge::Shared { overlap_px: 90.0 };
    let same = SameEdges::of_table(2, vec![SHARED, long, SameEdge::Continued, SHARED]);
    assert_eq!(lines(&explained(&same)), [(0, 1), (1, 0)]);
}

#[test]
fn an_edge_in_two_fragments_can_be_found_once() {
    let same = SameEdges::of_table(1, vec![SHARED, SHARED]);
    let tally = Tally::new(&matched(&[(1, 0)]), &same);
    assert_eq!((tally.shared, tally.precision(), tally.recall()), (1, Some(1.0), Some(1.0)));
}

#[test]
fn as_many_pairs_are_shared_as_can_be_found_one_to_one() {
    // Target 0 would take source 0, which is all that target 1 has.
    let same = SameEdges::of_table(2, vec![SHARED, SHARED, SHARED, SameEdge::No]);
    let mut pairs = most_shared(&same);
    pairs.sort_unstable();
    assert_eq!(pairs, [(0, 1), (1, 0)]);
}

#[test]
fn what_cannot_be_judged_counts_neither_way_and_continued_lines_are_right() {
    let (no, unknown) = (SameEdge::No, SameEdge::Unknown);
    let same = SameEdges::of_table(
        4,
        [[SHARED, no, no, no], [no, no, no, no], [no, no, SameEdge::Continued, no], [no, no, no, unknown]]
            .concat(),
    );
    let tally = Tally::new(&matched(&[(0, 0), (1, 1), (2, 2), (3, 3)]), &same);
    assert_eq!(tally, Tally { shared: 1, shared_found: 1, right: 2, wrong: 1, unjudged: 1 });
    assert_eq!((tally.precision(), tally.recall()), (Some(2.0 / 3.0), Some(1.0)));
    let twice = tally.plus(tally);
    assert_eq!((twice.right, twice.shared, twice.precision()), (4, 2, tally.precision()));
    assert_eq!((Tally::default().precision(), Tally::default().recall()), (None, None));
}
