//! Which topics of a bag to replay.

use evac_formats::bag::{Bag, Connection};
use evac_formats::ros::{CustomMsg, Encoding, Imu, PointCloud2};
use evac_stage::StageError;

/// What a topic's messages are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    CustomMsg,
    PointCloud2,
    Imu,
}

impl Kind {
    fn of(connection: &Connection) -> Option<Self> {
        // ROS 2 puts the kind of interface between package and name.
        let name = connection.type_name.replace("/msg/", "/");
        match name.as_str() {
            Imu::TYPE => Some(Self::Imu),
            PointCloud2::TYPE => Some(Self::PointCloud2),
            _ => CustomMsg::TYPES.contains(&name.as_str()).then_some(Self::CustomMsg),
        }
    }
}

/// A topic of one kind; several nodes may have published on it.
#[derive(Debug, Clone)]
pub(super) struct Topic {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) encoding: Encoding,
    pub(super) connections: Vec<u32>,
    pub(super) messages: u64,
}

/// The wanted topic, or the `CustomMsg` topic with the most messages, or such a `PointCloud2` topic.
pub(super) fn choose_lidar(bag: &Bag, wanted: Option<&str>) -> Result<Topic, StageError> {
    let kinds = [Kind::CustomMsg, Kind::PointCloud2];
    let what = "livox_ros_driver/CustomMsg or sensor_msgs/PointCloud2";
    let chosen = choose(bag, wanted, &kinds, what, "lidar_topic")?;
    for other in topics(bag, &kinds).iter().filter(|other| other.name != chosen.name) {
        tracing::info!("{}: {} is replayed, {} is not", bag.path().display(), chosen.name, other.name);
    }
    tracing::info!(
        "{}: {} clouds ({:?}) on {}",
        bag.path().display(),
        chosen.messages,
        chosen.kind,
        chosen.name
    );
    Ok(chosen)
}

/// The wanted topic, or the `Imu` topic with the most messages.
pub(super) fn choose_imu(bag: &Bag, wanted: Option<&str>) -> Result<Topic, StageError> {
    choose(bag, wanted, &[Kind::Imu], Imu::TYPE, "imu_topic")
}

fn choose(
    bag: &Bag,
    wanted: Option<&str>,
    kinds: &[Kind],
    what: &str,
    key: &str,
) -> Result<Topic, StageError> {
    let topics = topics(bag, kinds);
    let chosen = kinds.iter().find_map(|kind| {
        let fitting =
            topics.iter().filter(|topic| topic.kind == *kind && wanted.is_none_or(|name| name == topic.name));
        // Of equals the first, in the order of names.
        fitting.rev().max_by_key(|topic| topic.messages)
    });
    chosen.cloned().ok_or_else(|| {
        let there: Vec<_> = bag
            .connections()
            .iter()
            .map(|c| format!("{} ({}, {})", c.topic, c.type_name, c.messages))
            .collect();
        let there = if there.is_empty() { "nothing".to_owned() } else { there.join(", ") };
        let missing = wanted
            .map_or_else(|| format!("no messages of type {what}"), |name| format!("no {what} on {name}"));
        StageError::File(format!(
            "{}: the bag holds {missing}, only {there}; check {key}",
            bag.path().display()
        ))
    })
}

/// Topics of some kinds that have messages, by name.
fn topics(bag: &Bag, kinds: &[Kind]) -> Vec<Topic> {
    let mut topics: Vec<Topic> = Vec::new();
    for connection in bag.connections().iter().filter(|connection| connection.messages > 0) {
        let Some(kind) = Kind::of(connection).filter(|kind| kinds.contains(kind)) else { continue };
        let same = |topic: &&mut Topic| {
            (&topic.name, topic.kind, topic.encoding) == (&connection.topic, kind, connection.encoding)
        };
        match topics.iter_mut().find(same) {
            Some(topic) => {
                topic.connections.push(connection.id);
                topic.messages += connection.messages;
            }
            None => topics.push(Topic {
                name: connection.topic.clone(),
                kind,
                encoding: connection.encoding,
                connections: vec![connection.id],
                messages: connection.messages,
            }),
        }
    }
    topics.sort_by(|a, b| a.name.cmp(&b.name));
    topics
}
