//! Counts the lines that two cameras truly share, for one segment detector or another: what a detector is worth to the estimator.
//!
//! `cargo run --release --example shared_lines -- [--detector own|lsdetect] [--segments FILE] RECORDING...`
//!
//! Whatever finds the segments, the rest is the same: at least as long as the detector's option says, the longest ones up to its limit,
//! brighter side on the right, lifted by the library. Two lifted lines of one frame set are shared when the ground truth carries one
//! onto the other within three standard deviations (squared Mahalanobis distance of the four measured numbers below the quantile that
//! three standard deviations have in one dimension), and when they overlap or lie no farther apart along the line than they are long
//! together. Each line counts once. The same count under poses that are wrong on purpose says how many are shared by chance.
//! `--segments` takes what `scripts/compare_detectors.py segments` writes.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::{Parser, ValueEnum};
use nalgebra::Vector3;
use pelical::capture::RgbdFrame;
use pelical::capture::recording::Recording;
use pelical::geometry::motion::Motion;
use pelical::geometry::{CameraView, PixelPoint, Segment};
use pelical::image::{GrayView, RgbView, gray_from_rgb};
use pelical::lines::{DetectOptions, Detector, LiftOptions, Lifter};
use pelical::solver::evidence::EvidenceLine;
use pelical::solver::residual::match_residual;

/// 99.73 % of a chi-square distribution of four degrees of freedom: what 3 standard deviations are in one.
const MAX_DISTANCE2: f64 = 16.25;
/// Wrong poses: the true one, moved so far along each axis, both ways, m. Bundles of parallel lines stay parallel: the worst chance.
const WRONG_BY_M: f64 = 0.3;
/// Deviation across that segments from elsewhere are given, px: they come without one.
const FOREIGN_SIGMA_PX: f64 = 0.2;
/// Distance from a foreign segment at which its brighter side is looked for, px.
const SIDE_PX: f64 = 2.0;

#[derive(Parser)]
struct Arguments {
    /// Folders with a recording and its ground truth.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Who finds the segments.
    #[arg(long, value_enum, default_value = "own")]
    detector: DetectorName,
    /// Segments from a file instead, of any detector.
    #[arg(long)]
    segments: Option<PathBuf>,
    /// Shortest segment, px; as the detector's own default where it is not given.
    #[arg(long)]
    min_length_px: Option<f64>,
    /// Most segments of an image, likewise.
    #[arg(long)]
    max_segments: Option<usize>,
}

#[derive(Clone, Copy, ValueEnum)]
enum DetectorName {
    Own,
    Lsdetect,
}

/// Segments by image: `<folder of the recording>/<camera>/<stamp>`.
type SegmentsByImage = BTreeMap<String, Vec<Segment>>;

/// Where segments come from.
enum Origin {
    Own(Box<Detector>),
    Lsdetect,
    Listed(SegmentsByImage),
}

struct Finder {
    origin: Origin,
    /// For all origins.
    options: DetectOptions,
}

/// Sums over frame sets and pairs of cameras.
#[derive(Default)]
struct Counts {
    segments: usize,
    length_px: f64,
    lifted: usize,
    shared: usize,
    by_chance: f64,
    /// Squares of whitened offsets across, of shared lines.
    across2: f64,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let mut options = DetectOptions::default();
    options.min_length_px = arguments.min_length_px.unwrap_or(options.min_length_px);
    options.max_segments = arguments.max_segments.unwrap_or(options.max_segments);
    let origin = match (&arguments.segments, arguments.detector) {
        (Some(file), _) => Origin::Listed(read_segments(file)?),
        (None, DetectorName::Own) => Origin::Own(Box::new(Detector::new(options))),
        (None, DetectorName::Lsdetect) => Origin::Lsdetect,
    };
    let mut finder = Finder { origin, options };
    println!(
        "{:42} {:>8} {:>7} {:>6} {:>6} {:>6} {:>6}",
        "recording", "segments", "mean px", "lifted", "shared", "chance", "across"
    );
    let mut total = Counts::default();
    for folder in &arguments.recordings {
        let counts = count(folder, &mut finder).with_context(|| folder.display().to_string())?;
        print(&name_of(folder)?, &counts);
        total.add(&counts);
    }
    print("all", &total);
    Ok(())
}

fn print(name: &str, counts: &Counts) {
    let Counts { segments, length_px, lifted, shared, by_chance, across2 } = counts;
    println!(
        "{name:42} {segments:8} {:7.1} {lifted:6} {shared:6} {by_chance:6.1} {:6.2}",
        length_px / (*segments).max(1) as f64,
        (across2 / (2 * shared).max(1) as f64).sqrt()
    );
}

