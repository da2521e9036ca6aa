//! Whether this machine has the memory for a network on the processor, said before the system ends the program.

use std::path::Path;

use harmony_roles::{Role, RoleError};

use super::not_set_up;

/// What a network takes beside its weights, bytes: from the peaks of `docs/performance.md`, "Networks on the CPU".
fn working(role: Role) -> u64 {
    let mib: u64 = match role {
        Role::GeometryEstimator => 1100,
        Role::Segmenter => 1400,
        _ => 400,
    };
    mib << 20
}

/// Says so when less memory is free than weights and work take. What cannot be found out does not hinder.
///
/// # Errors
/// [`RoleError::NotSetUp`] with what to do.
pub fn check(role: Role, name: &str, weights: &Path) -> Result<(), RoleError> {
    let need = bytes_of(weights) + working(role);
    let limit = std::fs::read_to_string("/sys/fs/cgroup/memory.max").unwrap_or_default();
    match free(&std::fs::read_to_string("/proc/meminfo").unwrap_or_default(), &limit) {
        Some(free) if free < need => Err(too_little(role, name, need, free)),
        _ => Ok(()),
    }
}

fn too_little(role: Role, name: &str, need: u64, free: u64) -> RoleError {
    let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
    let smaller = match role {
        Role::GeometryEstimator => "give --points",
        Role::Segmenter => "set `model = \"sam2.1-small\"`",
        _ => "take owlv2-base",
    };
    let section = role.folder();
    not_set_up(
        name,
        format!("too little memory: it takes {:.1} GiB, {:.1} GiB are free", gib(need), gib(free)),
        format!(
            "close other programs, {smaller}, or set `player = \"offline\"` in [players.{section}] of harmony.toml"
        ),
    )
}

/// Bytes of a file, or of a folder's files.
fn bytes_of(path: &Path) -> u64 {
    let length =
        |path: &Path| std::fs::metadata(path).ok().filter(std::fs::Metadata::is_file).map_or(0, |file| file.len());
    let inside = std::fs::read_dir(path).into_iter().flatten().flatten();
    length(path) + inside.map(|entry| length(&entry.path())).sum::<u64>()
}

/// Bytes that are free, by `/proc/meminfo` and the limit of a container (a number of bytes, or `max`).
fn free(meminfo: &str, limit: &str) -> Option<u64> {
    let row = meminfo.lines().find_map(|row| row.strip_prefix("MemAvailable:"))?;
    let kib: u64 = row.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(limit.trim().parse().map_or(kib << 10, |limit: u64| limit.min(kib << 10)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_memory_is_the_lesser_of_machine_and_container() {
        let meminfo = "MemTotal:       16384000 kB\nMemAvailable:    8388608 kB\n";
        assert_eq!(free(meminfo, "max\n"), Some(8 << 30));
        assert_eq!(free(meminfo, "2147483648\n"), Some(2 << 30));
        assert_eq!(free(meminfo, ""), Some(8 << 30));
        assert_eq!(free("MemTotal: 1 kB\n", "max"), None);
    }

    #[test]
    fn too_little_memory_is_said_with_what_to_do() {
        let error = too_little(Role::Segmenter, "sam2.1-large", 9 << 28, 1 << 30);
        assert_eq!(
            error.to_string(),
            "sam2.1-large cannot be used: too little memory: it takes 2.2 GiB, 1.0 GiB are free"
        );
        let hint = error.hint().unwrap();
        assert!(hint.contains("sam2.1-small") && hint.contains("[players.segmenter]"), "{hint}");
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a"), [0; 7]).unwrap();
        assert_eq!((bytes_of(folder.path()), bytes_of(&folder.path().join("a"))), (7, 7));
        assert_eq!(bytes_of(&folder.path().join("none")), 0);
    }
}
