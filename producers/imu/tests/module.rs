//! The driver and a module on a real pseudo-terminal: found, set, lost and found again.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{Driver, ONE_G, at_rest, config, factory, link, periods_ms};
use evac_formats::wt901c::{baud_code, content, rate_code, register};
use evac_frames::DeviceKind;
use evac_imu::{Config, Protocol};
use evac_simulator::devices::wt901c::{Bench, Faults, Line, Module};

#[test]
fn a_module_as_from_the_factory_is_found_set_and_streams_evenly() {
    let (_folder, path) = link();
    let bench = factory(&path);
    let mut driver = Driver::new(config(&path));
    let samples = driver.take(800);
    for (index, sample) in samples.iter().enumerate() {
        assert_eq!(sample.seq, index as u64);
        assert!((sample.accel[2] - 9.80665).abs() < 0.05 && sample.gyro[2].abs() < 0.01, "{sample:?}");
        // Measured before it came, once the earliest arrivals are known, and not long before. (A busy machine hands over late.)
        let delay_ns = sample.arrival_ns - sample.stamp_ns;
        assert!(index < 400 || (0..1_000_000_000).contains(&delay_ns), "{sample:?}");
        assert!(sample.sent_ns >= sample.arrival_ns);
    }
    // Even to a percent, however late the machine was.
    for period in periods_ms(&samples) {
        assert!((period / 5.0 - (period / 5.0).round()).abs() < 0.03 && period > 4.0, "{period}");
    }
    let module = bench.port().module.clone();
    assert_eq!(module.baud(), 115_200);
    assert_eq!(module.register(register::RATE), rate_code(200.0).unwrap());
    assert_eq!(module.register(register::CONTENT), content::TIME | content::ACCEL | content::GYRO);
    assert_eq!((module.register(register::BANDWIDTH), module.register(register::ALGORITHM)), (1, 1));
    // Saved: it is the same after a power cycle.
    let mut cycled = module;
    cycled.power_cycle();
    assert_eq!((cycled.baud(), cycled.register(register::RATE)), (115_200, 0x0b));
    driver.run_until_noted("200 Hz, jitter");
    let health = driver.reporter.device;
    assert_eq!((health.kind, health.sessions), (DeviceKind::Wt901c as u32, 1));
    assert!(health.used >= 800 && health.temperature_centi == 2534, "{health:?}");
}

#[test]
fn a_module_that_is_unplugged_and_plugged_in_again_goes_on() {
    let (_folder, path) = link();
    let bench = factory(&path);
    let mut driver = Driver::new(config(&path));
    let before = driver.take(200);
    bench.port().unplug();
    driver.run_until_noted("hung up");
    driver.run_until("the missing port is named", |driver| {
        driver.reporter.noted().contains("is it plugged in?")
    });
    bench.port().plug_in().unwrap();
    let after = driver.take(200);
    assert!(after[0].stamp_ns > before[199].stamp_ns);
    assert_eq!(after[0].seq, driver.output.memory[driver.output.memory.len() - after.len() - 1].seq + 1);
    driver.run_until_noted("unplugged 1x");
    assert!(periods_ms(&driver.output.memory).iter().all(|period| *period > 4.0));
}

#[test]
fn a_driver_that_is_started_before_its_module_waits_for_it() {
    let (_folder, path) = link();
    let mut driver = Driver::new(config(&path));
    driver.run_until_noted("is it plugged in?");
    let _bench = factory(&path);
    driver.take(50);
}

#[test]
fn a_module_that_comes_back_at_another_speed_is_found_there() {
    let (_folder, path) = link();
    let bench = factory(&path);
    // Without saving, a power cycle takes it back to 9600 baud.
    let mut driver = Driver::new(Config { save: false, ..config(&path) });
    driver.take(100);
    assert_eq!(bench.port().module.baud(), 115_200);
    bench.port().module.power_cycle();
    assert_eq!(bench.port().module.baud(), 9600);
    driver.run_until_noted("lost 1x (rubbish)");
    let seen = driver.output.memory.len();
    driver.run_until("it streams again", |driver| driver.output.memory.len() > seen + 100);
    assert_eq!(bench.port().module.baud(), 115_200);
}