impl Counts {
    fn add(&mut self, other: &Self) {
        self.segments += other.segments;
        self.length_px += other.length_px;
        self.lifted += other.lifted;
        self.shared += other.shared;
        self.by_chance += other.by_chance;
        self.across2 += other.across2;
    }

    fn add_pair(&mut self, targets: &[EvidenceLine], sources: &[EvidenceLine], target_from_source: &Motion) {
        let shared = shared_lines(targets, sources, target_from_source);
        self.shared += shared.len();
        self.across2 += shared.iter().map(|(_, across2)| across2).sum::<f64>();
        let wrong = (0..6).map(|way| {
            let mut by_m = Vector3::zeros();
            by_m[way / 2] = if way % 2 == 0 { WRONG_BY_M } else { -WRONG_BY_M };
            Motion::translation(by_m.x, by_m.y, by_m.z) * target_from_source
        });
        self.by_chance +=
            wrong.map(|wrong| shared_lines(targets, sources, &wrong).len() as f64).sum::<f64>() / 6.0;
    }
}

fn name_of(folder: &Path) -> Result<String> {
    let name =
        folder.canonicalize()?.file_name().context("a recording has a name")?.to_string_lossy().into_owned();
    Ok(name)
}

fn count(folder: &Path, finder: &mut Finder) -> Result<Counts> {
    let recording = Recording::open(folder)?;
    let truth = recording.ground_truth()?.context("no ground truth")?;
    let name = name_of(folder)?;
    let mut counts = Counts::default();
    let mut frame = RgbdFrame::default();
    for set in recording.frame_sets() {
        let mut lines = Vec::new();
        for (camera_idx, stamp) in set.iter().enumerate() {
            recording.read_frame(camera_idx, *stamp, &mut frame)?;
            let info = &recording.cameras()[camera_idx];
            let segments = finder.segments(&frame, &format!("{name}/{}/{}", info.name, stamp.0))?;
            let mut view = CameraView::default();
            let depth = frame.depth_view().context("a depth image")?;
            Lifter::new(LiftOptions::default()).lift(&segments, &depth, &info.camera, &mut view.lines);
            counts.segments += segments.len();
            counts.length_px += segments.iter().map(Segment::length_px).sum::<f64>();
            let lifted: Vec<EvidenceLine> = view.lines.iter().filter_map(EvidenceLine::try_new).collect();
            counts.lifted += lifted.len();
            lines.push(lifted);
        }
        for target in 0..lines.len() {
            for source in target + 1..lines.len() {
                let of = &truth.reference_from_camera;
                counts.add_pair(&lines[target], &lines[source], &(of[target].inverse() * of[source]));
            }
        }
    }
    Ok(counts)
}

/// One-to-one pairs that agree under a pose, with the sum of the squares of their two whitened offsets.
fn shared_lines(
    targets: &[EvidenceLine],
    sources: &[EvidenceLine],
    target_from_source: &Motion,
) -> Vec<([usize; 2], f64)> {
    let mut pairs = Vec::new();
    for (target_idx, target) in targets.iter().enumerate() {
        for (source_idx, source) in sources.iter().enumerate() {
            if !are_near(target, source, target_from_source) {
                continue;
            }
            let Some(found) = match_residual(target, source, target_from_source) else { continue };
            let Some(cholesky) = found.covariance.cholesky() else { continue };
            let distance2 = found.residual.dot(&cholesky.solve(&found.residual));
            if distance2 <= MAX_DISTANCE2 {
                let log_sigmas: f64 = cholesky.l_dirty().diagonal().iter().map(|sigma| sigma.ln()).sum();
                let across2 = (0..2).map(|i| found.residual[i].powi(2) / found.covariance[(i, i)]).sum();
                pairs.push((0.5 * distance2 + log_sigmas, [target_idx, source_idx], across2));
            }
        }
    }
    // The likeliest pairs first, so that a precise line is not taken by a vague one.
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut target_used, mut source_used) = (vec![false; targets.len()], vec![false; sources.len()]);
    pairs.retain(|(_, [target, source], _)| {
        let is_free = !target_used[*target] && !source_used[*source];
        if is_free {
            (target_used[*target], source_used[*source]) = (true, true);
        }
        is_free
    });
    pairs.into_iter().map(|(_, pair, across2)| (pair, across2)).collect()
}

