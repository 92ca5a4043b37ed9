//! Clocks that are known, seen through delays that are not.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use evac_clock::{ClockFit, Settings};
use evac_testkit::{CountingAllocator, count_allocations};
use proptest::prelude::*;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Of [`Settings::samples`].
const WINDOW_NS: f64 = 32e9;
const PERIOD_NS: f64 = 5e6;

/// A source of numbers in 0..1 that is the same every time.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Hand-over by a USB adapter: at its next tick, and sometimes much later.
fn arrival_ns(measured_ns: f64, timer_ns: f64, dice: &mut Dice) -> i64 {
    let scheduling = 20e3 + 60e3 * dice.roll() + if dice.roll() < 0.02 { 20e6 * dice.roll() } else { 0.0 };
    ((measured_ns / timer_ns).ceil() * timer_ns + scheduling) as i64
}

/// By how much the smallest delay wanders from window to window: samples that meet the timer at the same few phases for longer
/// than a window cannot tell it from a drift. 0 where they meet it at all phases.
fn wander_ns(period_ns: f64, timer_ns: f64) -> f64 {
    let samples = WINDOW_NS / period_ns;
    let phases = (1..100).map(f64::from).find(|phases| {
        let periods = phases * period_ns / timer_ns;
        (periods - periods.round()).abs() * samples < 3.0
    });
    phases.map_or(0.0, |phases| timer_ns / phases)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn stamps_are_even_although_arrivals_are_not(
        seed in any::<u64>(), ppm in -3000.0..3000.0_f64, timer_ms in 0.2..16.0_f64,
    ) {
        let (mut fit, mut dice) = (ClockFit::new(Settings::samples(200.0)), Dice(seed));
        let period_ns = PERIOD_NS * (1.0 + ppm * 1e-6);
        let wander_ns = wander_ns(period_ns, timer_ms * 1e6);
        // A timer of 5, 7.5 or 10 ms beats so slowly with 200 Hz that its wander looks like a clock's step.
        prop_assume!(wander_ns < 2e6);
        let (mut errors, mut last) = (Vec::new(), i64::MIN);
        for n in 0..12_000_u64 {
            let measured_ns = 7e9 + n as f64 * period_ns;
            let seen = fit.observe(n, arrival_ns(measured_ns, timer_ms * 1e6, &mut dice));
            prop_assert_eq!(seen.step, None);
            if let Some(stamp_ns) = seen.stamp_ns {
                prop_assert!(stamp_ns > last);
                last = stamp_ns;
                if n > 6000 {
                    errors.push(stamp_ns as f64 - measured_ns);
                }
            }
        }
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let spread = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt();
        // Where the timer nearly divides the period the smallest delay of a window is not 0, at most the timer; a slope that is
        // not yet right puts the line under the arrivals by some 0.1 ms.
        prop_assert!((-0.3e6 - wander_ns..timer_ms * 1e6 + 0.3e6).contains(&mean), "mean {mean}");
        prop_assert!(spread < 0.4e6 + wander_ns / 2.0, "spread {spread}");
        let drift_limit = 60.0 + 2e6 * wander_ns / WINDOW_NS;
        prop_assert!((fit.quality().drift_ppm - ppm).abs() < drift_limit, "{} {ppm}", fit.quality().drift_ppm);
    }

    #[test]
    fn no_numbers_break_it(
        events in prop::collection::vec((any::<u64>(), any::<i64>()), 0..200),
        modulus in prop::option::of(any::<u64>()),
    ) {
        let mut fit = ClockFit::new(Settings { modulus, ..Settings::counter(1.0) });
        let mut last = i64::MIN;
        for (ticks, host_ns) in events {
            if let Some(stamp_ns) = fit.observe(ticks, host_ns).stamp_ns {
                prop_assert!(stamp_ns > last);
                last = stamp_ns;
            }
            let _ = fit.host_ns(ticks);
        }
        let quality = fit.quality();
        prop_assert!(quality.drift_ppm.is_finite() && quality.roughness_ns.is_finite());
    }

    #[test]
    fn a_clock_that_is_set_begins_a_new_segment_with_the_right_size(
        seed in any::<u64>(), jump_s in prop_oneof![
            -4000.0..-0.1_f64, -0.1..-0.01_f64, 0.01..0.1_f64, 0.1..4000.0_f64
        ],
    ) {
        let (mut fit, mut dice) = (ClockFit::new(Settings::counter(1.0)), Dice(seed));
        let (mut steps, mut after) = (Vec::new(), Vec::new());
        for n in 0..4000_u64 {
            let measured_ns = 1e12 + n as f64 * PERIOD_NS;
            let set_ns = if n < 2000 { 0.0 } else { jump_s * 1e9 };
            let host_ns = arrival_ns(measured_ns, 1e6, &mut dice);
            let seen = fit.observe((9e12 + measured_ns + set_ns) as u64, host_ns);
            steps.extend(seen.step.map(|step| (n, step)));
            if let Some(stamp_ns) = seen.stamp_ns.filter(|_| n > 2250) {
                after.push(stamp_ns as f64 - measured_ns);
            }
        }
        prop_assert_eq!(steps.len(), 1);
        let (at, step) = steps[0];
        // A jump ahead is obvious at once; being set back a little might be mere lateness, for a second.
        prop_assert!((2002..=2206).contains(&at), "{at}");
        prop_assert!((step.ahead_ns as f64 - jump_s * 1e9).abs() < 25e6, "{step:?} {jump_s}");
        prop_assert!(after.len() > 1500);
        prop_assert!(after.iter().all(|error| (0.0..2e6).contains(error)));
    }
}

