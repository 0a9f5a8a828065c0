//! Reads matched line pairs: JSON lines, a problem on each.
//!
//! The cameras are part of the format: 640 x 480 with [`PINHOLE`], no distortion. What tells right matches from wrong ones (`o`) is
//! not read at all, and the truth comes back beside the problem, so that no estimator can see either.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use nalgebra::{Matrix2, Point3, Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;

use super::error::CliError;
use crate::geometry::camera::Pinhole;
use crate::geometry::motion::Motion;
use crate::geometry::{Camera, DepthFit, Distortion, EdgeSide, LineObservation, PixelPoint, Segment};
use crate::solver::LinePair;

/// Intrinsics of both cameras.
const PINHOLE: Pinhole = Pinhole { fx_px: 600.0, fy_px: 600.0, cx_px: 320.0, cy_px: 240.0 };
/// Standard deviation of one depth sample's inverse depth, 1/m: the D435i's, 0.08 px of disparity at 421 px and 5 cm.
const SIGMA_INVERSE_DEPTH_PER_M: f64 = 0.0038005;
/// Noise of the segments' ends where a problem does not say, px.
const DEFAULT_NOISE_PX: f64 = 0.5;
/// Noise that is allowed, px; what is said to be less than the least is raised to it, since coordinates are rounded.
const NOISE_PX: (f64, f64) = (0.02, 100.0);
/// Longest line of a file: a problem has thousands of matches at most, 300 bytes each.
const MAX_LINE_BYTES: u64 = 64 << 20;
/// Coordinates that are allowed, px.
const MAX_PX: f64 = 1e5;
/// Depths that are allowed, m.
const DEPTH_M: (f64, f64) = (0.05, 1000.0);
/// Shortest segment, px.
const MIN_LENGTH_PX: f64 = 1.0;
/// Most independent depth samples of one line.
const MAX_SAMPLES: u32 = 100_000;
/// The ends of the fitted line must lie this close to the rays of the segment's ends, px: else the intrinsics are others.
const MAX_OFF_RAY_PX: f64 = 20.0;

/// One problem: all that an estimator may see.
#[derive(Debug, Clone)]
pub struct Problem {
    /// Its name in the file.
    pub id: String,
    /// The matches that constrain the pose.
    pub pairs: Vec<LinePair>,
    /// For each of them its position in the file's list: a source line without depth constrains nothing.
    pub positions: Vec<usize>,
}

/// A problem with what is known of its answer.
#[derive(Debug, Clone)]
pub struct KnownProblem {
    /// The problem.
    pub problem: Problem,
    /// The true `target_from_source`, where the file gives it.
    pub truth: Option<Motion>,
}

#[derive(Deserialize)]
#[serde(expecting = "a problem as {...}")]
struct ProblemSection {
    id: String,
    noise_px: Option<f64>,
    lines: Vec<LineSection>,
    truth: Option<TruthSection>,
}

#[derive(Deserialize)]
#[serde(expecting = "a pose as {\"q_xyzw\": [...], \"t_m\": [...]}")]
struct TruthSection {
    q_xyzw: [f64; 4],
    t_m: [f64; 3],
}

#[derive(Deserialize)]
#[serde(expecting = "a pair of lines as {...}")]
struct LineSection {
    f: u32,
    s2: [f64; 4],
    t2: [f64; 4],
    // Null where there is no depth, but never left out.
    #[serde(deserialize_with = "Option::deserialize")]
    s3: Option<[f64; 6]>,
    #[serde(deserialize_with = "Option::deserialize")]
    t3: Option<[f64; 6]>,
    ns: u32,
    nt: u32,
}

/// Every problem of a file, in its order.
///
/// # Errors
/// When the file cannot be read or a line of it is not what the format promises; told with the number of the line.
pub fn read(path: &Path) -> Result<Vec<KnownProblem>, CliError> {
    let unreadable =
        |why: &dyn std::fmt::Display| bad(format_args!("{}: cannot be read: {why}", path.display()));
    if path.is_dir() {
        return Err(unreadable(&"it is a folder, a file of matched line pairs is expected"));
    }
    let file = File::open(path).map_err(|error| unreadable(&error))?;
    problems(BufReader::new(file), path)
}

