//! Real-time scheduling where the system permits it: SCHED_FIFO, a core of its own, memory that stays. What is refused
//! is said, with what to do, and flown without.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// How one thread is scheduled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// SCHED_FIFO priority, 1..=99.
    pub priority: u8,
    /// The core that it runs on; none: any.
    pub core: Option<usize>,
}

impl Schedule {
    /// Schedules the calling thread so; logs what was refused.
    pub fn apply(&self, thread: &str) {
        for why in self.try_apply() {
            tracing::warn!("the {thread} thread: {why}");
        }
    }

    /// Schedules the calling thread so; returns what was refused, with what to do.
    #[must_use]
    pub fn try_apply(&self) -> Vec<String> {
        let mut refused = Vec::new();
        if let Err(why) = fifo(self.priority) {
            let way = "run as root, or allow it with LimitRTPRIO= in the unit (docs/how-to/wire-a-vehicle.md)";
            refused.push(format!("no real-time priority {} ({why}): {way}", self.priority));
        }
        if let Some(core) = self.core
            && let Err(why) = pin(core)
        {
            refused.push(format!("cannot be pinned to core {core} ({why}): name a core that there is"));
        }
        refused
    }
}

fn fifo(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority).map_err(|e| format!("{e:?}"))?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy).map_err(
        |e| match e {
            thread_priority::Error::OS(code) => std::io::Error::from_raw_os_error(code).to_string(),
            other => format!("{other:?}"),
        },
    )
}

fn pin(core: usize) -> Result<(), String> {
    if core >= CpuSet::MAX_CPU {
        return Err("there is none of that number".to_owned());
    }
    let mut set = CpuSet::new();
    set.set(core);
    sched_setaffinity(None, &set).map_err(|e| e.to_string())
}

/// Keeps all of the process's memory, now and later, from being paged out.
///
/// # Errors
/// Why not, and what to do.
pub fn lock_memory() -> Result<(), String> {
    // What comes later is locked page by page, as it is touched: short-lived threads' stacks would cost 8 MB each.
    let later = || mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT);
    mlockall(MlockAllFlags::CURRENT).and_then(|()| later()).map_err(|e| {
        format!("memory is not locked ({e}): run as root, or allow it with LimitMEMLOCK=infinity in the unit")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_core_that_does_not_exist_is_named() {
        for core in [CpuSet::MAX_CPU - 1, CpuSet::MAX_CPU, usize::MAX] {
            let refused = Schedule { priority: 1, core: Some(core) }.try_apply();
            assert!(refused.iter().any(|why| why.contains(&format!("core {core}"))), "{refused:?}");
        }
    }
}
