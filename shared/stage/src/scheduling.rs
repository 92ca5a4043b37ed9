//! How the kernel runs this process: real-time priority, processors and locked memory, each read back after it was set.

use evac_config::Scheduling;
use rustix::mm::{MlockAllFlags, mlockall};

use crate::RunError;

/// Sets what the pipeline file asks for. Threads that start later inherit it.
pub(crate) fn apply(name: &str, scheduling: &Scheduling) -> Result<(), RunError> {
    let refused = |what: String, remedy: &str| RunError::Value(format!("stage '{name}': {what}; {remedy}"));
    if scheduling.lock_memory {
        // As it is touched: the pools of shared memory are far larger than what is ever used of them.
        let flags = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT;
        let remedy = "allow it (LimitMEMLOCK=infinity in the unit, or `ulimit -l unlimited`), or leave lock_memory out";
        mlockall(flags).map_err(|cause| refused(format!("scheduling.lock_memory: {cause}"), remedy))?;
        if locked_kib() == Some(0) {
            return Err(refused(
                "scheduling.lock_memory: nothing is locked although the kernel agreed".to_owned(),
                remedy,
            ));
        }
    }
    if !scheduling.cpus.is_empty() {
        let remedy = "name processors that this computer has (nproc) and that the unit's CPUAffinity= or container allows";
        sys::set_cpus(&scheduling.cpus)
            .map_err(|cause| refused(format!("scheduling.cpus = {:?}: {cause}", scheduling.cpus), remedy))?;
        let mut wanted = scheduling.cpus.clone();
        wanted.sort_unstable();
        wanted.dedup();
        let got = sys::cpus().map_err(|cause| refused(format!("scheduling.cpus: {cause}"), remedy))?;
        if got != wanted {
            return Err(refused(format!("scheduling.cpus = {wanted:?}: the kernel gives {got:?}"), remedy));
        }
    }
    if scheduling.fifo_priority > 0 {
        let wanted = scheduling.fifo_priority;
        let remedy = "allow it (LimitRTPRIO=99 in the unit, or an rtprio line in /etc/security/limits.conf), or leave fifo_priority out";
        sys::set_fifo(wanted)
            .map_err(|cause| refused(format!("scheduling.fifo_priority = {wanted}: {cause}"), remedy))?;
        let got =
            sys::fifo().map_err(|cause| refused(format!("scheduling.fifo_priority: {cause}"), remedy))?;
        if got != Some(wanted) {
            return Err(refused(
                format!("scheduling.fifo_priority = {wanted}: the kernel gives {got:?}"),
                remedy,
            ));
        }
    }
    if *scheduling != Scheduling::default() {
        tracing::info!(stage = name, ?scheduling, "scheduled as asked");
    }
    Ok(())
}

/// This thread is one of many again, whatever its process is: it waits for the disk.
pub(crate) fn leave_real_time() {
    if matches!(sys::fifo(), Ok(Some(_))) {
        // Where it may not, it is no worse than before.
        let _ = sys::set_other();
    }
}

/// Memory of this process that stays in RAM, KiB.
fn locked_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmLck:"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// System calls that rustix does not have, or not without its threads.
#[allow(unsafe_code)]
mod sys {
    use std::io;

    fn checked(result: i32) -> io::Result<i32> {
        if result < 0 { Err(io::Error::last_os_error()) } else { Ok(result) }
    }

    fn set(policy: i32, priority: i32) -> io::Result<()> {
        // SAFETY: all bytes zero are a valid sched_param, a struct of integers.
        let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
        parameters.sched_priority = priority;
        // SAFETY: the pointer is to a live sched_param, which the call only reads; 0 is the calling thread.
        checked(unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) }).map(|_| ())
    }

    pub(super) fn set_fifo(priority: u32) -> io::Result<()> {
        set(libc::SCHED_FIFO, i32::try_from(priority).unwrap_or(i32::MAX))
    }

    pub(super) fn set_other() -> io::Result<()> {
        set(libc::SCHED_OTHER, 0)
    }

    /// The real-time priority of this thread, if it has one.
    pub(super) fn fifo() -> io::Result<Option<u32>> {
        // SAFETY: takes no pointer; 0 is the calling thread.
        let policy = checked(unsafe { libc::sched_getscheduler(0) })?;
        // SAFETY: all bytes zero are a valid sched_param.
        let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
        // SAFETY: the pointer is to a live sched_param, which the call fills in.
        checked(unsafe { libc::sched_getparam(0, &raw mut parameters) })?;
        Ok((policy == libc::SCHED_FIFO).then(|| u32::try_from(parameters.sched_priority).unwrap_or(0)))
    }

    pub(super) fn set_cpus(cpus: &[u32]) -> io::Result<()> {
        // SAFETY: a cpu_set_t is an array of integers.
        let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
        for cpu in cpus.iter().map(|cpu| *cpu as usize) {
            // SAFETY: the set is live, and the call checks the number against its size.
            unsafe { libc::CPU_SET(cpu.min(size_of::<libc::cpu_set_t>() * 8 - 1), &mut set) };
        }
        // SAFETY: the pointer is to a live set of the size given, which the call only reads.
        checked(unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const set) })
            .map(|_| ())
    }

    /// Processors that this thread may run on.
    pub(super) fn cpus() -> io::Result<Vec<u32>> {
        // SAFETY: a cpu_set_t is an array of integers.
        let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
        // SAFETY: the pointer is to a live set of the size given, which the call fills in.
        checked(unsafe { libc::sched_getaffinity(0, size_of::<libc::cpu_set_t>(), &raw mut set) })?;
        let all = 0..size_of::<libc::cpu_set_t>() * 8;
        // SAFETY: the set is live, and the number is below its size.
        Ok(all.filter(|cpu| unsafe { libc::CPU_ISSET(*cpu, &set) }).map(|cpu| cpu as u32).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on_a_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|scope| scope.spawn(work).join().unwrap())
    }

    #[test]
    fn a_processor_is_taken_and_one_that_is_not_there_is_refused_with_its_number() {
        on_a_thread(|| {
            let first = sys::cpus().unwrap()[0];
            apply("a", &Scheduling { cpus: vec![first], ..Scheduling::default() }).unwrap();
            assert_eq!(sys::cpus().unwrap(), [first]);
        });
        let error = on_a_thread(|| {
            apply("a", &Scheduling { cpus: vec![Scheduling::MAX_CPU], ..Scheduling::default() }).unwrap_err()
        });
        assert!(error.to_string().contains("1023") && error.to_string().contains("nproc"), "{error}");
    }

    #[test]
    fn real_time_priority_is_had_or_refused_with_the_remedy() {
        on_a_thread(|| match apply("a", &Scheduling { fifo_priority: 10, ..Scheduling::default() }) {
            Ok(()) => {
                assert_eq!(sys::fifo().unwrap(), Some(10));
                leave_real_time();
                assert_eq!(sys::fifo().unwrap(), None);
            }
            Err(error) => assert!(error.to_string().contains("LimitRTPRIO"), "{error}"),
        });
    }
}
