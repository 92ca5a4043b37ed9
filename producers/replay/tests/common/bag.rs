//! Writes small ROS 1 bags with one uncompressed chunk.

use std::path::{Path, PathBuf};

/// `sensor_msgs/PointField` datatypes.
pub(crate) const U32: u8 = 6;
pub(crate) const F32: u8 = 7;
pub(crate) const F64: u8 = 8;

/// Messages with their topic and type.
pub(crate) struct Bag {
    connections: Vec<(&'static str, &'static str)>,
    messages: Vec<(usize, Vec<u8>)>,
}

impl Bag {
    pub(crate) fn new() -> Self {
        Self { connections: Vec::new(), messages: Vec::new() }
    }

    pub(crate) fn push(&mut self, topic: &'static str, kind: &'static str, message: Vec<u8>) {
        let known = self.connections.iter().position(|connection| *connection == (topic, kind));
        let id = known.unwrap_or(self.connections.len());
        if known.is_none() {
            self.connections.push((topic, kind));
        }
        self.messages.push((id, message));
    }

    /// IMU messages at 200 Hz over `seconds`, at rest, where gravity has the length `gravity`.
    pub(crate) fn push_imu(&mut self, start_ns: i64, seconds: f64, gravity: f64) {
        for k in 0..=(seconds * 200.0) as i64 {
            self.push(
                "/imu",
                "sensor_msgs/Imu",
                imu(start_ns + k * 5_000_000, [0.0; 3], [0.0, 0.0, gravity]),
            );
        }
    }

    /// Eight seconds of IMU messages in g: quiet for a second, tilted by 40 degrees about x within the next, quiet, and back; the
    /// rates in rad/s times `scale`.
    pub(crate) fn push_tilting_imu(&mut self, start_ns: i64, scale: f64) {
        let mut tilt = 0.0_f64;
        for k in 0..1600 {
            let speed = match (k / 200) % 4 {
                1 => 0.7,
                3 => -0.7,
                _ => 0.0,
            };
            tilt += speed * 0.005;
            let message =
                imu(start_ns + k * 5_000_000, [speed * scale, 0.0, 0.0], [0.0, tilt.sin(), tilt.cos()]);
            self.push("/imu", "sensor_msgs/Imu", message);
        }
    }

    pub(crate) fn write(&self, folder: &Path) -> PathBuf {
        let path = folder.join("walk.bag");
        std::fs::write(&path, self.bytes()).unwrap();
        path
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let id = |id: usize| (id as u32).to_le_bytes();
        let mut chunk = Vec::new();
        for (connection, message) in &self.messages {
            chunk.extend(record(&[("op", &[2]), ("conn", &id(*connection)), ("time", &[0; 8])], message));
        }
        let size = id(chunk.len());
        let mut body = record(&[("op", &[5]), ("compression", b"none"), ("size", &size)], &chunk);
        for connection in 0..self.connections.len() {
            let count = self.messages.iter().filter(|(of, _)| *of == connection).count();
            body.extend(record(&[("op", &[4]), ("conn", &id(connection)), ("count", &id(count))], &[]));
        }
        let head = |index_pos: u64| {
            let mut head = b"#ROSBAG V2.0\n".to_vec();
            head.extend(record(&[("op", &[3]), ("index_pos", &index_pos.to_le_bytes())], &[]));
            head
        };
        let mut bytes = head((head(0).len() + body.len()) as u64);
        bytes.extend(body);
        for (number, (topic, kind)) in self.connections.iter().enumerate() {
            let described = fields(&[("topic", topic.as_bytes()), ("type", kind.as_bytes())]);
            bytes.extend(record(
                &[("op", &[7]), ("conn", &id(number)), ("topic", topic.as_bytes())],
                &described,
            ));
        }
        bytes
    }
}

fn fields(fields: &[(&str, &[u8])]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (name, value) in fields {
        bytes.extend(((name.len() + 1 + value.len()) as u32).to_le_bytes());
        bytes.extend([name.as_bytes(), b"=", value].concat());
    }
    bytes
}

fn record(header: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header = fields(header);
    let mut bytes = (header.len() as u32).to_le_bytes().to_vec();
    bytes.extend(header);
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(data);
    bytes
}

fn header(stamp_ns: i64) -> Vec<u8> {
    let (seconds, nanoseconds) = (stamp_ns / 1_000_000_000, stamp_ns % 1_000_000_000);
    let mut bytes = vec![0; 4];
    bytes.extend((seconds as u32).to_le_bytes());
    bytes.extend((nanoseconds as u32).to_le_bytes());
    bytes.extend([0; 4]);
    bytes
}

fn imu(stamp_ns: i64, gyro: [f64; 3], accel: [f64; 3]) -> Vec<u8> {
    let mut bytes = header(stamp_ns);
    bytes.extend([0; (4 + 9) * 8]);
    gyro.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes.extend([0; 9 * 8]);
    accel.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes.extend([0; 9 * 8]);
    bytes
}

/// A `PointCloud2` of points at (index + 1, 0, 0), with a field of time where `time` names one.
pub(crate) fn cloud(stamp_ns: i64, times: &[f64], time: Option<(&str, u8)>) -> Vec<u8> {
    let mut bytes = header(stamp_ns);
    for value in [1, times.len() as u32, 3 + u32::from(time.is_some())] {
        bytes.extend(value.to_le_bytes());
    }
    for (name, offset, datatype) in
        [("x", 0, F32), ("y", 4, F32), ("z", 8, F32)].into_iter().chain(time.map(|(n, d)| (n, 12, d)))
    {
        bytes.extend((name.len() as u32).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend(u32::to_le_bytes(offset));
        bytes.push(datatype);
        bytes.extend(1_u32.to_le_bytes());
    }
    let mut data = Vec::new();
    for (index, value) in times.iter().enumerate() {
        data.extend(((index + 1) as f32).to_le_bytes());
        data.extend([0; 8]);
        match time {
            None => {}
            Some((_, U32)) => data.extend((*value as u32).to_le_bytes()),
            Some((_, F32)) => data.extend((*value as f32).to_le_bytes()),
            Some(_) => data.extend(value.to_le_bytes()),
        }
    }
    let step = data.len() / times.len().max(1);
    bytes.push(0);
    for value in [step, data.len(), data.len()] {
        bytes.extend((value as u32).to_le_bytes());
    }
    bytes.extend(data);
    bytes.push(1);
    bytes
}

/// A `CustomMsg` of points at the given offsets and x.
pub(crate) fn custom(timebase_ns: i64, points: &[(u32, f32)]) -> Vec<u8> {
    let mut bytes = header(timebase_ns);
    bytes.extend((timebase_ns as u64).to_le_bytes());
    bytes.extend((points.len() as u32).to_le_bytes());
    bytes.extend([1, 0, 0, 0]);
    bytes.extend((points.len() as u32).to_le_bytes());
    for (offset, x) in points {
        bytes.extend(offset.to_le_bytes());
        bytes.extend(x.to_le_bytes());
        bytes.extend([0; 11]);
    }
    bytes
}
