//! ROS 2 static transforms: a launch file for `static_transform_publisher` and the same as YAML.
//!
//! What a robot's joints move is left to the robot's own driver, so its links are not among them; what hangs on a flange is, under the flange's name.

use super::cell::{Cell, Joint, JointMotion};
use super::text::number;
use crate::complaint::{Complaint, InputError};
use crate::layout::Document;

fn static_joints(cell: &Cell<'_>) -> Vec<Joint> {
    let moved_by_joints = |name: &str| {
        let robots = cell.tree.robots.iter().flat_map(|frames| frames.iter().skip(1));
        robots.map(|frame| &cell.names[*frame]).any(|link| name == link || name == format!("{link}_axis"))
    };
    cell.joints()
        .into_iter()
        .filter(|joint| joint.motion == JointMotion::Fixed && !moved_by_joints(&joint.child))
        .collect()
}

pub(super) fn files(cell: &Cell<'_>) -> Result<Vec<(String, String)>, InputError> {
    let joints = static_joints(cell);
    if joints.is_empty() {
        let remedy = "export a solution, or give the layout's poses";
        return Err(Complaint::of(&cell.layout.file, "no frame has a pose that stands still", remedy).into());
    }
    let text = |value: &str| Document::text(value);
    let one = |joint: &Joint| {
        let (t, q) = (joint.pose.translation, joint.pose.rotation.coords);
        Document::map([
            ("frame_id", text(&joint.parent)),
            ("child_frame_id", text(&joint.child)),
            ("translation", Document::map([("x", n(t.x)), ("y", n(t.y)), ("z", n(t.z))])),
            ("rotation", Document::map([("x", n(q.x)), ("y", n(q.y)), ("z", n(q.z)), ("w", n(q.w))])),
        ])
    };
    let yaml = Document::map([("static_transforms", Document::List(joints.iter().map(one).collect()))]);
    let yaml = yaml.to_yaml().map_err(|e| Complaint::of(&cell.layout.file, e.to_string(), "report this"))?;
    Ok(vec![("cell_tf.launch.py".to_owned(), launch(cell, &joints)), ("cell_tf.yaml".to_owned(), yaml)])
}

fn n(value: f64) -> Document {
    Document::Number(value)
}

fn launch(cell: &Cell<'_>, joints: &[Joint]) -> String {
    let mut text = format!(
        "# Written by cellmap {}. Static transforms of the cell; the world is `{}`. Metres, unit quaternions.\n\
         # Run: ros2 launch cell_tf.launch.py\n\
         from launch import LaunchDescription\n\
         from launch_ros.actions import Node\n\n\
         # parent, child, x, y, z, qx, qy, qz, qw\nTRANSFORMS = [\n",
        crate::VERSION,
        cell.layout.world
    );
    for joint in joints {
        let (t, q) = (joint.pose.translation, joint.pose.rotation.coords);
        let values = [t.x, t.y, t.z, q.x, q.y, q.z, q.w].map(|value| format!("'{}'", number(value))).join(", ");
        text.push_str(&format!("    ({:?}, {:?}, {values}),\n", joint.parent, joint.child));
    }
    text.push_str(
        "]\n\n\ndef publisher(parent, child, x, y, z, qx, qy, qz, qw):\n    return Node(\n        package='tf2_ros',\n        \
         executable='static_transform_publisher',\n        name='cell_' + child,\n        arguments=[\n            \
         '--x', x, '--y', y, '--z', z,\n            '--qx', qx, '--qy', qy, '--qz', qz, '--qw', qw,\n            \
         '--frame-id', parent, '--child-frame-id', child,\n        ],\n    )\n\n\n\
         def generate_launch_description():\n    return LaunchDescription([publisher(*row) for row in TRANSFORMS])\n",
    );
    text
}
