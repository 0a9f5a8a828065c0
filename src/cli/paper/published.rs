//! The paper's own figures (section IV), to stand beside ours.

/// Angles of the paper's grid, deg.
pub const ANGLES_DEG: [u32; 5] = [0, 20, 40, 60, 80];
/// Distances of the paper's grid, cm.
pub const DISTANCES_CM: [u32; 6] = [20, 25, 30, 35, 40, 45];

/// Error of the change of rotation, deg: a row per distance of the grid, a column per step of the angle.
const ROTATION_CHANGE_DEG: [[f64; 4]; 6] = [
    [0.4953, 0.4800, 0.4810, 1.1286],
    [0.1790, 0.1944, 0.4898, 0.1901],
    [0.3974, 0.2406, 0.2435, 0.3669],
    [0.1203, 0.4511, 0.8060, 0.1947],
    [0.7586, 0.1131, 0.3187, 0.2768],
    [0.6398, 0.0707, 0.9675, 1.2077],
];

/// Error of the change of distance, cm: a row per angle of the grid, a column per step of the distance.
const DISTANCE_CHANGE_CM: [[f64; 5]; 5] = [
    [0.2690, 0.2260, 0.1161, 0.1105, 0.0595],
    [0.0120, 0.0093, 0.3852, 0.1017, 0.1975],
    [0.3156, 0.1831, 0.7042, 0.6292, 0.5332],
    [0.1584, 1.0096, 1.1799, 1.3456, 0.4132],
    [0.1697, 0.1137, 1.3918, 0.6780, 1.3741],
];

/// The paper's error for a step of the angle at a distance, deg; `None` off its grid.
pub fn rotation_change_deg(distance_cm: u32, step_deg: [u32; 2]) -> Option<f64> {
    let row = DISTANCES_CM.iter().position(|&known| known == distance_cm)?;
    let column = ANGLES_DEG.windows(2).position(|known| known == step_deg)?;
    Some(ROTATION_CHANGE_DEG[row][column])
}

/// The paper's error for a step of the distance at an angle, mm; `None` off its grid.
pub fn distance_change_mm(angle_deg: u32, step_cm: [u32; 2]) -> Option<f64> {
    let row = ANGLES_DEG.iter().position(|&known| known == angle_deg)?;
    let column = DISTANCES_CM.windows(2).position(|known| known == step_cm)?;
    Some(DISTANCE_CHANGE_CM[row][column] * 10.0)
}

/// One line of the paper's stereo table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoFigures {
    /// Who calibrated.
    pub method: &'static str,
    /// Distance between the cameras, cm.
    pub baseline_cm: u32,
    /// `l`, `d` and `theta` as printed; the paper names no unit for the three.
    pub l_d_theta: [f64; 3],
}

/// The paper's stereo table. CamMap, which found no translation, is left out.
pub const STEREO: [StereoFigures; 6] = [
    StereoFigures { method: "Kalibr", baseline_cm: 30, l_d_theta: [1.28, 0.89, 1.09] },
    StereoFigures { method: "ROS", baseline_cm: 30, l_d_theta: [0.69, 0.67, 1.11] },
    StereoFigures { method: "PeLiCal", baseline_cm: 30, l_d_theta: [0.31, 0.98, 0.77] },
    StereoFigures { method: "Kalibr", baseline_cm: 45, l_d_theta: [0.88, 1.21, 2.21] },
    StereoFigures { method: "ROS", baseline_cm: 45, l_d_theta: [1.39, 1.19, 1.55] },
    StereoFigures { method: "PeLiCal", baseline_cm: 45, l_d_theta: [0.07, 0.97, 0.65] },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corners_of_the_papers_tables_are_found() {
        assert_eq!(rotation_change_deg(45, [60, 80]), Some(1.2077));
        assert_eq!(rotation_change_deg(20, [0, 20]), Some(0.4953));
        assert_eq!(distance_change_mm(0, [40, 45]), Some(0.595));
        assert_eq!(distance_change_mm(80, [30, 35]), Some(13.918));
        assert_eq!(rotation_change_deg(20, [0, 40]), None);
    }
}
