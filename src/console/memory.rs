//! Memory limits of the process, and the exit code when memory is exhausted.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use signal_hook::consts::SIGABRT;

use super::host;
use crate::{Error, Result};

/// The system's allocator. It records when an allocation fails.
#[derive(Debug)]
pub struct Allocator;

/// Raised once an allocation has failed: an abort has this reason then.
static EXHAUSTED: OnceLock<Arc<AtomicBool>> = OnceLock::new();

fn recorded(memory: *mut u8) -> *mut u8 {
    if let Some(flag) = EXHAUSTED.get().filter(|_| memory.is_null()) {
        flag.store(true, Ordering::SeqCst);
    }
    memory
}

// SAFETY: all calls are forwarded to the system allocator, with the same contract.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's contract.
        recorded(unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's contract.
        recorded(unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller's contract; `memory` was allocated by `System`.
        recorded(unsafe { System.realloc(memory, layout, size) })
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's contract; `memory` was allocated by `System`.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// Makes a failed allocation end the program with exit code 76, if [`Allocator`] is the global allocator. Rust prints the
/// requested bytes and aborts, which is then handled.
pub(crate) fn exit_when_exhausted() -> Result<()> {
    let exhausted = Arc::clone(EXHAUSTED.get_or_init(Arc::default));
    let code = Error::Host(String::new()).exit_code();
    signal_hook::flag::register_conditional_shutdown(SIGABRT, code.into(), exhausted)
        .map(drop)
        .map_err(|e| Error::Host(format!("cannot listen to signal {SIGABRT}: {e}")))
}

/// The lowest memory limit of this process in bytes, and its source: cgroups (version 1 or 2) or a resource limit (`ulimit`).
/// `None` if there is no limit.
pub fn allowed() -> Option<(u64, &'static str)> {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let cgroup = cgroup_limit(&read("/proc/self/cgroup"), &read("/proc/self/mountinfo"), Path::new("/"));
    // Mapped memory that is not resident, such as libraries and stacks, counts too.
    let elsewhere = host::virtual_memory_bytes().saturating_sub(host::resident_memory_bytes());
    let space = getrlimit(Resource::As).current.map(|bytes| bytes.saturating_sub(elsewhere));
    let data = getrlimit(Resource::Data).current.map(|bytes| bytes.saturating_sub(host::untouched_data_bytes()));
    let all = [(cgroup, "its cgroup"), (space, "its limit of address space"), (data, "its limit of data")];
    all.into_iter().filter_map(|(bytes, what)| Some((bytes?, what))).min()
}

/// Bytes of the stacks that a thread and the ray library's thread beside it map: 8 MiB each, as is usual, and a guard.
const STACK_BYTES: u64 = 18 << 20;

/// Makes allocations beyond this number of bytes fail, so that the program ends with a message ([`exit_when_exhausted`])
/// before the system kills it. The limit counts what is mapped: stacks of this many threads, which hardly touch them, are
/// allowed for.
pub(crate) fn hold_to(bytes: u64, threads: usize) {
    let Rlimit { current, maximum } = getrlimit(Resource::Data);
    let bytes = bytes.saturating_add(host::untouched_data_bytes()).saturating_add((threads as u64 + 1) * STACK_BYTES);
    let least = [Some(bytes), current, maximum].into_iter().flatten().min();
    // Without effect if the limit cannot be set.
    let _ = setrlimit(Resource::Data, Rlimit { current: least, maximum });
}

/// The lowest limit in bytes of the memory cgroups of a process, below a file system's `root` (cgroups(7)). `membership` is
/// the text of `/proc/self/cgroup`, `mounts` that of `/proc/self/mountinfo`.
fn cgroup_limit(membership: &str, mounts: &str, root: &Path) -> Option<u64> {
    let mounted = mounts.lines().filter_map(|line| {
        let (place, kind) = line.split_once(" - ")?;
        let (place, kind): (Vec<_>, Vec<_>) = (place.split(' ').collect(), kind.split(' ').collect());
        let file = match *kind.first()? {
            "cgroup2" => "memory.max",
            "cgroup" if kind.get(2)?.split(',').any(|option| option == "memory") => "memory.limit_in_bytes",
            _ => return None,
        };
        Some((*place.get(3)?, *place.get(4)?, file))
    });
    let own = |file: &str| {
        membership.lines().find_map(|line| {
            let mut fields = line.splitn(3, ':').skip(1);
            let (controllers, path) = (fields.next()?, fields.next()?);
            let ours = match file {
                "memory.max" => controllers.is_empty(),
                _ => controllers.split(',').any(|name| name == "memory"),
            };
            ours.then_some(path)
        })
    };
    let limits = mounted.filter_map(|(mount_root, mount, file)| {
        let path = Path::new(own(file)?);
        let below = path.strip_prefix(mount_root).or_else(|_| path.strip_prefix("/")).ok()?;
        let mount = root.join(mount.trim_start_matches('/'));
        let own = mount.join(below);
        let all = own.ancestors().take_while(|folder| folder.starts_with(&mount));
        all.filter_map(|folder| fs::read_to_string(folder.join(file)).ok()?.trim().parse::<u64>().ok()).min()
    });
    // Version 1 has almost 2^63 for no limit.
    limits.min().filter(|bytes| *bytes < 1 << 62)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_limit_of_a_cgroup_and_those_above_it_counts() {
        let folder = tempfile::tempdir().unwrap();
        let put = |file: &str, text: &str| {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        put("sys/fs/cgroup/slurm/job_7/memory.max", "max\n");
        put("sys/fs/cgroup/slurm/memory.max", "419430400\n");
        put("sys/fs/cgroup/memory/a/b/memory.limit_in_bytes", "9223372036854771712\n");
        put("sys/fs/cgroup/memory/a/memory.limit_in_bytes", "209715200\n");
        put("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
        let two = "34 24 0:29 / /sys/fs/cgroup rw,nosuid - cgroup2 cgroup2 rw\n";
        let one = "35 24 0:30 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n\
                   36 24 0:31 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu\n";
        // As in a container that sees its own cgroup alone, but gets its whole path.
        let inside = "35 24 0:30 /docker/x /sys/fs/cgroup/memory/a rw - cgroup cgroup rw,memory\n";
        for (membership, mounts, wanted) in [
            ("0::/slurm/job_7\n", two, Some(400 << 20)),
            ("0::/\n", two, None),
            ("5:cpu:/\n4:memory:/a/b\n", one, Some(200 << 20)),
            ("4:cpuset,memory:/a\n0::/\n", one, Some(200 << 20)),
            ("4:memory:/\n", one, None),
            ("4:memory:/docker/x\n", inside, Some(200 << 20)),
            ("4:memory:/a/b\n0::/slurm\n", &format!("{two}{one}"), Some(200 << 20)),
            ("", two, None),
            ("4:memory:/a\n", "", None),
        ] {
            assert_eq!(cgroup_limit(membership, mounts, folder.path()), wanted, "{membership}");
        }
    }
}
