//! The cell as one URDF, and the same as a xacro macro.

use super::cell::{Cell, Joint, JointMotion};
use super::text::{number, numbers};
use crate::geometry::{Pose, rotation};

/// The cell as URDF. Corrected links are built in; limits are unknown here and left open.
pub(super) fn urdf(cell: &Cell<'_>) -> String {
    let mut text = head(cell);
    text.push_str("<robot name=\"cell\">\n  <link name=\"world\"/>\n");
    body(cell, "", &mut text);
    text.push_str("</robot>\n");
    text
}

/// The cell as a macro: `<xacro:cell prefix="" parent="world"/>`.
pub(super) fn xacro(cell: &Cell<'_>) -> String {
    let mut text = head(cell);
    text.push_str("<robot name=\"cell\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\">\n");
    text.push_str(
        "  <!-- Use: <xacro:include filename=\"cell.urdf.xacro\"/> <xacro:cell prefix=\"\" parent=\"world\"/> -->\n",
    );
    text.push_str("  <xacro:macro name=\"cell\" params=\"prefix:='' parent\">\n");
    text.push_str("  <link name=\"${prefix}world\"/>\n  <joint name=\"${prefix}world_joint\" type=\"fixed\">\n");
    text.push_str("    <parent link=\"${parent}\"/>\n    <child link=\"${prefix}world\"/>\n  </joint>\n");
    body(cell, "${prefix}", &mut text);
    text.push_str("  </xacro:macro>\n</robot>\n");
    text
}

fn head(cell: &Cell<'_>) -> String {
    let file = escape(&cell.layout.file.display().to_string()).replace("--", "- -");
    format!(
        "<?xml version=\"1.0\"?>\n<!-- Written by cellmap {} from {file}. Metres and radians. The world is `{}`.\n     A camera has a body (x forward) and \
         an optical frame (z forward). Joint limits are not known here. -->\n",
        crate::VERSION,
        escape(&cell.layout.world).replace("--", "- -")
    )
}

fn body(cell: &Cell<'_>, prefix: &str, text: &mut String) {
    let joints = cell.joints();
    for joint in &joints {
        link(joint, &joints, prefix, text);
        let (kind, axis) = match joint.motion {
            JointMotion::Fixed => ("fixed", None),
            JointMotion::Revolute(axis) => ("continuous", Some(axis)),
            JointMotion::Prismatic(axis) => ("prismatic", Some(axis)),
            JointMotion::Floating => ("floating", None),
        };
        let (parent, child) = (escape(&joint.parent), escape(&joint.child));
        text.push_str(&format!("  <joint name=\"{prefix}{child}_joint\" type=\"{kind}\">\n"));
        text.push_str(&format!("    <parent link=\"{prefix}{parent}\"/>\n    <child link=\"{prefix}{child}\"/>\n"));
        text.push_str(&format!("    {}\n", origin(&joint.pose)));
        if let Some(axis) = axis {
            text.push_str(&format!("    <axis xyz=\"{}\"/>\n", numbers(axis.as_slice(), " ")));
        }
        if kind == "prismatic" {
            text.push_str("    <limit lower=\"-100\" upper=\"100\" effort=\"0\" velocity=\"0\"/>\n");
        }
        text.push_str("  </joint>\n");
    }
}

/// A link with something to look at: a rod to each joint that a robot's link carries, a small box for a camera's body.
fn link(joint: &Joint, joints: &[Joint], prefix: &str, text: &mut String) {
    let name = escape(&joint.child);
    let moves = |motion: JointMotion| matches!(motion, JointMotion::Revolute(_) | JointMotion::Prismatic(_));
    let mut shapes = Vec::new();
    for next in joints.iter().filter(|next| next.parent == joint.child && (moves(joint.motion) || moves(next.motion))) {
        let along = next.pose.translation;
        let length = along.norm();
        if length > 0.02 {
            let turn =
                nalgebra::UnitQuaternion::rotation_between(&nalgebra::Vector3::z(), &along).unwrap_or_else(|| {
                    nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::PI)
                });
            let middle = Pose::new(turn, along * 0.5);
            shapes.push((middle, format!("<cylinder radius=\"0.035\" length=\"{}\"/>", number(length))));
        }
    }
    if joints.iter().any(|next| next.parent == joint.child && next.child.ends_with("_optical_frame")) {
        shapes.push((Pose::from_translation(-0.03, 0.0, 0.0), "<box size=\"0.06 0.05 0.04\"/>".to_owned()));
    }
    if shapes.is_empty() {
        text.push_str(&format!("  <link name=\"{prefix}{name}\"/>\n"));
        return;
    }
    text.push_str(&format!("  <link name=\"{prefix}{name}\">\n"));
    for (pose, shape) in shapes {
        text.push_str(&format!("    <visual>{}<geometry>{shape}</geometry></visual>\n", origin(&pose)));
    }
    text.push_str("  </link>\n");
}

fn origin(pose: &Pose) -> String {
    let (xyz, rpy) = (numbers(pose.translation.as_slice(), " "), numbers(&rotation::to_rpy(&pose.rotation), " "));
    format!("<origin xyz=\"{xyz}\" rpy=\"{rpy}\"/>")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
