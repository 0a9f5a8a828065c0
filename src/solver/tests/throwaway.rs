use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};
use std::time::Instant;

use super::room::*;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m, updated};
use crate::solver::*;
use crate::geometry::CameraView;

type Set = Vec<Option<CameraView>>;

fn run(name: &str, sets: &[Set], truth: &[Motion], options: EstimateOptions) {
    let mut est = RigEstimator::new(rig(truth.len()), options);
    let mut used = 0;
    let t = Instant::now();
    for s in sets { used += usize::from(est.add(s)); }
    let add = t.elapsed().as_secs_f64() * 1e3 / sets.len() as f64;
    let t = Instant::now();
    let c = est.solve();
    let solve = t.elapsed().as_secs_f64() * 1e3;
    for (i, tr) in truth.iter().enumerate().skip(1) {
        let p = c.pairs.iter().find(|p| p.target == 0 && p.source == i).unwrap();
        let Some(m) = p.target_from_source else { println!("{name} none"); continue };
        let sig = c.cameras[i].as_ref().map(|c| (c.covariance.fixed_view::<3,3>(0,0).trace().sqrt()*1e3, c.covariance.fixed_view::<3,3>(3,3).trace().sqrt().to_degrees()));
        println!("{name} sets {} accepted {used} kept {} add {add:.2} ms solve {solve:.0} ms {:?} matches {} err {:.4} deg {:.3} mm sigma(mm,deg) {sig:.4?}", sets.len(), c.frame_sets_used, c.state, p.matches, rotation_gap_rad(&m, tr).to_degrees(), translation_gap_m(&m, tr)*1e3);
    }
}

#[test]
fn throw_retention() {
    let truth = [Motion::identity(), Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.9, 0.0))];
    let small = EstimateOptions { evidence: EvidenceLimits { max_lines_per_view: 100, max_sets: 40 }, ..EstimateOptions::default() };
    for trial in 0..3 {
        let mut r = Random::named(&format!("iid {trial}"));
        let rm = room(&mut r, 60);
        let sets = frame_sets(&mut r, &rm, &truth, 400);
        run("iid new", &sets, &truth, small);
        run("iid newest", &sets[sets.len()-40..], &truth, small);
        // rich first, then common
        let mut r = Random::named(&format!("drift {trial}"));
        let rm = room(&mut r, 60);
        let mut sets = frame_sets(&mut r, &rm, &truth, 30);
        let upright = edges(&mut r, 60, |r, k| if k % 8 == 0 { Vector3::new(1.0, 0.1*r.signed(), 0.1*r.signed()) } else { Vector3::new(0.05*r.signed(), 1.0, 0.05*r.signed()) });
        let path: Vec<Motion> = (0..1000).map(|_| Motion::from_parts(world_from_rig(&mut r).translation, UnitQuaternion::from_scaled_axis(Vector3::new(0.05*r.signed(), 3.0*r.signed(), 0.05*r.signed())))).collect();
        sets.extend(frame_sets_along(&mut r, &upright, &truth, &path));
        run("drift new", &sets, &truth, small);
        run("drift newest", &sets[sets.len()-40..], &truth, small);
        run("drift rich only", &sets[..30], &truth, small);
    }
}

fn nees(sets: &[Set], truth: &[Motion], options: EstimateOptions) -> Option<(f64, f64, f64)> {
    let mut est = RigEstimator::new(rig(truth.len()), options);
    for s in sets { est.add(s); }
    let c = est.solve();
    let f = c.cameras[1].as_ref()?;
    let t = truth[1].translation.vector - f.reference_from_camera.translation.vector;
    let r = (truth[1].rotation * f.reference_from_camera.rotation.inverse()).scaled_axis();
    let e = Vector6::from_iterator(t.iter().chain(r.iter()).copied());
    let _ = updated; let _: Option<Matrix6<f64>> = None;
    Some((e.dot(&f.covariance.cholesky().unwrap().solve(&e)), t.norm_squared(), r.norm_squared()))
}

#[test]
fn throw_bias() {
    let truth = [Motion::identity(), Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.9, 0.0))];
    let small = EstimateOptions { evidence: EvidenceLimits { max_lines_per_view: 100, max_sets: 20 }, ..EstimateOptions::default() };
    let mut sums = [[0.0; 4]; 3];
    for trial in 0..30 {
        let mut r = Random::named(&format!("bias {trial}"));
        let rm = room(&mut r, 60);
        let sets = frame_sets(&mut r, &rm, &truth, 200);
        for (k, s) in [&sets[..], &sets[180..], &sets[..20]].iter().enumerate() {
            if let Some((n, t, r)) = nees(s, &truth, small) { sums[k][0] += n; sums[k][1] += t; sums[k][2] += r; sums[k][3] += 1.0; }
        }
    }
    for (n, s) in ["new", "newest", "oldest"].iter().zip(sums) {
        println!("bias {n} nees {:.2} rms mm {:.3} deg {:.4} n {}", s[0]/s[3], (s[1]/s[3]).sqrt()*1e3, (s[2]/s[3]).sqrt().to_degrees(), s[3]);
    }
}
