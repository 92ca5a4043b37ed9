//! Real shared memory, a domain of its own for each test.
#![allow(clippy::unwrap_used)]

use std::ops::ControlFlow;
use std::time::Duration;

use evac_frames::{Field, Layout, Point, PoseFrame, ScanHeader};
use evac_ports::services::{FrameService, LidarScan, OdometryPose, Qos, SliceLen};
use evac_ports::{
    Bus, Domain, FramePublisher, FrameSubscriber, PortError, RecordPublisher, RecordSubscriber, wait_on,
};

fn domain(test: &str) -> Domain {
    Domain::new(&format!("{test}-{}", std::process::id())).unwrap()
}

fn header(seq: u64) -> ScanHeader {
    let mut header = ScanHeader::default();
    header.frame.seq = seq;
    header
}

#[test]
fn a_scan_arrives_as_it_was_written_and_wakes_its_reader() {
    let domain = domain("hop");
    let _lock = domain.lock().unwrap();
    let (writer, reader) = (Bus::join(&domain, "writer").unwrap(), Bus::join(&domain, "reader").unwrap());
    let (subscriber, listener) = FrameSubscriber::<LidarScan>::open(&reader).unwrap();
    let publisher = FramePublisher::<LidarScan>::open(&writer).unwrap();
    publisher.publish(3, |i| Point::new(i as f32, 0.5, -1.0, 10 * i as i64, 7), || header(5)).unwrap();

    let mut looks = 0;
    let seen = wait_on(&[listener], |_| {
        looks += 1;
        match subscriber.receive().unwrap() {
            Some(sample) => ControlFlow::Break((sample.header().frame.seq, sample.items().to_vec())),
            None => ControlFlow::Continue(Duration::from_secs(5)),
        }
    })
    .unwrap();
    assert!(looks <= 2);
    assert_eq!(seen.0, 5);
    assert_eq!(seen.1, (0..3).map(|i| Point::new(i as f32, 0.5, -1.0, 10 * i, 7)).collect::<Vec<_>>());
}

#[test]
fn a_reader_of_one_service_sleeps_until_news_comes_and_is_not_woken_twice_by_it() {
    let domain = domain("wait");
    let _lock = domain.lock().unwrap();
    let bus = Bus::join(&domain, "both").unwrap();
    let (subscriber, listener) = RecordSubscriber::<OdometryPose>::open(&bus).unwrap();
    let publisher = RecordPublisher::<OdometryPose>::open(&bus).unwrap();
    for _ in 0..3 {
        publisher.publish(&PoseFrame::default()).unwrap();
    }
    // The test's watchdog is this hour.
    listener.wait(Duration::from_secs(3600)).unwrap();
    assert_eq!(std::iter::from_fn(|| subscriber.receive().unwrap()).count(), 3);
    let started = std::time::Instant::now();
    listener.wait(Duration::from_millis(50)).unwrap();
    assert!(started.elapsed() >= Duration::from_millis(50), "woken again by old news");
}

#[test]
fn a_reader_that_falls_behind_keeps_the_newest_and_sees_the_gap() {
    let domain = domain("overflow");
    let _lock = domain.lock().unwrap();
    let bus = Bus::join(&domain, "both").unwrap();
    let (subscriber, _listener) = RecordSubscriber::<OdometryPose>::open(&bus).unwrap();
    let publisher = RecordPublisher::<OdometryPose>::open(&bus).unwrap();
    for seq in 0..40 {
        let mut pose = PoseFrame::default();
        pose.frame.seq = seq;
        publisher.publish(&pose).unwrap();
    }
    let first = subscriber.receive().unwrap().unwrap();
    assert_eq!(first.frame.seq, 8, "the buffer holds 32");
    let mut last = first;
    while let Some(pose) = subscriber.receive().unwrap() {
        last = pose;
    }
    assert_eq!(last.frame.seq, 39);
}

/// Another build's idea of a point: same name, size and alignment, other order.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct OtherPoint {
    z: f32,
    y: f32,
    x: f32,
    packed: u32,
}
impl Layout for OtherPoint {
    const NAME: &'static str = Point::NAME;
    const FIELDS: &'static [Field] = &[Field { name: "z", offset: 0, size: 4, ty: "f32" }];
}
#[derive(Debug)]
struct OtherLidarScan;
impl FrameService for OtherLidarScan {
    const NAME: &'static str = LidarScan::NAME;
    const QOS: Qos = LidarScan::QOS;
    const LEN: SliceLen = LidarScan::LEN;
    type Header = ScanHeader;
    type Item = OtherPoint;
}

#[test]
fn two_builds_with_different_layouts_refuse_each_other_by_name() {
    let domain = domain("layout");
    let _lock = domain.lock().unwrap();
    let bus = Bus::join(&domain, "both").unwrap();
    let _publisher = FramePublisher::<LidarScan>::open(&bus).unwrap();
    let refusal = FrameSubscriber::<OtherLidarScan>::open(&bus).unwrap_err();
    assert!(matches!(refusal, PortError::LayoutMismatch { service: "lidar/scan", .. }), "{refusal}");
    let text = refusal.to_string();
    assert_eq!(text.matches("evac.Point.v1#").count(), 2, "{text}");
}

#[test]
fn a_scan_longer_than_the_service_allows_is_refused_and_the_next_one_passes() {
    let domain = domain("long");
    let _lock = domain.lock().unwrap();
    let bus = Bus::join(&domain, "both").unwrap();
    let publisher = FramePublisher::<LidarScan>::open(&bus).unwrap();
    assert!(publisher.publish(100_000, |_| Point::default(), || header(0)).is_err());
    publisher.publish(10, |_| Point::default(), || header(1)).unwrap();
}

#[test]
fn nothing_stays_in_shared_memory() {
    let domain = domain("clean");
    let lock = domain.lock().unwrap();
    let bus = Bus::join(&domain, "both").unwrap();
    let publisher = FramePublisher::<LidarScan>::open(&bus).unwrap();
    publisher.publish(10, |_| Point::default(), || header(0)).unwrap();
    drop((publisher, bus));
    drop(lock);
    let left: Vec<_> = std::fs::read_dir("/dev/shm")
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.starts_with(&domain.prefix()))
        .collect();
    assert_eq!(left, Vec::<String>::new());
    assert!(!domain.folder().exists());
}