/// Whether two lines overlap along their common direction, or their gap is no longer than both together; and they are no farther
/// apart across than that (the residual tells the rest).
fn are_near(target: &EvidenceLine, source: &EvidenceLine, target_from_source: &Motion) -> bool {
    let ends_m = source.ends_m.map(|end_m| target_from_source * end_m);
    let direction = target.direction;
    let along = |point: &nalgebra::Point3<f64>| (point - target.ends_m[0]).dot(&direction);
    let length_m = along(&target.ends_m[1]);
    let (a, b) = (along(&ends_m[0]), along(&ends_m[1]));
    let gap_m = (a.min(b) - length_m).max(-a.max(b));
    let source_m = (ends_m[1] - ends_m[0]).norm();
    gap_m <= length_m + source_m
}

impl Finder {
    fn segments(&mut self, frame: &RgbdFrame, image_name: &str) -> Result<Vec<Segment>> {
        let size = (frame.width, frame.height);
        let mut gray = Vec::new();
        gray_from_rgb(&frame.rgb, &mut gray);
        let image = GrayView::try_new(&gray, size, frame.width).context("an image")?;
        let mut segments = Vec::new();
        match &mut self.origin {
            Origin::Own(detector) => {
                let rgb = RgbView::try_new(&frame.rgb, size, 3 * frame.width).context("an image")?;
                detector.detect_color(&image, &rgb, &mut segments);
                return Ok(segments);
            }
            Origin::Lsdetect => {
                let found = lsdetect::detect(&gray, frame.width, frame.height, lsdetect::SCALE)?;
                segments.extend(found.iter().map(|s| foreign([s.x1, s.y1, s.x2, s.y2])));
            }
            Origin::Listed(listed) => {
                let found = listed.get(image_name).with_context(|| format!("no segments of {image_name}"))?;
                segments.extend(found);
            }
        }
        segments.retain(|segment| segment.length_px() >= self.options.min_length_px);
        segments.sort_by(|a, b| b.length_px().total_cmp(&a.length_px()));
        segments.truncate(self.options.max_segments);
        segments.iter_mut().for_each(|segment| put_brighter_side_right(segment, &image));
        Ok(segments)
    }
}

fn foreign([x1, y1, x2, y2]: [f64; 4]) -> Segment {
    let (start, end) = (PixelPoint { x: x1, y: y1 }, PixelPoint { x: x2, y: y2 });
    Segment { start, end, sigma_across_px: FOREIGN_SIGMA_PX }
}

/// Turns a segment round where its left hand is brighter.
fn put_brighter_side_right(segment: &mut Segment, image: &GrayView<'_>) {
    let Segment { start, end, .. } = *segment;
    let length_px = segment.length_px();
    let (dx, dy) = ((end.x - start.x) / length_px, (end.y - start.y) / length_px);
    let level = |x: f64, y: f64| {
        let column = (x.round().max(0.0) as usize).min(image.width() - 1);
        let row = (y.round().max(0.0) as usize).min(image.height() - 1);
        f64::from(image.row(row)[column])
    };
    let right_minus_left: f64 = (0..=length_px as usize)
        .map(|step| {
            let (x, y) = (start.x + dx * step as f64, start.y + dy * step as f64);
            let (nx, ny) = (-dy * SIDE_PX, dx * SIDE_PX);
            level(x + nx, y + ny) - level(x - nx, y - ny)
        })
        .sum();
    if right_minus_left < 0.0 {
        std::mem::swap(&mut segment.start, &mut segment.end);
    }
}

/// Reads lines `image NAME`, each followed by lines `x1 y1 x2 y2` (px, pixel centres at whole numbers).
fn read_segments(file: &Path) -> Result<SegmentsByImage> {
    let text = fs::read_to_string(file).with_context(|| file.display().to_string())?;
    let mut by_image = SegmentsByImage::new();
    let mut current: Option<&mut Vec<Segment>> = None;
    for (number, line) in text.lines().enumerate() {
        let place = || format!("{}:{}: {line}", file.display(), number + 1);
        if let Some(name) = line.strip_prefix("image ") {
            current = Some(by_image.entry(name.to_owned()).or_default());
            continue;
        }
        let values: Vec<f64> =
            line.split_whitespace().map(str::parse).collect::<Result<_, _>>().with_context(place)?;
        let Ok(ends) = <[f64; 4]>::try_from(values) else { bail!("{}: four numbers are allowed", place()) };
        ensure!(ends.iter().all(|value| value.is_finite()), "{}: not finite", place());
        current.as_mut().with_context(place)?.push(foreign(ends));
    }
    Ok(by_image)
}
