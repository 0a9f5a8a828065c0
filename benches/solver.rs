//! Time of both estimators on one core: roots of three quadrics, exact voting with its growth, complete solves by the paper's
//! estimator and by consensus. Each answer is checked before it is timed.
#![allow(missing_docs, reason = "criterion_group! writes an undocumented function")]
#![allow(clippy::expect_used, reason = "a bench stops at the first wrong answer")]
use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix2, Matrix3, Point3, Quaternion, RowSVector, SMatrix, UnitQuaternion, Vector3, Vector4};
use pelical::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use pelical::geometry::{DepthFit, EdgeSide, LineObservation, PixelPoint, RayPoint, Segment};
use pelical::solver::matched::{MatchedLimits, solve_matches};
use pelical::solver::paper::convergence_vote::{Tolerance, convergence_vote};
use pelical::solver::paper::re3q3::re3q3;
use pelical::solver::paper::translation_candidate::{TranslationCandidate, TranslationLine};
use pelical::solver::paper::{PaperOptions, solve_pairs};
use pelical::solver::{LinePair, TargetSide};

const FOCAL_PX: f64 = 600.0;
const SIGMA_ACROSS: f64 = 0.3 / FOCAL_PX;
/// D435i: constant in inverse depth, a few independent samples per line.
const SIGMA_INVERSE_DEPTH_PER_M: f64 = 0.002;
/// Share of pairs that are no match.
const OUTLIERS: f64 = 0.4;

/// splitmix64.
struct Random(u64);

impl Random {
    /// Uniform in -1..1.
    fn signed(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Nearly normal, of unit variance.
    fn gaussian(&mut self) -> f64 {
        (0..12).map(|_| 0.5 * self.signed()).sum()
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.gaussian(), self.gaussian(), self.gaussian())
    }
}

/// Three constraints `n . R d = 0` that a rotation fulfils, as quadrics of its vector s in the paper's order of eq. 5.
fn quadrics_of(random: &mut Random, truth: &UnitQuaternion<f64>) -> SMatrix<f64, 3, 10> {
    let rows: [RowSVector<f64, 10>; 3] = std::array::from_fn(|_| {
        let direction = random.vector().normalize();
        let weights: Matrix3<f64> = (truth * direction).cross(&random.vector()) * direction.transpose();
        let form = |q: Vector4<f64>| {
            let rotation = UnitQuaternion::from_quaternion(Quaternion::from(q)).to_rotation_matrix();
            rotation.matrix().dot(&weights) * q.norm_squared()
        };
        let unit = |i: usize| Vector4::ith(i, 1.0);
        let mixed = |i: usize, j: usize| form(unit(i) + unit(j)) - form(unit(i)) - form(unit(j));
        RowSVector::from([
            form(unit(0)),
            form(unit(1)),
            form(unit(2)),
            mixed(0, 1),
            mixed(0, 2),
            mixed(1, 2),
            mixed(0, 3),
            mixed(1, 3),
            mixed(2, 3),
            form(unit(3)),
        ])
    });
    SMatrix::from_rows(&rows)
}

fn roots(criterion: &mut Criterion) {
    let mut random = Random(1);
    let problems: Vec<SMatrix<f64, 3, 10>> = (0..500)
        .map(|_| {
            let q = Vector4::from_fn(|_, _| random.gaussian());
            let truth = UnitQuaternion::from_quaternion(Quaternion::from(q));
            let quadrics = quadrics_of(&mut random, &truth);
            let roots = re3q3(&quadrics);
            let rotation = |s: &Vector3<f64>| UnitQuaternion::from_quaternion(Quaternion::from(s.push(1.0)));
            let is_found = roots.as_slice().iter().any(|s| rotation(s).angle_to(&truth) < 1e-6);
            assert!(is_found, "{truth} is not among {roots:?}");
            quadrics
        })
        .collect();
    criterion.bench_function("re3q3, mean of 500 rotations", |bencher| {
        bencher.iter_custom(|n_iterations| {
            let start = Instant::now();
            for i in 0..n_iterations as usize {
                black_box(re3q3(black_box(&problems[i % problems.len()])));
            }
            start.elapsed()
        });
    });
}

