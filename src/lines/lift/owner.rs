//! Which surface an edge belongs to, where both sides have one.
//!
//! A marking, a crease, and a step are weighed by how well each explains the depth on both sides. Where depth cannot tell, the
//! result is their mean, and how far they differ enters its covariance.
use nalgebra::{Matrix2, Vector2};

use super::fit::{Shape, SurfaceFit, least_squares};
use super::{AtEdge, Beyond, Surface, noise};
use crate::geometry::EdgeSide;

/// A surface that owns the edge.
#[derive(Debug, Clone, Copy)]
pub struct Owner {
    pub side: EdgeSide,
    /// Inverse depth at start and end, 1/m.
    pub ends_per_m: Vector2<f64>,
    /// Its covariance, 1/m².
    pub covariance_per_m2: Matrix2<f64>,
}

/// The owner of an edge with these surfaces on its left and right; `None` where none is known to reach it.
pub fn decide(sides: [Option<&AtEdge>; 2], (model_per_m, length_px): (f64, f64)) -> Option<Owner> {
    let alone = |side: &AtEdge| side.is_sure.then_some(side.surface.owner);
    let [left, right] = match sides {
        [Some(left), Some(right)] => [left, right],
        [Some(side), None] | [None, Some(side)] => return alone(side),
        [None, None] => return None,
    };
    let agreements = [&left.surface.agreement, &right.surface.agreement];
    let sigma_per_m = noise::reading_sigma_per_m(&agreements, length_px, model_per_m);
    let owner = between([&left.surface, &right.surface], (sigma_per_m, length_px))?;
    match (owner.side, left.beyond, right.beyond) {
        (EdgeSide::Left, ..) => left.is_sure.then_some(owner),
        (EdgeSide::Right, ..) => right.is_sure.then_some(owner),
        // A bar of few pixels: more of it lies on the side where it is than has bled over to the other.
        (_, Beyond::Farther, Beyond::Farther) if agreements[0].n >= agreements[1].n => alone(left),
        (_, Beyond::Farther, Beyond::Farther) | (_, Beyond::Farther, _) => alone(right),
        (_, _, Beyond::Farther) => alone(left),
        _ => Some(owner),
    }
}

/// The owner of an edge between two surfaces.
fn between(sides: [&Surface; 2], (sigma_per_m, length_px): (f64, f64)) -> Option<Owner> {
    let [left, right] = sides;
    let moments = sides.map(|side| &side.moments);
    let per_independent = noise::readings_per_independent(length_px);
    let n = sides.iter().map(|side| side.agreement.n).sum::<f64>() / per_independent;
    // Twice the logarithm of the evidence, by the Bayesian information criterion.
    let evidence = |sum_per_m2: f64, n_unknowns: f64| {
        -sum_per_m2 / (sigma_per_m * sigma_per_m * per_independent) - n_unknowns * n.max(2.0).ln()
    };
    let of_shape = |shape| {
        let fit = least_squares(moments, shape)?;
        let n_unknowns = if shape == Shape::Plane { 3.0 } else { 4.0 };
        Some((fit, evidence(fit.sum_per_m2, n_unknowns)))
    };
    let (marking, for_marking) = of_shape(Shape::Plane)?;
    let (crease, for_crease) = of_shape(Shape::Crease)?;
    let (_, for_terrace) = of_shape(Shape::Terrace)?;
    let for_step = evidence(left.fit.sum_per_m2 + right.fit.sum_per_m2, 6.0).max(for_terrace);
    let best = for_marking.max(for_crease).max(for_step);
    let weights = [for_marking, for_crease, for_step].map(|evidence| (0.5 * (evidence - best)).exp());
    let joint = |fit: &SurfaceFit| Owner::on(fit, EdgeSide::Both, (sigma_per_m, length_px));
    // At an occluding edge the nearer surface ends.
    let nearer = if left.fit.plane().mean_per_m() >= right.fit.plane().mean_per_m() {
        left.owner
    } else {
        right.owner
    };
    Some(mixture([joint(&marking), joint(&crease), nearer], weights))
}

impl Owner {
    /// Whether the surface on this side counts.
    pub fn owns(&self, side: EdgeSide) -> bool {
        self.side == side || self.side == EdgeSide::Both
    }

    /// A fitted surface as the owner.
    pub fn on(fit: &SurfaceFit, side: EdgeSide, (sigma_per_m, length_px): (f64, f64)) -> Self {
        let ends_per_m = fit.surface.fixed_rows::<2>(0).into_owned();
        let covariance_per_m2 = noise::covariance(&fit.unit_covariance, sigma_per_m, length_px);
        Self { side, ends_per_m, covariance_per_m2 }
    }
}

/// Mean and covariance of alternatives, the first two of which are of both sides.
fn mixture(alternatives: [Owner; 3], weights: [f64; 3]) -> Owner {
    let sum: f64 = weights.iter().sum();
    let weights = weights.map(|weight| weight / sum);
    let weighted = || alternatives.iter().zip(weights);
    let ends_per_m: Vector2<f64> = weighted().map(|(owner, weight)| owner.ends_per_m * weight).sum();
    let covariance_per_m2 = weighted()
        .map(|(owner, weight)| {
            let off = owner.ends_per_m - ends_per_m;
            (owner.covariance_per_m2 + off * off.transpose()) * weight
        })
        .sum();
    let side = if weights[2] > 0.5 { alternatives[2].side } else { EdgeSide::Both };
    Owner { side, ends_per_m, covariance_per_m2 }
}
