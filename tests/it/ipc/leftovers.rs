//! What daemons and clients leave behind in the folder of the files.

use super::*;

/// Names of what there is below a folder.
fn files_below(folder: &std::path::Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut names = Vec::new();
    for entry in entries.map(|entry| entry.expect("readable").path()) {
        if entry.is_dir() {
            names.extend(files_below(&entry))
        } else {
            names.push(entry.display().to_string())
        }
    }
    names.sort();
    names
}

#[test]
fn clients_of_the_files_leave_nothing_behind_and_nothing_is_in_shared_memory() {
    let (folder, instance) = (tempfile::tempdir().expect("a temporary folder"), unique_instance());
    let over = Transport::files(folder.path());
    let daemon = Daemon::start(&over, &instance);
    let use_once = || {
        let mut client = Client::connect_over(&over, &instance).expect("the daemon runs");
        client.status(PLENTY).expect("answered");
    };
    use_once();
    let before = files_below(folder.path());
    assert!(!before.is_empty(), "nothing is in the folder");
    (0..20).for_each(|_| use_once());
    // The daemon drops its side of a connection when it next looks.
    let deadline = Instant::now() + PLENTY;
    while files_below(folder.path()).len() > before.len() && Instant::now() < deadline {
        use_once();
    }
    // Fewer when the daemon had not yet dropped the first client's when they were counted.
    let after = files_below(folder.path());
    assert!(after.len() <= before.len(), "{before:?} became {after:?}");
    let mapped = std::fs::read_to_string("/proc/self/maps").expect("readable");
    let place = folder.path().display().to_string();
    assert!(mapped.contains(&place), "the daemon in this process maps files below {place}");
    drop(daemon);
    let left = files_below(folder.path());
    assert!(left.len() <= 1, "the end leaves {left:?}");
}

#[test]
fn a_daemon_starts_where_another_was_killed_while_it_made_its_services() {
    let (folder, instance) = (tempfile::tempdir().expect("a temporary folder"), unique_instance());
    let over = Transport::files(folder.path());
    let services = folder.path().join("ipc/services");
    let daemon = Daemon::start(&over, &instance);
    // A started daemon has answered once.
    Client::connect_over(&over, &instance).expect("the daemon runs").status(PLENTY).expect("answered");
    let described: Vec<(std::path::PathBuf, Vec<u8>)> = files_below(&services)
        .into_iter()
        .map(|file| (file.clone().into(), std::fs::read(file).expect("readable")))
        .collect();
    assert_eq!(described.len(), 7, "one description for each topic");
    drop(daemon);
    assert!(files_below(&services).is_empty(), "a clean end leaves nothing");
    // One that was made but for its memory, and one that was not even written.
    std::fs::write(&described[0].0, &described[0].1).expect("written");
    std::fs::write(&described[1].0, "").expect("written");
    let _daemon = Daemon::start(&over, &instance);
    let mut client = Client::connect_over(&over, &instance).expect("the daemon runs");
    client.status(PLENTY).expect("answered");
}

#[test]
fn the_memory_of_a_daemon_is_taken_at_its_start_so_that_a_full_file_system_cannot_kill_it() {
    use std::os::unix::fs::MetadataExt;
    let (folder, instance) = (tempfile::tempdir().expect("a temporary folder"), unique_instance());
    let over = Transport::files(folder.path());
    let _daemon = Daemon::start(&over, &instance);
    let files = files_below(folder.path());
    let sizes =
        files.iter().map(|file| std::fs::metadata(file).expect("there")).filter(|file| file.is_file());
    let sizes: Vec<(u64, u64)> = sizes.map(|file| (file.len(), 512 * file.blocks())).collect();
    assert!(sizes.iter().map(|(length, _)| length).sum::<u64>() > 10 << 20, "{sizes:?}");
    let holes: Vec<_> = sizes.iter().filter(|(length, taken)| taken < length).collect();
    assert!(holes.is_empty(), "bytes of files and what is taken of them: {holes:?}");
}