#[test]
fn a_step_within_the_jitter_is_none_and_a_larger_one_is_found_both_ways() {
    // A LiDAR's packets: each millisecond, mostly 0.1 ms under way, up to 4 ms where a switch is busy.
    for (step_ms, segments) in
        [(0.0, 1), (1.5, 1), (-3.0, 1), (3.0, 2), (8.0, 2), (-8.0, 2), (40.0, 2), (-40.0, 2)]
    {
        let (mut fit, mut dice) = (ClockFit::new(Settings::counter(1.0)), Dice(9));
        let (mut ahead, mut last_error) = (Vec::new(), f64::NAN);
        for n in 0..20_000_u64 {
            let measured_ns = 1e9 + n as f64 * 1e6;
            let set_ns = if n < 10_000 { 0.0 } else { step_ms * 1e6 };
            let way_ns = 100e3 + if dice.roll() < 0.1 { 4e6 * dice.roll() } else { 0.0 };
            let ticks = 5e12 + measured_ns * (1.0 + 40e-6) + set_ns;
            let seen = fit.observe(ticks as u64, (measured_ns + way_ns) as i64);
            ahead.extend(seen.step.map(|step| step.ahead_ns));
            last_error = seen.stamp_ns.map_or(last_error, |stamp_ns| stamp_ns as f64 - measured_ns);
        }
        assert_eq!(fit.quality().segments, segments, "{step_ms} ms: {ahead:?}");
        assert!(ahead.iter().all(|ahead| (*ahead as f64 - step_ms * 1e6).abs() < 4.5e6), "{ahead:?}");
        // One that is not found stays in the stamps until the window has forgotten what was before.
        let left_ms = if segments == 1 { f64::abs(step_ms) } else { 0.0 };
        assert!((last_error * 1e-6).abs() < left_ms + 0.3, "{step_ms} ms: {last_error} ns");
    }
}

#[test]
fn samples_that_the_count_does_not_know_of_are_found() {
    let (mut fit, mut dice) = (ClockFit::new(Settings::samples(200.0)), Dice(5));
    let (mut ahead, mut last_error) = (Vec::new(), f64::NAN);
    for n in 0..9000_u64 {
        let lost = if n < 3000 { 0 } else { 1 };
        let measured_ns = 1e9 + (n + lost) as f64 * PERIOD_NS;
        let seen = fit.observe(n, arrival_ns(measured_ns, 16e6, &mut dice));
        ahead.extend(seen.step.map(|step| step.ahead_ns));
        last_error = seen.stamp_ns.map_or(last_error, |stamp_ns| stamp_ns as f64 - measured_ns);
    }
    assert_eq!(ahead.len(), 1, "{ahead:?}");
    assert!((ahead[0] + 5_000_000).abs() < 500_000, "{ahead:?}");
    assert!((0.0..0.5e6).contains(&last_error), "{last_error}");
    assert_eq!(fit.quality().segments, 2);
}

