use evac_formats::wt901c::{Parser, encode_accel, encode_gyro, encode_time};

use super::*;

const SECOND: i64 = 1_000_000_000;

/// The samples of a module that measures at `rate_hz` and whose bytes arrive as `late_ns` of the sample's number says, with
/// what each was numbered by in its accelerometer word.
fn timed(
    config: &Config,
    rate_hz: f64,
    samples: u64,
    late_ns: impl Fn(u64) -> i64,
) -> (Vec<ImuSample>, Sampler) {
    let mut sampler = Sampler::new(config);
    sampler.begin(115_200);
    let (mut parser, mut out) = (Parser::default(), Vec::new());
    for number in 0..samples {
        let taken_ns = 100 * SECOND + (number as f64 * 1e9 / rate_hz) as i64;
        let time = encode_time(1_700_000_000 * SECOND + taken_ns).unwrap();
        let frames = [time, encode_accel([number as i16, 0, 0], 0), encode_gyro([0; 3], 0)];
        let came_ns = taken_ns + late_ns(number);
        for byte in frames.as_flattened() {
            if let Some(frame) = parser.push(*byte) {
                sampler.push(&frame, came_ns, came_ns);
                out.extend(std::iter::from_fn(|| sampler.pop()).map(|(sample, _)| sample));
            }
        }
    }
    (out, sampler)
}

/// Up to 4 ms late, in no rhythm.
fn uneven(number: u64) -> i64 {
    (number * 7919 % 41) as i64 * 100_000
}

fn numbers(samples: &[ImuSample], config: &Config) -> Vec<i64> {
    samples.iter().map(|sample| (sample.accel[0] / scales(config).accel).round() as i64).collect()
}

#[test]
fn the_first_samples_come_with_their_own_times_when_the_clock_has_settled_and_none_is_late() {
    let config = Config::default();
    let (samples, sampler) = timed(&config, 200.0, 1000, uneven);
    assert_eq!(numbers(&samples, &config), (0..1000).collect::<Vec<_>>());
    assert_eq!(sampler.counts, SamplerCounts { whole: 1000, ..SamplerCounts::default() });
    for (number, sample) in samples.iter().enumerate() {
        // 33 bytes on the line are 2.9 ms; the envelope is the earliest arrivals'.
        let taken_ns = 100 * SECOND + number as i64 * 5_000_000;
        let off_ns = sample.stamp_ns + (sampler.lead_bytes * sampler.byte_ns) as i64 - taken_ns;
        assert!(off_ns.abs() < 500_000, "sample {number}: {off_ns} ns");
    }
}

#[test]
fn samples_at_another_rate_are_counted_anew_and_none_is_late_either() {
    let config = Config { configure: false, ..Config::default() };
    let (samples, sampler) = timed(&config, 80.0, 500, uneven);
    assert_eq!(numbers(&samples, &config), (0..500).collect::<Vec<_>>());
    assert_eq!(sampler.counts.untimed, 0);
    for pair in samples.windows(2) {
        assert!((pair[1].stamp_ns - pair[0].stamp_ns - 12_500_000).abs() < 150_000, "{pair:?}");
    }
}

#[test]
fn what_waits_when_the_stream_begins_anew_is_counted() {
    let config = Config::default();
    let (samples, mut sampler) = timed(&config, 200.0, 100, |_| 0);
    assert!(samples.is_empty());
    sampler.begin(115_200);
    assert_eq!(sampler.counts.untimed, 100);
}
