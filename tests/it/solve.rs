//! `pelical solve` on small files of matched line pairs: documents, exit codes, and what bad files are told.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use crate::env::{Ended, TestEnv};

const FOCAL_PX: f64 = 600.0;
const CENTRE_PX: (f64, f64) = (320.0, 240.0);

/// A linear congruential generator, -1..1.
struct Random(u64);

impl Random {
    fn signed(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.signed(), self.signed(), self.signed())
    }
}

/// A segment as a camera measures it: `[u1, v1, u2, v2]`, and its ends in the camera's frame.
fn measured(random: &mut Random, ends: [Point3<f64>; 2]) -> ([f64; 4], [f64; 6]) {
    let (mut segment, mut line) = ([0.0; 4], [0.0; 6]);
    for (i, end) in ends.iter().enumerate() {
        let (x, y) = (end.x / end.z + 5e-4 * random.signed(), end.y / end.z + 5e-4 * random.signed());
        let z = 1.0 / (1.0 / end.z + 5e-4 * random.signed());
        segment[2 * i] = FOCAL_PX * x + CENTRE_PX.0;
        segment[2 * i + 1] = FOCAL_PX * y + CENTRE_PX.1;
        line[3 * i..3 * i + 3].copy_from_slice(&[x * z, y * z, z]);
    }
    (segment, line)
}

/// A problem of `n` lines, every fifth matched wrongly and every fourth without depth in the target.
fn problem(id: &str, seed: u64, n: usize) -> Value {
    let mut random = Random(seed);
    let turn = UnitQuaternion::from_scaled_axis(random.vector() * 0.3);
    let target_from_source = Isometry3::from_parts((random.vector() * 0.3).into(), turn);
    let lines: Vec<Value> = (0..n)
        .map(|i| {
            let middle = Point3::new(0.4 * random.signed(), 0.3 * random.signed(), 1.6 + 0.4 * random.signed());
            let half = random.vector().normalize() * 0.4;
            let source = [middle - half, middle + half];
            let mut target = source.map(|end| target_from_source * end);
            if i % 5 == 0 {
                target = target.map(|end| end + random.vector() * 0.3);
            }
            let (s2, s3) = measured(&mut random, source);
            let (t2, t3) = measured(&mut random, target);
            let t3 = if i % 4 == 0 { Value::Null } else { json!(t3) };
            let nt = if t3.is_null() { 0 } else { 40 };
            json!({"f": i / 3, "s2": s2, "t2": t2, "s3": s3, "t3": t3, "ns": 40, "nt": nt, "o": u8::from(i % 5 == 0)})
        })
        .collect();
    let (q, t) = (target_from_source.rotation.coords, target_from_source.translation.vector);
    json!({"id": id, "noise_px": 0.3, "outlier_rate": 0.2, "n": n, "lines": lines,
        "truth": {"q_xyzw": [q.x, q.y, q.z, q.w], "t_m": [t.x, t.y, t.z]}})
}

fn file(problems: &[Value]) -> String {
    problems.iter().map(|problem| format!("{problem}\n")).collect()
}

