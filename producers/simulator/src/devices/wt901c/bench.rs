//! A module on a bench: it runs by itself.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::module::Module;
use super::port::Port;
use crate::devices::now_ns;

/// Time between two measurements.
const PERIOD: Duration = Duration::from_millis(5);

/// A [`Port`] that a thread feeds 200 times a second, until it is dropped.
#[derive(Debug)]
pub struct Bench {
    port: Arc<Mutex<Port>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl Bench {
    /// Plugs `module` in at `link`. `words` gives the raw words of accelerometer and gyroscope for each measurement's number.
    ///
    /// # Errors
    /// As [`Port::open`].
    pub fn start(
        link: &Path,
        module: Module,
        words: impl Fn(u64) -> ([i16; 3], [i16; 3]) + Send + 'static,
    ) -> io::Result<Self> {
        let port = Arc::new(Mutex::new(Port::open(link, module, 1)?));
        let stop = Arc::new(AtomicBool::new(false));
        let (its_port, its_stop) = (Arc::clone(&port), Arc::clone(&stop));
        let thread = std::thread::spawn(move || {
            let (start, start_ns) = (Instant::now(), now_ns());
            for number in 0_u64.. {
                if its_stop.load(Ordering::Relaxed) {
                    break;
                }
                let due = start + Duration::from_micros(number * PERIOD.as_micros() as u64);
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
                let (accel, gyro) = words(number);
                // When it was due: a module measures in time, whatever this machine is busy with.
                let due_ns = start_ns + number as i64 * PERIOD.as_nanos() as i64;
                lock(&its_port).feed(due_ns, accel, gyro)?;
            }
            Ok(())
        });
        Ok(Self { port, stop, thread: Some(thread) })
    }

    /// The port, to look at it or to do something to it; the module waits meanwhile.
    pub fn port(&self) -> MutexGuard<'_, Port> {
        lock(&self.port)
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(Err(_)) = self.thread.take().map(JoinHandle::join) {
            // It has panicked and said so.
        }
    }
}

fn lock(port: &Mutex<Port>) -> MutexGuard<'_, Port> {
    port.lock().unwrap_or_else(PoisonError::into_inner)
}
