//! A WT901C that is carried along a walk.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::now_ns;
use super::wt901c::{Faults, Line, Module, Port};
use crate::walk::Walk;

/// Before the walk its first second is measured again and again: the walker stands.
const STANDING_NS: i64 = 1_000_000_000;

/// What is wrong with the module and its line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct ImuFaults {
    pub(super) unplugged: bool,
    pub(super) line: Faults,
    /// Added to the module's clock, milliseconds.
    pub(super) clock_step_ms: f64,
}

/// The module's thread, which ends when this is dropped.
#[derive(Debug)]
pub(super) struct ImuThread {
    faults: Arc<Mutex<ImuFaults>>,
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
        let (stop, faults) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(ImuFaults::default())));
        let (stopped, wrong) = (Arc::clone(&stop), Arc::clone(&faults));
        let run = move || {
            let mut measuring =
                Measuring { standing: walk.clone(), walk: walk.clone(), fresh: walk, began: None };
            let (mut due_ns, mut stepped_ms) = (now_ns(), 0.0);
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
                let wrong = *wrong.lock().unwrap_or_else(PoisonError::into_inner);
                if lay_over(&mut port, &wrong, &mut stepped_ms).is_err() {
                    return;
                }
                if port.feed(due_ns, accel, gyro).is_err() {
                    return;
                }
                due_ns += crate::SAMPLE_NS;
            }
        };
        let thread = std::thread::Builder::new().name("wt901c".to_owned()).spawn(run)?;
        Ok(Self { faults, stop, thread: Some(thread) })
    }

    /// Changes what is wrong, from the next sample on.
    pub(super) fn set_faults(&self, faults: ImuFaults) {
        *self.faults.lock().unwrap_or_else(PoisonError::into_inner) = faults;
    }
}

/// Makes the port as wrong as it should be; `stepped_ms` is how far its clock was set so far.
fn lay_over(port: &mut Port, wrong: &ImuFaults, stepped_ms: &mut f64) -> io::Result<()> {
    port.faults = wrong.line;
    if wrong.clock_step_ms != *stepped_ms {
        port.module.step_clock(((wrong.clock_step_ms - *stepped_ms) * 1e6) as i64);
        *stepped_ms = wrong.clock_step_ms;
    }
    match (wrong.unplugged, port.is_plugged_in()) {
        (true, true) => port.unplug(),
        (false, false) => port.plug_in()?,
        _ => {}
    }
    Ok(())
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
