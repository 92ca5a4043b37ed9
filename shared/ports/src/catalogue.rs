//! All services and their layouts in words, for stages that are written in another language.

use evac_frames::{
    Ack, DeviceHealth, Field, FrameHeader, GridHeader, Health, ImuAttitude, ImuSample, LatencySummary,
    Layout, MapHeader, OdometryHealth, Point, PoseFrame, Route, ScanHeader, Trace, Voxel, layout_hash,
};

use crate::bus::layout_text;
use crate::services::{
    Attitude, Cell, FrameService, FrameTrace, GridPlan, HealthStatus, Imu, LidarScan, MapSnapshot, MapUpdate,
    OdometryPose, Qos, RecordService, Routes, ScanDeskewed, SinkAck, SliceLen, TruthPose,
};

/// A service in words.
#[derive(Debug, Clone)]
pub struct ServiceText {
    /// Name on the bus.
    pub name: &'static str,
    /// The attribute `layout` that opening requires.
    pub layout: String,
    /// Versioned name of the user header's layout; none for a service of records.
    pub header: Option<&'static str>,
    /// Versioned name of the record's layout, or of the slice's elements'.
    pub item: &'static str,
    /// Memory that a publisher of slices reserves.
    pub len: Option<SliceLen>,
    /// Its numbers.
    pub qos: Qos,
}

/// A layout in words.
#[derive(Debug, Clone, Copy)]
pub struct LayoutText {
    /// The Rust type, as which fields of other layouts name it.
    pub ty: &'static str,
    /// Versioned name.
    pub name: &'static str,
    /// Bytes.
    pub size: usize,
    /// In memory order.
    pub fields: &'static [Field],
}

/// Every service.
pub fn services() -> Vec<ServiceText> {
    vec![
        frames::<LidarScan>(),
        frames::<ScanDeskewed>(),
        frames::<MapUpdate>(),
        frames::<MapSnapshot>(),
        frames::<GridPlan>(),
        records::<Imu>(),
        records::<Attitude>(),
        records::<OdometryPose>(),
        records::<TruthPose>(),
        records::<HealthStatus>(),
        records::<SinkAck>(),
        records::<FrameTrace>(),
        records::<Routes>(),
    ]
}

/// Every layout that a service carries, and those inside it.
pub fn layouts() -> Vec<LayoutText> {
    macro_rules! texts {
        ($($ty:ident),*) => {
            vec![$( LayoutText {
                ty: stringify!($ty),
                name: <$ty as Layout>::NAME,
                size: size_of::<$ty>(),
                fields: <$ty as Layout>::FIELDS,
            } ),*]
        };
    }
    texts![
        FrameHeader,
        ScanHeader,
        Point,
        MapHeader,
        Voxel,
        GridHeader,
        Cell,
        ImuSample,
        ImuAttitude,
        PoseFrame,
        LatencySummary,
        OdometryHealth,
        DeviceHealth,
        Health,
        Ack,
        Trace,
        Route
    ]
}

fn frames<S: FrameService>() -> ServiceText {
    ServiceText {
        name: S::NAME,
        layout: layout_text::<S::Header, S::Item>(),
        header: Some(S::Header::NAME),
        item: S::Item::NAME,
        len: Some(S::LEN),
        qos: S::QOS,
    }
}

fn records<S: RecordService>() -> ServiceText {
    ServiceText {
        name: S::NAME,
        layout: format!("{}#{:016x}", S::Record::NAME, layout_hash::<S::Record>()),
        header: None,
        item: S::Record::NAME,
        len: None,
        qos: S::QOS,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_layout_that_a_field_has_is_in_the_catalogue() {
        let layouts = layouts();
        let scalars = ["u8", "i8", "u16", "u32", "i32", "u64", "i64", "f32", "f64"];
        for layout in &layouts {
            for field in layout.fields {
                let ty = field.ty.trim_start_matches('[').split(';').next().unwrap_or_default();
                let known = scalars.contains(&ty) || layouts.iter().any(|other| other.ty == ty);
                assert!(known, "{}.{} is a {}", layout.name, field.name, field.ty);
            }
        }
    }
}
