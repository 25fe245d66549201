//! The memory of this machine.

use sysinfo::{MemoryRefreshKind, RefreshKind, System};

/// Bytes that are free for more, in this machine or in the container that it is; `None` where the system does not tell.
pub fn free_bytes() -> Option<u64> {
    let ram = RefreshKind::nothing().with_memory(MemoryRefreshKind::nothing().with_ram());
    let system = System::new_with_specifics(ram).ok()?;
    let free = system.available_memory();
    // What a container says to be free lacks the files that it has cached: only its whole size is a bound.
    let free = system.cgroup_limits().map_or(free, |limits| free.min(limits.total_memory));
    (free > 0).then_some(free)
}