#[track_caller]
fn solve(text: &str, options: &[&str]) -> Ended {
    let env = TestEnv::new();
    env.write("pairs.jsonl", text);
    env.pelical(&[&["solve", "pairs.jsonl"], options].concat())
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

#[test]
fn every_problem_is_answered_with_the_keys_of_the_contract() {
    let text = file(&[problem("first", 1, 40), problem("second", 2, 40)]);
    let document = solve(&text, &["--json"]).expect_code(0).json();
    assert_eq!(keys(&document), ["problems", "schema"]);
    assert_eq!(document["schema"], "pelical.solve/1");
    let solved = document["problems"].as_array().unwrap();
    assert_eq!(solved.len(), 2);
    for (solved, id) in solved.iter().zip(["first", "second"]) {
        let expected =
            ["estimator", "id", "inliers", "reason", "solve_us", "state", "target_from_source", "truth"];
        assert_eq!(keys(solved), expected);
        assert_eq!((&solved["id"], &solved["estimator"]), (&id.into(), &"consensus".into()));
        assert_eq!((&solved["state"], &solved["reason"]), (&"converged".into(), &Value::Null));
        assert_eq!(keys(&solved["target_from_source"]), ["rotation_xyzw", "translation_m"]);
        assert_eq!(keys(&solved["truth"]), ["rotation_error_deg", "translation_error_mm"]);
        assert!(solved["truth"]["rotation_error_deg"].as_f64().unwrap() < 0.2, "{solved}");
        assert!(solved["truth"]["translation_error_mm"].as_f64().unwrap() < 5.0, "{solved}");
        assert!(solved["solve_us"].as_f64().unwrap() > 0.0);
        let inliers: Vec<u64> =
            solved["inliers"].as_array().unwrap().iter().filter_map(Value::as_u64).collect();
        assert!(inliers.len() > 28 && inliers.iter().all(|inlier| inlier % 5 != 0), "{inliers:?}");
    }
}

#[test]
fn marks_and_truth_do_not_reach_the_estimator() {
    let honest = problem("p", 3, 40);
    let mut scrambled = honest.clone();
    scrambled["truth"] = json!({"q_xyzw": [0.0, 1.0, 0.0, 0.0], "t_m": [9.0, 9.0, 9.0]});
    scrambled["outlier_rate"] = json!("half");
    for line in scrambled["lines"].as_array_mut().unwrap() {
        line["o"] = json!({"not": ["even", "a", "number"]});
    }
    let mut bare = honest.clone();
    bare.as_object_mut().unwrap().remove("truth");
    let solved = |problem: &Value, code| {
        let document = solve(&file(std::slice::from_ref(problem)), &["--estimator", "both", "--json"]);
        let mut problems = document.expect_code(code).json()["problems"].as_array().unwrap().clone();
        for problem in &mut problems {
            problem.as_object_mut().unwrap().retain(|key, _| key != "truth" && key != "solve_us");
        }
        problems
    };
    let expected = solved(&honest, 0);
    assert_eq!(
        solved(&scrambled, 1),
        expected,
        "converged far from what is said to be the truth is a failure"
    );
    assert_eq!(solved(&bare, 0), expected);
    let document = solve(&file(&[bare]), &["--json"]).json();
    assert!(!keys(&document["problems"][0]).contains(&"truth"));
}

#[test]
fn both_estimators_stand_side_by_side() {
    let text = file(&[problem("first", 1, 40), problem("second", 2, 40)]);
    let document = solve(&text, &["--estimator", "both", "--json"]).json();
    let order: Vec<(&str, &str)> = document["problems"]
        .as_array()
        .unwrap()
        .iter()
        .map(|solved| (solved["id"].as_str().unwrap(), solved["estimator"].as_str().unwrap()))
        .collect();
    let expected =
        [("first", "consensus"), ("first", "pelical"), ("second", "consensus"), ("second", "pelical")];
    assert_eq!(order, expected);
    let alone = solve(&text, &["--estimator", "pelical", "--json"]).json();
    assert_eq!(alone["problems"][0]["target_from_source"], document["problems"][1]["target_from_source"]);
    let said = solve(&text, &["--estimator", "both"]).stdout;
    for part in ["first", "consensus: 2 of 2 problems converged, 0 wrong", "pelical: ", "median"] {
        assert!(said.contains(part), "{part:?} is not in {said}");
    }
    solve(&text, &["--estimator", "guess"]).expect_code(2);
}

#[test]
fn a_problem_without_answer_has_a_reason_and_exit_code_4() {
    let mut empty = problem("empty", 1, 3);
    empty["lines"] = json!([]);
    let text = file(&[problem("good", 1, 40), problem("few", 4, 4), empty]);
    let document = solve(&text, &["--json"]).expect_code(4).json();
    for (index, code) in [(1, "not_enough_evidence"), (2, "no_lines")] {
        let solved = &document["problems"][index];
        assert_eq!((&solved["state"], &solved["target_from_source"]), (&"collecting".into(), &Value::Null));
        assert_eq!(solved["reason"]["code"], code);
        assert!(solved["reason"]["sentence"].as_str().unwrap().len() > 20, "{solved}");
        assert_eq!(solved["truth"]["rotation_error_deg"], Value::Null);
    }
}

#[test]
fn source_lines_without_depth_are_passed_over() {
    let mut passed_over = problem("p", 5, 60);
    for line in passed_over["lines"].as_array_mut().unwrap().iter_mut().take(12) {
        line["s3"] = Value::Null;
    }
    let document = solve(&file(&[passed_over]), &["--json"]).expect_code(0).json();
    let inliers = document["problems"][0]["inliers"].as_array().unwrap();
    assert!(inliers.iter().all(|inlier| inlier.as_u64().unwrap() >= 12), "{inliers:?}");
}

#[track_caller]
fn check_bad(change: impl Fn(&mut Value), parts: &[&str]) {
    let mut bad = problem("bad", 2, 12);
    change(&mut bad);
    let ended = solve(&file(&[problem("good", 1, 12), bad]), &["--json"]).expect_code(65);
    assert_eq!(ended.stdout, "", "no document without a result");
    ended.expect_talk(&["pairs.jsonl:2: "]).expect_talk(parts);
}

#[test]
fn impossible_values_are_told_with_file_line_and_key() {
    check_bad(
        |problem| problem["lines"][3]["s2"] = json!([1.0, 2.0, 1.0, 2.0]),
        &["lines[3].s2", "0 px long"],
    );
    check_bad(|problem| problem["lines"][3]["s2"][0] = json!(1e30), &["lines[3].s2 has 1.0e30:", "100000"]);
    check_bad(|problem| problem["lines"][4]["s3"][2] = json!(-1.0), &["lines[4].s3", "depth -1 m", "0.05"]);
    check_bad(|problem| problem["lines"][4]["s3"][5] = json!(0.0), &["lines[4].s3", "depth 0 m"]);
    check_bad(|problem| problem["lines"][4]["s3"][0] = json!(1e300), &["lines[4].s3", "fx = fy = 600"]);
    check_bad(|problem| problem["lines"][5]["nt"] = json!(1), &["lines[5].t3", "1 depth samples"]);
    check_bad(|problem| problem["noise_px"] = json!(-1.0), &["noise_px is -1", "0 to 100"]);
    check_bad(|problem| problem["truth"]["q_xyzw"] = json!([0, 0, 0, 0]), &["q_xyzw", "length 0"]);
    check_bad(|problem| problem["id"] = json!("good"), &["\"good\"", "line 1"]);
}

#[test]
fn what_is_not_the_format_is_told_with_file_and_line() {
    check_bad(|problem| problem["id"] = json!(7), &["column", "expected a string"]);
    check_bad(|problem| problem["lines"][0]["t2"] = json!([1, 2, 3]), &["column", "4"]);
    check_bad(|problem| problem["lines"][0]["ns"] = json!(-4), &["column", "-4"]);
    check_bad(|problem| problem["lines"][0]["f"] = json!("x"), &["column"]);
    for key in ["id", "lines"] {
        check_bad(|problem| drop(problem.as_object_mut().unwrap().remove(key)), &["missing field", key]);
    }
    for key in ["f", "s2", "t2", "s3", "t3", "ns", "nt"] {
        let remove = |problem: &mut Value| drop(problem["lines"][0].as_object_mut().unwrap().remove(key));
        check_bad(remove, &["missing field", key]);
    }
    let good = problem("good", 1, 12).to_string();
    for bad in
        [&good[..good.len() / 2], "{", "[]", "null", "NaN", "\u{0}", "{\"id\": \"x\", \"lines\": [1e999]}"]
    {
        solve(&format!("{good}\n\n{bad}\n"), &[]).expect_code(65).expect_talk(&["pairs.jsonl:3: column"]);
    }
    let infinite = good.replacen("\"f\":0", "\"f\":0,\"s2\":[1,2,3,1e999]", 1);
    solve(&infinite, &[]).expect_code(65).expect_talk(&["pairs.jsonl:1: column"]);
}

#[test]
fn files_that_cannot_be_read_are_told_by_name() {
    let env = TestEnv::new();
    env.pelical(&["solve", "nowhere.jsonl"]).expect_code(65).expect_talk(&["nowhere.jsonl", "No such file"]);
    env.pelical(&["solve", "."]).expect_code(65).expect_talk(&[".: cannot be read", "it is a folder"]);
    env.pelical(&["solve"]).expect_code(2);
    solve("", &[]).expect_code(65).expect_talk(&["pairs.jsonl", "no problem"]);
    solve(" \n\n", &[]).expect_code(65).expect_talk(&["no problem"]);
    let binary = TestEnv::new();
    std::fs::write(binary.path("pairs.jsonl"), [0xff, 0xfe, b'\n']).unwrap();
    binary.pelical(&["solve", "pairs.jsonl"]).expect_code(65).expect_talk(&["pairs.jsonl:1", "UTF-8"]);
}

#[test]
fn a_byte_order_mark_and_line_ends_of_other_systems_are_no_matter() {
    let text = format!("\u{feff}{}\r\n\r\n{}", problem("first", 1, 40), problem("second", 2, 40));
    solve(&text, &[]).expect_code(0);
}

#[test]
fn a_problem_of_thousands_of_lines_is_solved() {
    let document = solve(&file(&[problem("large", 1, 3000)]), &["--json"]).expect_code(0).json();
    assert!(document["problems"][0]["inliers"].as_array().unwrap().len() > 2000);
}
