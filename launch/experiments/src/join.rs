//! Between one stream of IMU samples and what each frame gets of it: the rule of `evac_stage::joins` without its ports.

use evac_frames::{ImuSample, frame_flags};

use crate::Frame;

/// Every sample once, in the order of time.
pub(crate) fn stream(frames: &[Frame]) -> Vec<ImuSample> {
    let mut all: Vec<ImuSample> = Vec::new();
    for frame in frames {
        let after = all.last().map_or(i64::MIN, |last| last.stamp_ns);
        all.extend(frame.imu.iter().filter(|sample| sample.stamp_ns > after));
    }
    all
}

/// Gives every frame its samples: from the last one at or before the previous frame's end (or this frame's start, whichever is
/// earlier; on the first frame from the first) to the first one at or after this frame's end. The last sample and the
/// last frame carry the mark of the stream's end.
pub(crate) fn slice(frames: &mut [Frame], imu: &[ImuSample]) {
    let mut imu = imu.to_vec();
    if let Some((last, others)) = imu.split_last_mut() {
        others.iter_mut().for_each(|sample| sample.flags &= !frame_flags::END_OF_STREAM);
        last.flags |= frame_flags::END_OF_STREAM;
    }
    let mut previous_end_ns: Option<i64> = None;
    let count = frames.len();
    for (index, frame) in frames.iter_mut().enumerate() {
        let header = &mut frame.header.frame;
        header.flags &= !frame_flags::END_OF_STREAM;
        if index + 1 == count {
            header.flags |= frame_flags::END_OF_STREAM;
        }
        let from_ns = previous_end_ns.map_or(i64::MIN, |end| end.min(header.start_ns));
        let first = imu.partition_point(|sample| sample.stamp_ns <= from_ns).saturating_sub(1);
        let end = (imu.partition_point(|sample| sample.stamp_ns < header.end_ns) + 1).min(imu.len());
        frame.imu = imu.get(first..end).unwrap_or_default().to_vec();
        previous_end_ns = Some(header.end_ns);
    }
}
