//! The parts that need no runtime.

use super::*;
use crate::learned::calibration::{ASSIGNED, matches};
use crate::learned::samples::Samples;

fn long(n: usize, length_px: f64) -> Vec<Segment> {
    (0..n).map(|row| segment([0.0, row as f64, length_px, row as f64])).collect()
}

#[test]
fn points_are_12_px_apart_with_both_ends_and_at_most_40() {
    let n = |length_px: f64| Samples::along(&long(1, length_px)).points.len();
    assert_eq!([3.0, 23.0, 24.0, 120.0, 600.0].map(n), [2, 2, 3, 11, 40]);
    let samples = Samples::along(&[segment([10.0, 20.0, 10.0, 50.0])]);
    assert_eq!(samples.points.first(), Some(&PixelPoint { x: 10.0, y: 20.0 }));
    assert_eq!(samples.points.last(), Some(&PixelPoint { x: 10.0, y: 50.0 }));
}

#[test]
fn segments_that_are_no_numbers_do_no_harm() {
    for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let samples = Samples::along(&[segment([x, 0.0, 30.0, 0.0]), segment([0.0, 0.0, 30.0, 0.0])]);
        assert!(samples.points.len() <= 42 && samples.of_line.len() == samples.lines.len());
    }
}

#[test]
fn many_lines_have_points_further_apart_and_then_the_shortest_none() {
    let samples = Samples::along(&long(100, 120.0));
    assert_eq!(samples.lines.len(), 100);
    assert!((600..=800).contains(&samples.points.len()), "{}", samples.points.len());
    let mut many = long(500, 60.0);
    many[17] = segment([0.0, 0.0, 300.0, 0.0]);
    many.push(segment([0.0, 0.0, 8.0, 0.0]));
    let samples = Samples::along(&many);
    assert!(samples.points.len() <= 800);
    assert!(samples.lines.contains(&17) && !samples.lines.contains(&500));
    assert!(samples.lines.is_sorted());
}

fn one_to_one(n: usize, score: f32) -> Scores {
    let all: Vec<usize> = (0..n).collect();
    Scores::new(all.clone(), all, |row, col| if row == col { score } else { 0.0 })
}

#[test]
fn evidence_grows_with_the_score_and_is_bounded() {
    let nats = |score: f32| matches(&one_to_one(60, score), &ASSIGNED)[0].nats;
    let scores = [0.05, 0.1, 0.2, 0.4, 0.9].map(nats);
    assert!(scores.is_sorted() && scores[0] > 0.5 && scores[4] <= 6.0 && scores[4] > 5.5, "{scores:?}");
    assert_eq!(matches(&one_to_one(60, 0.004), &ASSIGNED), []);
}

#[test]
fn where_little_is_matched_at_all_a_high_score_says_little() {
    let alone = matches(&one_to_one(1, 0.3), &ASSIGNED)[0].nats;
    let among_many = matches(&one_to_one(60, 0.3), &ASSIGNED)[0].nats;
    assert!(alone < 0.5 && among_many > 5.0, "{alone} {among_many}");
}

#[test]
fn a_pair_with_a_better_rival_has_less_evidence() {
    let all: Vec<usize> = (0..40).collect();
    let scores = Scores::new(all.clone(), all, |row, col| match (row, col) {
        (0, 1) => 0.1,
        _ if row == col => 0.4,
        _ => 0.0,
    });
    let found = matches(&scores, &ASSIGNED);
    let without = Scores::new(vec![0, 1], vec![0, 1], |row, col| scores.at(row, col));
    assert_eq!(without.at(0, 1), 0.1);
    let nats = |target, source| {
        found.iter().find(|found| (found.target, found.source) == (target, source)).expect("listed").nats
    };
    assert!(nats(0, 1) > 0.0 && nats(0, 1) < nats(0, 0) - 1.0);
}

#[test]
fn scores_that_are_no_numbers_are_no_candidates() {
    assert_eq!(matches(&one_to_one(3, f32::NAN), &ASSIGNED), []);
}