/// What a camera measures, with noise, of the edge between two points of its frame.
fn observed(random: &mut Random, ends_m: &[Point3<f64>; 2]) -> LineObservation {
    let [a, b] = ends_m.map(|end_m| end_m.coords.xy() / end_m.z);
    let along = (b - a).normalize();
    let mut ray = |end: nalgebra::Vector2<f64>| {
        let off = SIGMA_ACROSS * random.gaussian();
        RayPoint { x: end.x - along.y * off, y: end.y + along.x * off }
    };
    let ends = [ray(a), ray(b)];
    let [start, end] = ends.map(|ray| PixelPoint { x: FOCAL_PX * ray.x, y: FOCAL_PX * ray.y });
    let inverse_depth_per_m =
        ends_m.map(|end_m| 1.0 / end_m.z + SIGMA_INVERSE_DEPTH_PER_M * random.gaussian());
    LineObservation {
        segment: Segment { start, end, sigma_across_px: 0.3 },
        ends,
        sigma_across: SIGMA_ACROSS,
        depth: Some(DepthFit {
            inverse_depth_per_m,
            covariance_per_m2: Matrix2::identity() * SIGMA_INVERSE_DEPTH_PER_M.powi(2),
            inlier_ratio: 1.0,
            n_inliers: 50,
            side: EdgeSide::Both,
        }),
    }
}

fn target_from_source() -> Motion {
    Motion::new(Vector3::new(0.3, -0.05, 0.1), Vector3::new(0.1, 0.6, -0.2))
}

/// Full pairs of which [`OUTLIERS`] are wrong by up to a metre.
fn pairs(random: &mut Random, n_pairs: usize) -> Vec<LinePair> {
    (0..n_pairs)
        .map(|_| {
            let mut point =
                || Point3::new(0.8 * random.signed(), 0.6 * random.signed(), 2.0 + 0.7 * random.signed());
            let source_m = [point(), point()];
            let extent_m = source_m[1] - source_m[0];
            let mut target_m = [0.2, 1.1].map(|k| target_from_source() * (source_m[0] + extent_m * k));
            if random.signed() < 2.0 * OUTLIERS - 1.0 {
                let shift_m = Vector3::new(random.signed(), random.signed(), random.signed());
                target_m = target_m.map(|end_m| end_m + shift_m);
            }
            let (target, source) = (observed(random, &target_m), observed(random, &source_m));
            LinePair::try_new(&target, &source, 0).expect("lifted lines")
        })
        .collect()
}

fn candidates(n_lines: usize) -> Vec<TranslationCandidate> {
    let mut random = Random(n_lines as u64);
    let rotation = target_from_source().rotation.to_rotation_matrix();
    let candidate = |pair: &LinePair| TranslationCandidate::try_new(pair, &rotation, 0.5);
    pairs(&mut random, n_lines).iter().filter_map(candidate).collect()
}

/// Largest number of votes by the paper's triple loop.
fn most_votes(
    candidates: &[TranslationCandidate],
    votes: impl Fn(&TranslationCandidate, &Vector3<f64>) -> bool,
) -> usize {
    let lines: Vec<&TranslationLine> = candidates
        .iter()
        .filter_map(|candidate| match candidate {
            TranslationCandidate::Line(line) => Some(line),
            TranslationCandidate::Plane(_) => None,
        })
        .collect();
    let mut most = 0;
    for (i, a) in lines.iter().enumerate() {
        for b in &lines[i + 1..] {
            // Where the distance vector of two points of the lines is normal to both.
            let between_m = b.point_m - a.point_m;
            let cosine = a.direction.dot(&b.direction);
            let system = Matrix2::new(1.0, -cosine, cosine, -1.0);
            let right = nalgebra::Vector2::new(between_m.dot(&a.direction), between_m.dot(&b.direction));
            let Some(inverse) = system.try_inverse() else { continue };
            let at = inverse * right;
            let middle_m = (a.point_m + *a.direction * at.x + b.point_m + *b.direction * at.y) * 0.5;
            most = most.max(candidates.iter().filter(|candidate| votes(candidate, &middle_m)).count());
        }
    }
    most
}

