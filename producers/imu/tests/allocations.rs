//! A sample costs no allocation.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{Driver, config, factory, link};
use evac_stage::ImuOutput;
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn samples_are_read_timed_and_noted_without_allocating() {
    let (_folder, path) = link();
    let _bench = factory(&path);
    let mut driver = Driver::new(config(&path));
    driver.output = ImuOutput::newest_only();
    driver.run_until("samples", |driver| driver.output.memory.first().is_some_and(|last| last.seq > 100));
    let seen = driver.output.memory[0].seq;
    let made = count_allocations(|| {
        driver.run_until("samples", |driver| driver.output.memory[0].seq > seen + 600);
    });
    assert_eq!(made, 0);
}
