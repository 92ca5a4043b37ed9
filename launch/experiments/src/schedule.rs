//! Work spread over threads, results in the order of the work.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Calls `work(i)` for all `i` below `count` in `threads` threads and hands the results to `done` in the order of `i`, each as
/// soon as it and all before it are there. What the threads compute does not depend on their number.
pub fn in_threads<T: Send>(
    count: usize,
    threads: usize,
    work: impl Fn(usize) -> T + Sync,
    done: impl FnMut(usize, T) + Send,
) {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Ordered { waiting: (0..count).map(|_| None).collect(), shown: 0, done });
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, count.max(1)) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        return;
                    }
                    let result = work(index);
                    // A thread that panicked has said so; the others' results are whole.
                    let mut results = results.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                    results.take(index, result);
                }
            });
        }
    });
}

struct Ordered<T, F> {
    waiting: Vec<Option<T>>,
    shown: usize,
    done: F,
}

impl<T, F: FnMut(usize, T)> Ordered<T, F> {
    fn take(&mut self, index: usize, result: T) {
        if let Some(slot) = self.waiting.get_mut(index) {
            *slot = Some(result);
        }
        while let Some(result) = self.waiting.get_mut(self.shown).and_then(Option::take) {
            (self.done)(self.shown, result);
            self.shown += 1;
        }
    }
}