fn check_vote(candidates: &[TranslationCandidate], tolerance: Tolerance) {
    let vote = convergence_vote(candidates, tolerance).expect("lines that meet");
    let error_m = (vote.point_m - target_from_source().translation.vector).norm();
    assert!(error_m < 0.02, "{} lines vote for a point that is {error_m} m off", vote.inliers.len());
    let votes = |candidate: &TranslationCandidate, point_m: &Vector3<f64>| {
        let reach_m = match tolerance {
            Tolerance::Fixed { epsilon_m } => epsilon_m,
            Tolerance::Sigmas { n, floor_m } => (n * candidate.sigma_m(point_m)).max(floor_m),
        };
        candidate.distance_m(point_m) < reach_m
    };
    assert_eq!(vote.inliers.len(), most_votes(candidates, votes));
}

fn voting(criterion: &mut Criterion) {
    let tolerances = [
        ("7 mm", Tolerance::Fixed { epsilon_m: 0.007 }),
        ("3 sigma", Tolerance::Sigmas { n: 3.0, floor_m: 0.003 }),
    ];
    for (name, tolerance) in tolerances {
        let mut growth = Vec::new();
        for n_lines in [100, 200, 500, 1000] {
            let candidates = candidates(n_lines);
            check_vote(&candidates, tolerance);
            let mut fastest = Duration::MAX;
            criterion.bench_function(&format!("exact voting of {n_lines} lines, {name}"), |bencher| {
                bencher.iter_custom(|n_iterations| {
                    let start = Instant::now();
                    for _ in 0..n_iterations {
                        black_box(convergence_vote(black_box(&candidates), tolerance));
                    }
                    let elapsed = start.elapsed();
                    fastest = fastest.min(elapsed / n_iterations as u32);
                    elapsed
                });
            });
            // Nothing was measured where a filter leaves this size out.
            if fastest < Duration::MAX {
                growth.push((n_lines, fastest.as_secs_f64()));
            }
        }
        for pair in growth.windows(2) {
            let ((n, time_s), (next_n, next_time_s)) = (pair[0], pair[1]);
            let exponent = (next_time_s / time_s).ln() / (next_n as f64 / n as f64).ln();
            println!("{name}: from {n} to {next_n} lines as the number to the power of {exponent:.2}");
        }
    }
}

/// Pairs of which [`OUTLIERS`] are wrong and a quarter has no target depth.
fn mixed_pairs(n_pairs: usize) -> Vec<LinePair> {
    let mut pairs = pairs(&mut Random(n_pairs as u64), n_pairs);
    for pair in pairs.iter_mut().step_by(4) {
        if let TargetSide::Full(line) = &pair.target {
            pair.target = TargetSide::Pnl(LineObservation { depth: None, ..line.observation });
        }
    }
    pairs
}

/// Whole solves of 50 and of 200 pairs, once the pose is right.
fn whole(criterion: &mut Criterion, name: &str, solve: impl Fn(&[LinePair]) -> Option<Motion>) {
    for n_pairs in [50, 200] {
        let pairs = mixed_pairs(n_pairs);
        let found = solve(&pairs).expect("enough right pairs");
        let gap_deg = rotation_gap_rad(&found, &target_from_source()).to_degrees();
        let gap_mm = 1e3 * translation_gap_m(&found, &target_from_source());
        assert!(gap_deg < 0.5 && gap_mm < 20.0, "{gap_deg} deg, {gap_mm} mm off");
        criterion.bench_function(&format!("complete solve of {n_pairs} lines, {name}"), |bencher| {
            bencher.iter(|| solve(black_box(&pairs)));
        });
    }
}

/// The paper's estimator: quadratic system, roots, refinement and voting; and consensus: draws, refinement and verdict.
fn complete_solve(criterion: &mut Criterion) {
    let variants = [("as published", PaperOptions::as_published()), ("whitened", PaperOptions::whitened())];
    for (name, options) in variants {
        whole(criterion, name, |pairs| solve_pairs(pairs, &options).target_from_source);
    }
    let limits = MatchedLimits::default();
    whole(criterion, "consensus", |pairs| solve_matches(pairs, &limits).target_from_source);
}

criterion_group!(benches, roots, voting, complete_solve);
criterion_main!(benches);