#[test]
fn a_module_at_an_unusual_speed_is_taken_as_it_is_where_nothing_may_be_set() {
    let (_folder, path) = link();
    let settings = [
        (register::BAUD, baud_code(230_400).unwrap()),
        (register::RATE, rate_code(100.0).unwrap()),
        (register::CONTENT, content::ACCEL | content::GYRO),
    ];
    let module = Module::new(Line::Serial).configured(&settings, 80.0);
    let bench = Bench::start(&path, module, at_rest).unwrap();
    let mut driver = Driver::new(Config { configure: false, time: false, ..config(&path) });
    let samples = driver.take(200);
    let middle = periods_ms(&samples[100..]).iter().sum::<f64>() / (samples.len() - 101) as f64;
    assert!((middle - 10.0).abs() < 0.2, "{middle}");
    driver.run_until_noted("of 200 Hz at 230400 baud");
    assert_eq!(bench.port().module.baud(), 230_400);
}

#[test]
fn a_module_that_falls_silent_is_looked_for_until_it_speaks() {
    let (_folder, path) = link();
    let bench = factory(&path);
    let mut driver = Driver::new(config(&path));
    driver.take(100);
    bench.port().faults = Faults { silent: true, ..Faults::default() };
    driver.run_until_noted("listening");
    bench.port().faults = Faults::default();
    driver.take(100);
    driver.run_until_noted("lost 1x (silence)");
}

#[test]
fn a_flood_of_rubbish_between_the_samples_costs_few_of_them() {
    let (_folder, path) = link();
    let bench = factory(&path);
    let mut driver = Driver::new(config(&path));
    driver.take(200);
    bench.port().faults = Faults { garbage_bytes: 200, ..Faults::default() };
    let rubbish_before = driver.reporter.counters.rejected;
    let samples = driver.take(600);
    let elapsed = (samples[599].stamp_ns - samples[0].stamp_ns) as f64 * 1e-6 / 5.0;
    // Where this machine stalls, the terminal overflows.
    assert!(599.0 / elapsed > 0.7, "{elapsed}");
    assert!(driver.reporter.counters.rejected - rubbish_before > 600 * 150);
    assert!(samples.iter().all(|sample| (sample.accel[2] - 9.80665).abs() < 0.05), "nothing false passes");
    // It is even found in the middle of it.
    bench.port().unplug();
    driver.run_until_noted("is it plugged in?");
    bench.port().plug_in().unwrap();
    driver.take(100);
}

#[test]
fn flipped_and_lost_bytes_cost_their_own_samples_only() {
    let (_folder, path) = link();
    let bench = factory(&path);
    let mut driver = Driver::new(config(&path));
    driver.take(200);
    bench.port().faults = Faults { corrupt_share: 0.001, drop_share: 0.001, ..Faults::default() };
    let lost_before = driver.reporter.input.imu_lost;
    let samples = driver.take(1000);
    let lost = driver.reporter.input.imu_lost - lost_before;
    // 33 bytes a sample, 2 of 1000 of them damaged: some 6 % of the samples.
    assert!((20..200).contains(&lost), "{lost}");
    // Their places stay free: whole periods, and no other.
    for period in periods_ms(&samples) {
        assert!((period / 5.0 - (period / 5.0).round()).abs() < 0.05, "{period}");
    }
    assert!(samples.iter().all(|sample| (sample.accel[2] - 9.80665).abs() < 0.05));
}

#[test]
fn a_step_of_the_module_s_clock_is_said_and_moves_no_stamp() {
    let (_folder, path) = link();
    let bench = factory(&path);
    let mut driver = Driver::new(config(&path));
    driver.take(200);
    let seen = driver.output.memory.len() - 1;
    bench.port().module.step_clock(3_600_000_000_000);
    driver.run_until_noted("clock stepped 1x (+3600.0 s)");
    bench.port().module.step_clock(-7_200_000_000_000);
    driver.run_until_noted("clock stepped 2x (-7200.0 s)");
    driver.take(200);
    for period in periods_ms(&driver.output.memory[seen..]) {
        assert!((period / 5.0 - (period / 5.0).round()).abs() < 0.05 && period < 1000.0, "{period}");
    }
}

