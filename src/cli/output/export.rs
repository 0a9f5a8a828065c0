//! A calibration in the forms that other programs read. Each says in a comment which way its numbers go.
//!
//! The poses are those of colour cameras. `optical` frames are x right, y down, z forward; `body` frames sit at the same point with
//! x forward, y left, z up (REP-103). Frame names follow the RealSense driver of ROS: `<camera>_color_optical_frame`,
//! `<camera>_color_frame`.

#[cfg(test)]
mod tests;

use std::fmt::Write as _;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::history::ProvenanceEntry;
use super::time::now_ns;
use crate::cli::args::ExportFrame;
use crate::geometry::motion::Motion;
use crate::ipc::CalibrationMessage;

/// Every camera but the reference, as a child of the reference's frame.
pub struct Placed {
    /// Name of the parent frame.
    pub parent: String,
    /// Name of the child frame, and where it is: takes coordinates of the child to the parent.
    pub children: Vec<(String, Motion)>,
}

impl Placed {
    /// The frames of a calibration.
    ///
    /// # Errors
    /// When two cameras would get the same frame name.
    pub fn of(message: &CalibrationMessage, frame: ExportFrame) -> Result<Self, String> {
        let names: Vec<String> =
            message.cameras.iter().map(|camera| frame_name(&camera.name, frame)).collect();
        for (index, name) in names.iter().enumerate() {
            if let Some(first) = names.iter().take(index).position(|other| other == name) {
                let cameras =
                    [first, index].map(|camera| message.cameras[camera].name.as_str()).join("\" and \"");
                return Err(format!(
                    "cameras \"{cameras}\" would both get the frame name {name}: rename one in the config"
                ));
            }
        }
        let reference = message.calibration.reference;
        let poses = message.calibration.cameras.iter().zip(&names).enumerate();
        let others = poses.filter(|(index, _)| *index != reference);
        let children = others.filter_map(|(_, (pose, name))| {
            let reference_from_camera = pose.as_ref()?.reference_from_camera;
            let body_from_optical = match frame {
                ExportFrame::Optical => Motion::identity(),
                ExportFrame::Body => body_from_optical(),
            };
            Some((name.clone(), body_from_optical * reference_from_camera * body_from_optical.inverse()))
        });
        Ok(Self { parent: names.get(reference).cloned().unwrap_or_default(), children: children.collect() })
    }
}

/// From x right, y down, z forward to x forward, y left, z up.
fn body_from_optical() -> Motion {
    let rows = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    Motion::from_parts(
        nalgebra::Translation3::identity(),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows)),
    )
}

/// ROS allows letters, digits and underscores.
fn frame_name(camera: &str, frame: ExportFrame) -> String {
    let plain: String = camera.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    match frame {
        ExportFrame::Optical => format!("{plain}_color_optical_frame"),
        ExportFrame::Body => format!("{plain}_color_frame"),
    }
}

/// Names as YAML reads them whatever is in them.
fn quoted(text: &str) -> String {
    // A JSON string is a YAML string. Text always has one.
    serde_json::to_string(text).unwrap_or_default()
}

/// First lines of every form: what it is.
fn heading(message: &CalibrationMessage) -> String {
    let reference = message.cameras.get(message.calibration.reference);
    let state = message.calibration.state.name();
    let provenance = ProvenanceEntry::new(message, now_ns()).text();
    let serials: Vec<String> = message
        .cameras
        .iter()
        .map(|camera| format!("{} ({})", plain_line(&camera.name), plain_line(&camera.serial)))
        .collect();
    format!(
        "pelical export, {state}: made {provenance}; cameras {}; reference {}",
        serials.join(", "),
        plain_line(reference.map_or("?", |camera| &camera.name))
    )
}

/// Text that ends no comment, neither of YAML nor of XML.
fn plain_line(text: &str) -> String {
    text.replace(|c: char| c.is_control(), " ").replace("--", "- - ")
}

/// The layout of `ground_truth.yaml` of a recording.
pub fn yaml(message: &CalibrationMessage) -> String {
    let mut text = format!(
        "# {}\n# X_reference = R(quaternion) X_camera + translation, in optical frames: x right, y down, z forward.\nposes:\n",
        heading(message)
    );
    for (camera, pose) in message.cameras.iter().zip(&message.calibration.cameras) {
        let Some(pose) = pose else { continue };
        let (t, q) =
            (pose.reference_from_camera.translation.vector, pose.reference_from_camera.rotation.coords);
        let _ = writeln!(
            text,
            "  {}: {{translation_m: [{}, {}, {}], quaternion_xyzw: [{}, {}, {}, {}]}}",
            quoted(&camera.name),
            t.x,
            t.y,
            t.z,
            q.x,
            q.y,
            q.z,
            q.w
        );
    }
    text
}

/// A launch file of ROS 2: one static transform a camera.
pub fn ros_tf(message: &CalibrationMessage, placed: &Placed) -> String {
    let mut text = format!(
        "# {}\n# ros2 launch this_file.yaml. Each transform takes points of the child frame to the parent frame; m, quaternion xyzw.\nlaunch:\n",
        heading(message)
    );
    for (child, parent_from_child) in &placed.children {
        let (t, q) = (parent_from_child.translation.vector, parent_from_child.rotation.coords);
        let _ = writeln!(
            text,
            "- node:\n    pkg: tf2_ros\n    exec: static_transform_publisher\n    name: pelical_{child}\n    args: \"--x {} --y {} \
             --z {} --qx {} --qy {} --qz {} --qw {} --frame-id {} --child-frame-id {child}\"",
            t.x, t.y, t.z, q.x, q.y, q.z, q.w, placed.parent
        );
    }
    text
}

/// Fixed joints from the reference to every other camera.
pub fn urdf(message: &CalibrationMessage, placed: &Placed) -> String {
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<!-- {} -->\n<!-- origin: pose of the child in the parent; m, and rad about fixed axes: R = Rz(yaw) \
         Ry(pitch) Rx(roll) -->\n<robot name=\"pelical_rig\">\n  <link name=\"{}\"/>\n",
        heading(message).replace('<', "(").replace('>', ")"),
        placed.parent
    );
    for (child, parent_from_child) in &placed.children {
        let t = parent_from_child.translation.vector;
        let (roll, pitch, yaw) = parent_from_child.rotation.euler_angles();
        let _ = writeln!(
            text,
            "  <link name=\"{child}\"/>\n  <joint name=\"{}_to_{child}\" type=\"fixed\">\n    <parent link=\"{}\"/>\n    <child \
             link=\"{child}\"/>\n    <origin xyz=\"{} {} {}\" rpy=\"{roll} {pitch} {yaw}\"/>\n  </joint>",
            placed.parent, placed.parent, t.x, t.y, t.z
        );
    }
    text += "</robot>\n";
    text
}
