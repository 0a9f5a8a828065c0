//! Lifted lines of the synthetic cameras against their exact depth: the stated covariance is the error's.

#[allow(dead_code, reason = "the example also asks for the side")]
#[path = "../../examples/lift_honesty/truth.rs"]
mod truth;

use std::time::Duration;

use pelical::capture::synthetic::{Noise, SyntheticFactory, SyntheticOptions};
use pelical::capture::{DeviceFactory, RgbdFrame};
use pelical::image::{GrayView, gray_from_rgb};
use pelical::lines::{DetectOptions, Detector, LiftOptions, Lifter};
use truth::LineTruth;

/// Errors of more standard deviations are gross.
const GROSS_SIGMAS: f64 = 4.0;

/// Whitened errors of the lines of a few views, two per line.
fn whitened_errors(seed: u64, disparity_sigma_px: f64) -> Vec<[f64; 2]> {
    let noise = Noise::D435i { disparity_sigma_px };
    let noisy = SyntheticOptions { noise, ..SyntheticOptions::pair(40.0, 0.3, seed) };
    let exact = SyntheticFactory::new(SyntheticOptions { noise: Noise::Off, ..noisy.clone() });
    let noisy = SyntheticFactory::new(noisy);
    let mut found = Vec::new();
    for info in noisy.list().unwrap() {
        let [mut noisy, mut exact] = [&noisy, &exact].map(|factory| factory.open(&info.serial).unwrap());
        let [mut frame, mut exact_frame] = [RgbdFrame::default(), RgbdFrame::default()];
        let (mut gray, mut segments, mut lines) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..2 {
            noisy.next_frame(&mut frame, Duration::from_secs(60)).unwrap();
            exact.next_frame(&mut exact_frame, Duration::from_secs(60)).unwrap();
            gray_from_rgb(&frame.rgb, &mut gray);
            let gray = GrayView::try_new(&gray, (frame.width, frame.height), frame.width).unwrap();
            Detector::new(DetectOptions::default()).detect(&gray, &mut segments);
            let mut lifter = Lifter::new(LiftOptions::default());
            lifter.lift(&segments, &frame.depth_view().unwrap(), &info.camera, &mut lines);
            let exact = exact_frame.depth_view().unwrap();
            found.extend(lines.iter().filter_map(|line| {
                let truth = LineTruth::of(&line.segment, &exact, &info.camera)?;
                Some(<[f64; 2]>::from(truth.whitened(&line.depth?)?))
            }));
        }
    }
    found
}

#[test]
fn lifted_lines_are_as_far_from_the_truth_as_their_covariance_says() {
    for (seed, disparity_sigma_px) in [(3, 0.08), (4, 0.12)] {
        let errors = whitened_errors(seed, disparity_sigma_px);
        assert!(errors.len() > 200, "{} lines", errors.len());
        let mut sizes: Vec<f64> = errors.iter().flatten().map(|error| error.abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        // A median of absolute values times 1.4826 is the deviation of normal errors.
        let scale = 1.4826 * sizes[sizes.len() / 2];
        assert!((0.8..1.2).contains(&scale), "{disparity_sigma_px} px: scale {scale}");
        let n_gross = errors.iter().filter(|[a, b]| a.hypot(*b) > GROSS_SIGMAS).count();
        let share = n_gross as f64 / errors.len() as f64;
        assert!(share <= 0.05, "{disparity_sigma_px} px: {:.1} % gross", 100.0 * share);
    }
}
