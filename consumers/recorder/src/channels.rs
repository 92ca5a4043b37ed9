//! Which topics a recording has.

use std::collections::BTreeMap;

use evac_formats::ros::schemas::{self, Schema};
use evac_frames::layout_hash;
use evac_frames::{
    GridHeader, Health, ImuAttitude, ImuSample, Layout, MapHeader, Point, PoseFrame, Route, ScanHeader, Voxel,
};
use evac_stage::joins::{Join as _, TapJoin};

/// The services, in the order of [`Service`].
pub(crate) const SERVICES: &[&str] = TapJoin::SERVICES;

/// A service, as an index into [`SERVICES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Service {
    Scan,
    Imu,
    Deskewed,
    Pose,
    Truth,
    Map,
    Grid,
    Health,
    Attitude,
    Route,
}

/// Topic of the odometry's poses as transforms, by which viewers lay clouds into the map.
pub(crate) const TRANSFORMS: (&str, Schema) = ("/tf", schemas::TF_MESSAGE);

/// The ROS 2 topic of a service, where it has one.
pub(crate) fn ros_topic(service: Service) -> Option<(&'static str, Schema)> {
    Some(match service {
        Service::Scan => ("/lidar/scan", schemas::POINT_CLOUD2),
        Service::Imu => ("/imu/sample", schemas::IMU),
        Service::Deskewed => ("/scan/deskewed", schemas::POINT_CLOUD2),
        Service::Pose => ("/odometry/pose", schemas::ODOMETRY),
        Service::Truth => ("/truth/pose", schemas::POSE_STAMPED),
        Service::Map => ("/map/update", schemas::POINT_CLOUD2),
        Service::Grid => ("/grid/plan", schemas::OCCUPANCY_GRID),
        Service::Health => ("/diagnostics", schemas::DIAGNOSTIC_ARRAY),
        Service::Attitude | Service::Route => return None,
    })
}

/// The topic of a service's frames as they lie in shared memory, with the layouts of header and elements.
pub(crate) fn raw_topic(service: Service) -> (String, BTreeMap<String, String>) {
    let layouts = match service {
        Service::Scan | Service::Deskewed => [Some(text::<ScanHeader>()), Some(text::<Point>())],
        Service::Map => [Some(text::<MapHeader>()), Some(text::<Voxel>())],
        Service::Grid => [Some(text::<GridHeader>()), Some("evac.Cell.v1 1".to_owned())],
        Service::Imu => [Some(text::<ImuSample>()), None],
        Service::Pose | Service::Truth => [Some(text::<PoseFrame>()), None],
        Service::Health => [Some(text::<Health>()), None],
        Service::Attitude => [Some(text::<ImuAttitude>()), None],
        Service::Route => [Some(text::<Route>()), None],
    };
    let names = ["header_layout", "item_layout"];
    let metadata =
        names.into_iter().zip(layouts).filter_map(|(name, layout)| Some((name.to_owned(), layout?)));
    (format!("/evac/{}", service.name()), metadata.collect())
}

/// Name, size in bytes and hash of a layout.
fn text<T: Layout>() -> String {
    format!("{} {} {:016x}", T::NAME, size_of::<T>(), layout_hash::<T>())
}

impl Service {
    pub(crate) const ALL: [Self; 10] = [
        Self::Scan,
        Self::Imu,
        Self::Deskewed,
        Self::Pose,
        Self::Truth,
        Self::Map,
        Self::Grid,
        Self::Health,
        Self::Attitude,
        Self::Route,
    ];

    pub(crate) fn name(self) -> &'static str {
        SERVICES.get(self as usize).copied().unwrap_or_default()
    }
}