/// Every problem of an open file.
fn problems(mut file: impl BufRead, path: &Path) -> Result<Vec<KnownProblem>, CliError> {
    let (mut problems, mut known) = (Vec::new(), BTreeMap::new());
    for number in 1.. {
        let place = |what: String| bad(format_args!("{}:{number}: {what}", path.display()));
        let mut bytes = Vec::new();
        let read = file.by_ref().take(MAX_LINE_BYTES + 1).read_until(b'\n', &mut bytes);
        match read.map_err(|error| place(error.to_string()))? {
            0 => break,
            n if n as u64 > MAX_LINE_BYTES => {
                return Err(place(format!("the line has more than {MAX_LINE_BYTES} bytes")));
            }
            _ => {}
        }
        let text = std::str::from_utf8(&bytes).map_err(|error| place(format!("not UTF-8 text: {error}")))?;
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.is_empty() {
            continue;
        }
        let section: ProblemSection = serde_json::from_str(text).map_err(|error| place(told(&error)))?;
        let problem = known_problem(section).map_err(place)?;
        if let Some(first) = known.insert(problem.problem.id.clone(), number) {
            let what = format!(
                "id {:?} is that of line {first} too; each problem needs its own",
                problem.problem.id
            );
            return Err(place(what));
        }
        problems.push(problem);
    }
    if problems.is_empty() {
        return Err(bad(format_args!(
            "{}: the file has no problem, one JSON object a line is expected",
            path.display()
        )));
    }
    Ok(problems)
}

fn bad(what: std::fmt::Arguments<'_>) -> CliError {
    CliError::BadInput(what.to_string())
}

/// The line is that of the file; serde_json counts from the start of each.
fn told(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let what = text.split(" at line ").next().unwrap_or(&text);
    format!("column {}: {what}", error.column())
}

/// A number for a message: hundreds of digits tell nobody anything.
fn short(value: f64) -> String {
    if value.abs() < 1e9 { value.to_string() } else { format!("{value:.1e}") }
}

fn known_problem(section: ProblemSection) -> Result<KnownProblem, String> {
    let noise_px = section.noise_px.unwrap_or(DEFAULT_NOISE_PX);
    if !(0.0..=NOISE_PX.1).contains(&noise_px) {
        return Err(format!("noise_px is {noise_px}: allowed is 0 to {} px", NOISE_PX.1));
    }
    let camera = Camera::try_new((640, 480), PINHOLE, Distortion::None).map_err(|error| error.to_string())?;
    let reader = LineReader { camera, noise_px: noise_px.max(NOISE_PX.0) };
    let (mut pairs, mut positions) = (Vec::new(), Vec::new());
    for (position, line) in section.lines.iter().enumerate() {
        if let Some(pair) = reader.pair(line).map_err(|what| format!("lines[{position}].{what}"))? {
            pairs.push(pair);
            positions.push(position);
        }
    }
    let truth = section.truth.map(|truth| motion(&truth)).transpose()?;
    Ok(KnownProblem { problem: Problem { id: section.id, pairs, positions }, truth })
}

fn motion(truth: &TruthSection) -> Result<Motion, String> {
    let [x, y, z, w] = truth.q_xyzw;
    let quaternion = Quaternion::new(w, x, y, z);
    if (quaternion.norm() - 1.0).abs() > 1e-3 {
        return Err(format!("truth.q_xyzw has the length {}: a rotation has 1", quaternion.norm()));
    }
    Ok(Motion::from_parts(Translation3::from(truth.t_m), UnitQuaternion::new_normalize(quaternion)))
}

struct LineReader {
    camera: Camera,
    noise_px: f64,
}

impl LineReader {
    /// `None` where the source has no depth: such a match constrains nothing this way round.
    fn pair(&self, line: &LineSection) -> Result<Option<LinePair>, String> {
        let source = self.observation(("s", line.s2), line.s3, line.ns)?;
        let target = self.observation(("t", line.t2), line.t3, line.nt)?;
        Ok(LinePair::try_new(&target, &source, line.f))
    }

    /// `side` is `s` or `t`, the first letter of the keys.
    fn observation(
        &self,
        (side, segment): (&str, [f64; 4]),
        ends_m: Option<[f64; 6]>,
        n_samples: u32,
    ) -> Result<LineObservation, String> {
        if let Some(px) = segment.iter().find(|px| px.abs() > MAX_PX) {
            return Err(format!("{side}2 has {}: allowed is -{MAX_PX} to {MAX_PX} px", short(*px)));
        }
        let [start, end] = [0, 2].map(|i| PixelPoint { x: segment[i], y: segment[i + 1] });
        let segment = Segment { start, end, sigma_across_px: self.noise_px };
        if segment.length_px() < MIN_LENGTH_PX {
            let length_px = segment.length_px();
            return Err(format!("{side}2 is {length_px} px long: a segment has at least {MIN_LENGTH_PX} px"));
        }
        let depth = ends_m.map(|ends_m| self.depth(&segment, &ends_m, n_samples)).transpose();
        Ok(LineObservation {
            segment,
            ends: [start, end].map(|end| self.camera.ray_from_pixel(end)),
            sigma_across: self.noise_px / self.camera.mean_focal_px(),
            depth: depth.map_err(|what| format!("{side}3 {what}"))?,
        })
    }

