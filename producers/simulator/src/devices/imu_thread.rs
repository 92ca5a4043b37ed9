//! A WT901C that is carried along a walk.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use super::now_ns;
use super::wt901c::{Line, Module, Port};
use crate::walk::Walk;

/// Before the walk its first second is measured again and again: the walker stands.
const STANDING_NS: i64 = 1_000_000_000;

/// The module's thread, which ends when this is dropped.
#[derive(Debug)]
pub(super) struct ImuThread {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl ImuThread {
    /// Plugs a module in that is still set as it was delivered. `began_ns` says when the walk began, once it has.
    pub(super) fn start(
        link: &Path,
        ppm: f64,
        walk: Walk,
        began_ns: impl Fn() -> Option<i64> + Send + 'static,
    ) -> io::Result<Self> {
        // 9600 baud and 10 Hz: the driver has to find and set it.
        let module = Module::new(Line::Serial).configured(&[], ppm);
        let mut port = Port::open(link, module, 1)?;
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let run = move || {
            let mut measuring =
                Measuring { standing: walk.clone(), walk: walk.clone(), fresh: walk, began: None };
            let mut due_ns = now_ns();
            while !stopped.load(Ordering::Relaxed) {
                let wait_ns = due_ns.saturating_sub(now_ns()).max(0);
                std::thread::sleep(Duration::from_nanos(wait_ns.unsigned_abs()));
                if measuring.began.is_none()
                    && let Some(began) = began_ns()
                {
                    // The walk's samples are due at whole periods after its beginning.
                    measuring.began = Some(began);
                    due_ns = began;
                    measuring.skip_until(now_ns() - began, &mut due_ns);
                    continue;
                }
                let Some((accel, gyro)) = measuring.next() else { return };
                if port.feed(due_ns, accel, gyro).is_err() {
                    return;
                }
                due_ns += crate::SAMPLE_NS;
            }
        };
        let thread = std::thread::Builder::new().name("wt901c".to_owned()).spawn(run)?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for ImuThread {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that has panicked has said so itself.
            let _ = thread.join();
        }
    }
}

struct Measuring {
    walk: Walk,
    /// Drawn from while the walk has not begun, and taken anew from `fresh`.
    standing: Walk,
    fresh: Walk,
    began: Option<i64>,
}

impl Measuring {
    /// The next sample's raw words; `None` after the walk.
    fn next(&mut self) -> Option<([i16; 3], [i16; 3])> {
        if self.began.is_none() && self.standing.next_imu_ns().is_none_or(|stamp| stamp >= STANDING_NS) {
            self.standing = self.fresh.clone();
        }
        let walk = if self.began.is_some() { &mut self.walk } else { &mut self.standing };
        walk.next_imu().map(|sampled| (sampled.accel, sampled.gyro))
    }

    /// Leaves out the samples whose time has passed.
    fn skip_until(&mut self, walk_ns: i64, due_ns: &mut i64) {
        while self.walk.next_imu_ns().is_some_and(|stamp| stamp < walk_ns) {
            self.walk.next_imu();
            *due_ns += crate::SAMPLE_NS;
        }
    }
}