#[test]
fn auto_zero_at_rest_and_another_range_are_said() {
    let (_folder, path) = link();
    // The firmware holds the gyroscope at zero, and the words are those of a module of 2 g.
    let words = |number: u64| {
        let noise = (number % 7) as i16 - 3;
        ([noise, noise, 8 * ONE_G + noise], [0; 3])
    };
    let _bench = Bench::start(&path, Module::new(Line::Serial), words).unwrap();
    let mut driver = Driver::new(config(&path));
    driver.run_until_noted("gravity reads 78.4");
    assert!(
        driver.reporter.noted().contains("range is 2 g, set accel_range_g"),
        "{}",
        driver.reporter.noted()
    );
    // The port is one driver's alone.
    let mut right = Driver::new(Config { accel_range_g: 2.0, ..config(&path) });
    right.run_until_noted("in use?");
    drop(driver);
    right.run_until_noted("gyro auto-zero at rest");
    assert!((right.output.memory[0].accel[2] - 9.80665).abs() < 0.05);
}

#[test]
fn a_gyroscope_of_another_range_is_named_when_the_module_has_been_tilted() {
    let (_folder, path) = link();
    // Quiet for a second, tilted by 40 degrees about x within the next, quiet, and back; the words are those of 1000 degrees/s.
    let words = |number: u64| {
        let (second, part) = (number / 200 % 4, (number % 200) as f64 / 200.0);
        let (tilt, rate_dps) = match second {
            0 => (0.0, 0.0),
            1 => (40.0 * part, 40.0),
            2 => (40.0, 0.0),
            _ => (40.0 * (1.0 - part), -40.0),
        };
        let tilt: f64 = f64::to_radians(tilt);
        let g = f64::from(ONE_G);
        let noise = (number % 5) as i16 - 2;
        let accel = [noise, (g * tilt.sin()) as i16, (g * tilt.cos()) as i16];
        (accel, [(rate_dps / 1000.0 * 32768.0) as i16 + noise, 2, noise])
    };
    let _bench = Bench::start(&path, Module::new(Line::Serial), words).unwrap();
    let mut driver = Driver::new(config(&path));
    driver.run_until_noted("gyro reads 2.00 times what gravity turns by: set gyro_range_dps = 1000");
    drop(driver);
    let mut right = Driver::new(Config { gyro_range_dps: 1000.0, ..config(&path) });
    right.take(2000);
    assert!(right.reporter.noted().contains("200 Hz"), "{}", right.reporter.noted());
}

#[test]
fn a_module_on_rs485_is_found_set_and_asked_200_times_a_second() {
    let (_folder, path) = link();
    let bench = Bench::start(&path, Module::new(Line::Modbus(0x51)), at_rest).unwrap();
    let modbus = Config { protocol: Protocol::Modbus, address: 0x51, ..config(&path) };
    let mut driver = Driver::new(modbus);
    let samples = driver.take(200);
    assert_eq!(bench.port().module.baud(), 115_200);
    assert_eq!(bench.port().module.register(register::RATE), rate_code(200.0).unwrap());
    assert!(
        samples.iter().all(|sample| (sample.accel[2] - 9.80665).abs() < 0.05 && sample.gyro[2].abs() < 0.01)
    );
    assert!(samples.windows(2).all(|pair| pair[0].stamp_ns < pair[1].stamp_ns));
    bench.port().unplug();
    driver.run_until_noted("is it plugged in?");
    bench.port().plug_in().unwrap();
    driver.take(100);
    driver.run_until_noted("asked 200 times a second; unplugged 1x");
}

#[test]
fn attitude_and_magnetic_field_are_passed_on_with_their_sample_s_stamp() {
    let (_folder, path) = link();
    // Rolled by 30 degrees.
    let words = |_| ([0, 1024, 1774], [0; 3]);
    let _bench = Bench::start(&path, Module::new(Line::Serial), words).unwrap();
    let all = Config { angles: true, magnetometer: true, quaternion: true, baud: 230_400, ..config(&path) };
    let mut driver = Driver::new(all);
    driver.take(100);
    let attitude = *driver.output.attitudes.last().unwrap();
    assert!((attitude.roll_pitch_yaw[0].to_degrees() - 30.0).abs() < 0.1, "{attitude:?}");
    assert_eq!(attitude.magnetic_field, [120.0, -340.0, 560.0]);
    let [x, _, _, w] = attitude.orientation;
    assert!(((2.0 * x.atan2(w)).to_degrees() - 30.0).abs() < 0.1, "{attitude:?}");
    let sample = driver.output.memory.iter().find(|sample| sample.seq == attitude.seq).unwrap();
    assert_eq!(sample.stamp_ns, attitude.stamp_ns);
    assert!(driver.output.attitudes.len() + 2 >= driver.output.memory.len());
}