    fn depth(&self, segment: &Segment, ends_m: &[f64; 6], n_samples: u32) -> Result<DepthFit, String> {
        if !(2..=MAX_SAMPLES).contains(&n_samples) {
            return Err(format!("is of {n_samples} depth samples: allowed are 2 to {MAX_SAMPLES}"));
        }
        let [a, b] = [0, 3].map(|i| Point3::new(ends_m[i], ends_m[i + 1], ends_m[i + 2]));
        for (end_m, at) in [(a, segment.start), (b, segment.end)] {
            if !(DEPTH_M.0..=DEPTH_M.1).contains(&end_m.z) {
                return Err(format!(
                    "has the depth {} m: allowed is {} to {} m",
                    short(end_m.z),
                    DEPTH_M.0,
                    DEPTH_M.1
                ));
            }
            let off_px = self
                .camera
                .project(&end_m)
                .map_or(f64::INFINITY, |pixel| (pixel.x - at.x).hypot(pixel.y - at.y));
            if off_px > MAX_OFF_RAY_PX {
                return Err(format!(
                    "has an end {} px away from the segment's in the image (limit {MAX_OFF_RAY_PX} px): the format's \
                     cameras have fx = fy = 600, cx = 320, cy = 240 px",
                    short(off_px.round())
                ));
            }
        }
        Ok(DepthFit {
            inverse_depth_per_m: [1.0 / a.z, 1.0 / b.z],
            covariance_per_m2: covariance_per_m2(n_samples),
            inlier_ratio: 1.0,
            n_inliers: n_samples,
            side: EdgeSide::Both,
        })
    }
}

/// Covariance of the inverse depths at both ends of a line fitted to `n` samples spaced evenly along it, the ends included:
/// `(HᵀH)⁻¹ σ²` with rows `H = [1 - λ, λ]`. With λ = i / (n - 1) the sums have closed forms.
fn covariance_per_m2(n_samples: u32) -> Matrix2<f64> {
    let n = f64::from(n_samples);
    // Σ λ² = Σ (1 - λ)² = n (2n - 1) / (6 (n - 1)), Σ λ (1 - λ) = n (n - 2) / (6 (n - 1)).
    let factor = n / (6.0 * (n - 1.0));
    let (own, mixed) = (factor * (2.0 * n - 1.0), factor * (n - 2.0));
    let adjugate = Matrix2::new(own, -mixed, -mixed, own);
    let determinant = own * own - mixed * mixed;
    adjugate * (SIGMA_INVERSE_DEPTH_PER_M * SIGMA_INVERSE_DEPTH_PER_M / determinant)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::tests::hostile::check_any_bytes;

    const PROBLEM: &str = r#"{"id": "a", "noise_px": 0.3, "lines": [
        {"f": 0, "s2": [100, 200, 300, 220], "t2": [90, 210, 280, 200], "s3": [-0.733333, -0.133333, 2.0, -0.066667, -0.066667, 2.0], "t3": null, "ns": 30, "nt": 0, "o": 0},
        {"f": 1, "s2": [10.5, 20, 30, 400], "t2": [-9e1, 21, 28, 200.25], "s3": null, "t3": null, "ns": 0, "nt": 0}],
        "truth": {"q_xyzw": [0, 0, 0, 1], "t_m": [0.1, 0, 0]}}"#;

    #[test]
    fn line_pairs_of_any_bytes_are_refused_with_their_line_or_sound() {
        let one = PROBLEM.replace('\n', " ");
        let two = format!("\u{feff}{one}\r\n\n{}\n", one.replace("\"id\": \"a\"", "\"id\": \"b\""));
        check_any_bytes("line pairs", &[one.into_bytes(), two.into_bytes()], |bytes| {
            match problems(bytes, Path::new("p.jsonl")) {
                Ok(problems) => {
                    let pairs = problems.iter().map(|known| &known.problem);
                    assert!(pairs.into_iter().all(|problem| problem.pairs.len() == problem.positions.len()));
                    let poses = problems.iter().filter_map(|known| known.truth);
                    assert!(
                        poses.into_iter().all(|truth| truth.translation.vector.iter().all(|t| t.is_finite()))
                    );
                    true
                }
                Err(error) => {
                    let said = error.to_string();
                    let has_line = said.split(':').nth(1).is_some_and(|number| number.parse::<u32>().is_ok());
                    assert!(
                        said.starts_with("p.jsonl:") && (has_line || said.contains("no problem")),
                        "{said}"
                    );
                    false
                }
            }
        });
    }

    #[test]
    fn the_covariance_of_the_depths_is_that_of_the_regression() {
        for n in [2, 3, 10, 64] {
            let mut information = Matrix2::zeros();
            for i in 0..n {
                let lambda = f64::from(i) / f64::from(n - 1);
                let row = Vector2::new(1.0 - lambda, lambda);
                information += row * row.transpose() / SIGMA_INVERSE_DEPTH_PER_M.powi(2);
            }
            let identity = covariance_per_m2(n) * information;
            assert!((identity - Matrix2::identity()).norm() < 1e-9, "{n}: {identity}");
        }
    }
}
