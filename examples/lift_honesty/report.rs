//! Tables of whitened errors.

use pelical::geometry::{DepthFit, EdgeSide};

use crate::truth::LineTruth;

/// A median of absolute values times this is the deviation of normal errors.
const DEVIATION_PER_MEDIAN: f64 = 1.4826;
/// An error of more standard deviations (of both ends together) is gross: 1 in 3000 where the covariance is honest.
const GROSS_SIGMAS: f64 = 4.0;

/// A segment, what lifting made of it, and what is true.
pub struct Judged {
    pub length_px: f64,
    pub fit: Option<DepthFit>,
    pub truth: Option<LineTruth>,
}

/// A lifted line with known truth.
struct Scored {
    length_px: f64,
    fit: DepthFit,
    truth: LineTruth,
    whitened: [f64; 2],
}

pub fn print_report(title: &str, judged: &[Judged]) {
    let lifted = judged.iter().filter(|line| line.fit.is_some()).count();
    let scored: Vec<Scored> = judged.iter().filter_map(scored).collect();
    let share = |n: usize, of: usize| 100.0 * n as f64 / of.max(1) as f64;
    println!("{title}");
    println!(
        "  {} segments, {:.1} % lifted; {} lifted lines with known truth ({:.1} %)",
        judged.len(),
        share(lifted, judged.len()),
        scored.len(),
        share(scored.len(), lifted)
    );
    println!(
        "  {:<22}{:>7}{:>8}{:>8}{:>8}{:>9}{:>9}{:>9}",
        "class", "lines", "scale", "rms", "gross%", "bias", "err%", "sigma%"
    );
    let row =
        |name: &str, keep: &dyn Fn(&Scored) -> bool| print_row(name, scored.iter().filter(|line| keep(line)));
    row("all", &|_| true);
    row("both", &|line| line.fit.side == EdgeSide::Both);
    row("one side", &|line| line.fit.side != EdgeSide::Both);
    row("truly both", &|line| line.truth.side == EdgeSide::Both);
    row("taken for the other", &|line| line.truth.side != line.fit.side);
    row("true step, taken both", &|line| line.truth.side != line.fit.side && line.fit.side == EdgeSide::Both);
    row("truly both, one taken", &|line| {
        line.truth.side != line.fit.side && line.truth.side == EdgeSide::Both
    });
    row("far side taken", &|line| {
        line.truth.side != line.fit.side
            && line.truth.side != EdgeSide::Both
            && line.fit.side != EdgeSide::Both
    });
    for (from, to) in [(0.0, 40.0), (40.0, 80.0), (80.0, 160.0), (160.0, 2000.0)] {
        row(&format!("{from} to {to} px"), &|line| (from..to).contains(&line.length_px));
    }
    for (from, to) in [(0.0, 1.0), (1.0, 1.5), (1.5, 2.0), (2.0, 3.0), (3.0, 9.0)] {
        row(&format!("{from} to {to} m"), &|line| {
            let [a, b] = line.truth.inverse_depth_per_m;
            (from..to).contains(&(2.0 / (a + b)))
        });
    }
}

fn scored(line: &Judged) -> Option<Scored> {
    let (fit, truth) = (line.fit?, line.truth?);
    let whitened = truth.whitened(&fit)?;
    Some(Scored { length_px: line.length_px, fit, truth, whitened: whitened.into() })
}

/// Robust scale and rms of the whitened errors (rms without the gross), share of gross errors, mean whitened error, and median
/// error and stated deviation as a share of the depth.
fn print_row<'a>(name: &str, lines: impl Iterator<Item = &'a Scored>) {
    let lines: Vec<&Scored> = lines.collect();
    let is_gross = |line: &&&Scored| line.whitened[0].hypot(line.whitened[1]) > GROSS_SIGMAS;
    let (gross, fine): (Vec<&Scored>, Vec<&Scored>) = lines.iter().partition(is_gross);
    let values = |lines: &[&Scored]| lines.iter().flat_map(|line| line.whitened).collect::<Vec<f64>>();
    let scale = DEVIATION_PER_MEDIAN * median(values(&lines).into_iter().map(f64::abs).collect());
    let fine_values = values(&fine);
    let n = fine_values.len().max(1) as f64;
    let rms = (fine_values.iter().map(|value| value * value).sum::<f64>() / n).sqrt();
    let bias = median(values(&lines));
    let each_end = |line: &&&Scored, of: &dyn Fn(usize, &Scored) -> f64| [0, 1].map(|end| of(end, line));
    let share = |of: &dyn Fn(usize, &Scored) -> f64| {
        100.0 * median(lines.iter().flat_map(|line| each_end(&line, of)).collect())
    };
    let error = share(&|end, line| {
        (line.fit.inverse_depth_per_m[end] / line.truth.inverse_depth_per_m[end] - 1.0).abs()
    });
    let sigma = share(&|end, line| {
        line.fit.covariance_per_m2[(end, end)].sqrt() / line.truth.inverse_depth_per_m[end]
    });
    let gross = 100.0 * gross.len() as f64 / lines.len().max(1) as f64;
    println!(
        "  {name:<22}{:>7}{scale:>8.2}{rms:>8.2}{gross:>8.1}{bias:>9.2}{error:>9.2}{sigma:>9.2}",
        lines.len()
    );
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
