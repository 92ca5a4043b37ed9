//! Poses: `geometry_msgs/PoseStamped`, `nav_msgs/Odometry` and `tf2_msgs/TFMessage`.

use super::wire::Encoding;
use super::writer::{Stamp, Writer};

/// A pose in the header's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RosPose {
    /// Metres.
    pub position: [f64; 3],
    /// Quaternion x, y, z, w.
    pub orientation: [f64; 4],
}

impl RosPose {
    /// No translation, no rotation.
    pub const IDENTITY: Self = Self { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0] };

    pub(super) fn write(&self, writer: &mut Writer<'_>) {
        writer.f64s(&self.position);
        writer.f64s(&self.orientation);
    }
}

/// Appends a serialised `geometry_msgs/PoseStamped` to `out`.
pub fn write_pose(out: &mut Vec<u8>, encoding: Encoding, header: &Stamp<'_>, pose: &RosPose) {
    let mut writer = Writer::new(out, encoding);
    writer.header(header);
    pose.write(&mut writer);
}

/// Appends a serialised `nav_msgs/Odometry` to `out`. Covariances are row-major 6x6 in the order x, y, z, rotation about x,
/// y, z; `twist` is the linear (m/s) and angular (rad/s) velocity in the child's frame with its covariance.
pub fn write_odometry(
    out: &mut Vec<u8>,
    encoding: Encoding,
    header: &Stamp<'_>,
    child: &str,
    (pose, covariance): (&RosPose, &[f64; 36]),
    (twist, twist_covariance): (&[f64; 6], &[f64; 36]),
) {
    let mut writer = Writer::new(out, encoding);
    writer.header(header);
    writer.string(child);
    pose.write(&mut writer);
    writer.f64s(covariance);
    writer.f64s(twist);
    writer.f64s(twist_covariance);
}

/// Appends a serialised `tf2_msgs/TFMessage` with one transform to `out`: where `child` is in the header's frame.
pub fn write_transform(
    out: &mut Vec<u8>,
    encoding: Encoding,
    header: &Stamp<'_>,
    child: &str,
    pose: &RosPose,
) {
    let mut writer = Writer::new(out, encoding);
    writer.u32(1);
    writer.header(header);
    writer.string(child);
    pose.write(&mut writer);
}