#[test]
fn data_that_had_piled_up_keeps_its_place() {
    let mut fit = ClockFit::new(Settings::samples(200.0));
    for n in 0..2000_u64 {
        let measured_ns = 1_000_000_000 + n as i64 * 5_000_000;
        // Nobody read for two seconds.
        let arrival_ns = if (1000..1400).contains(&n) { 8_000_000_000 + n as i64 } else { measured_ns };
        let seen = fit.observe(n, arrival_ns + 10_000);
        assert_eq!(seen.step, None);
        if let Some(stamp_ns) = seen.stamp_ns {
            assert!((stamp_ns - measured_ns - 10_000).abs() < 50_000, "{n}");
        }
    }
    assert_eq!(fit.quality().segments, 1);
}

#[test]
fn two_damaged_stamps_are_no_step_and_times_are_interpolated_between_stamps() {
    let mut fit = ClockFit::new(Settings { modulus: Some(1 << 32), ..Settings::counter(1000.0) });
    for n in 0..1000_u64 {
        let ticks = (u64::from(u32::MAX) - 2_000_000 + n * 5000) % (1 << 32);
        let damaged = if n == 500 || n == 501 { ticks.wrapping_sub(3_000_000) % (1 << 32) } else { ticks };
        let host_ns = 1_000_000_000 + n as i64 * 5_000_000;
        let seen = fit.observe(damaged, host_ns);
        assert_eq!(seen.step, None);
        assert_eq!(seen.stamp_ns.is_none(), n < 100 || n == 500 || n == 501, "{n}");
        if seen.stamp_ns.is_some() {
            let between = fit.host_ns((ticks + 1000) % (1 << 32)).unwrap();
            assert!((between - host_ns - 1_000_000).abs() < 1000, "{between} {host_ns}");
        }
    }
    assert_eq!(fit.quality().doubtful, 2);
}

#[test]
fn an_observation_allocates_nothing() {
    let (mut fit, mut dice) = (ClockFit::new(Settings::samples(200.0)), Dice(1));
    let made = count_allocations(|| {
        for n in 0..20_000_u64 {
            fit.observe(n, arrival_ns(n as f64 * PERIOD_NS, 3e6, &mut dice));
        }
    });
    assert_eq!(made, 0);
}

/// The arrivals of the reference data: 80 ppm slow, 115200 baud, four frames a sample, a USB adapter's latency timer.
#[test]
fn modelled_usb_adapters_leave_little_jitter() {
    // The second's delays have a beat of 12.5 s, longer than the data.
    for (name, most_ns) in [("arrivals_usb_16ms.csv", 0.15e6), ("arrivals_usb_1ms.csv", 0.4e6)] {
        let Some(path) = evac_testkit::data(&format!("protocols/wt901c/{name}")) else { return };
        let text = std::fs::read_to_string(path).unwrap();
        let mut fit = ClockFit::new(Settings::samples(200.0));
        let (mut next, mut errors) = (0_u64, Vec::new());
        for line in text.lines().skip(1) {
            let fields: Vec<f64> = line.split(',').map(|field| field.parse().unwrap()).collect();
            // The gyroscope's frame is the third of four, 11 bytes each.
            while (next * 44 + 33) as f64 <= fields[1] + fields[2] {
                let measured_s = 1000.0 + next as f64 * 0.005_000_4;
                if let Some(stamp_ns) = fit.observe(next, (fields[0] * 1e9) as i64).stamp_ns
                    && next > 600
                {
                    errors.push(stamp_ns as f64 - measured_s * 1e9);
                }
                next += 1;
            }
        }
        assert!(errors.len() > 1300);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let spread = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt();
        println!("{name}: mean {mean:.0} ns, spread {spread:.0} ns, {:?}", fit.quality());
        assert!((2.0e6..4.5e6).contains(&mean), "{name}: {mean}");
        assert!(spread < most_ns, "{name}: {spread}");
    }
}
