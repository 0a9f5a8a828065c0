//! A disk that dies or fails at a given call, with a cache: what was not synced may be lost, whole or in part, when the power goes.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::*;

/// A seeded generator (xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % n.max(1) as u64) as usize
    }
}

/// Content as programs see it, and as it is on the disk.
#[derive(Clone, Default)]
struct Inode {
    cached: Vec<u8>,
    durable: Vec<u8>,
}

/// What goes wrong at a call.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    /// The machine or the program ends, in the middle of it.
    Death,
    /// The system refuses.
    Error(ErrorKind),
}

/// Names of folders have nodes too, which stay empty.
struct Contents {
    inodes: Vec<Inode>,
    cached: BTreeMap<PathBuf, usize>,
    durable: BTreeMap<PathBuf, usize>,
    calls: usize,
    fault: Option<(usize, Fault)>,
    is_dead: bool,
    ignores_sync: bool,
    random: Random,
}

impl Contents {
    fn check_folder(&self, folder: &Path) -> io::Result<()> {
        let is_there = folder == Path::new("/") || self.cached.contains_key(folder);
        if is_there { Ok(()) } else { Err(ErrorKind::NotFound.into()) }
    }

    /// A new, empty node under a name whose folder is there.
    fn add(&mut self, name: &Path) -> io::Result<usize> {
        self.check_folder(name.parent().expect("no name for the root"))?;
        let inode = self.inodes.len();
        self.inodes.push(Inode::default());
        self.cached.insert(name.to_owned(), inode);
        Ok(inode)
    }

    /// The name means on the disk what it means to programs.
    fn make_durable(&mut self, name: PathBuf) {
        match self.cached.get(&name) {
            Some(&inode) => drop(self.durable.insert(name, inode)),
            None => drop(self.durable.remove(&name)),
        }
    }

    /// Names in a folder, of what is there and of what was.
    fn names_in(&self, folder: &Path) -> Vec<PathBuf> {
        let names = self.cached.keys().chain(self.durable.keys());
        names.filter(|name| name.parent() == Some(folder)).cloned().collect()
    }
}

struct FaultyDisk(RefCell<Contents>);

impl FaultyDisk {
    fn new(seed: u64) -> Self {
        let contents = Contents {
            inodes: Vec::new(),
            cached: BTreeMap::new(),
            durable: BTreeMap::new(),
            calls: 0,
            fault: None,
            is_dead: false,
            ignores_sync: false,
            random: Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1),
        };
        Self(RefCell::new(contents))
    }

    /// From now on counted: the fault at the call with this number, from 0.
    fn set_fault(&self, call: usize, fault: Fault) {
        let mut contents = self.0.borrow_mut();
        (contents.calls, contents.fault) = (0, Some((call, fault)));
    }

    fn clear_fault(&self) {
        self.0.borrow_mut().fault = None;
    }

    /// Does a call, or not: one that dies may have been done before, or not.
    fn call<T>(&self, act: impl FnOnce(&mut Contents) -> io::Result<T>) -> io::Result<T> {
        let mut contents = self.0.borrow_mut();
        if contents.is_dead {
            return Err(io::Error::other("dead"));
        }
        let call = contents.calls;
        contents.calls += 1;
        match contents.fault {
            Some((at, Fault::Error(kind))) if at == call => Err(kind.into()),
            Some((at, Fault::Death)) if at == call => {
                contents.is_dead = true;
                if contents.random.below(2) == 0 {
                    act(&mut contents)?;
                }
                Err(io::Error::other("dead"))
            }
            _ => act(&mut contents),
        }
    }

    /// The disk after the power was gone: of everything that was not synced, any part may be there.
    fn after_power_loss(self) -> Self {
        let mut contents = self.0.into_inner();
        let names: Vec<PathBuf> = contents.cached.keys().chain(contents.durable.keys()).cloned().collect();
        for name in names {
            if contents.random.below(2) == 0 {
                contents.make_durable(name);
            }
        }
        // Nothing is found in a folder that has lost its own name; a parent comes before what is in it.
        for name in contents.durable.keys().cloned().collect::<Vec<_>>() {
            let folder = name.parent().expect("no name for the root");
            if folder != Path::new("/") && !contents.durable.contains_key(folder) {
                contents.durable.remove(&name);
            }
        }
        contents.cached.clone_from(&contents.durable);
        let random = &mut contents.random;
        for inode in &mut contents.inodes {
            if inode.cached != inode.durable {
                let part = random.below(inode.cached.len() + 1);
                inode.durable = match random.below(4) {
                    0 => inode.durable.clone(),
                    1 => inode.cached.clone(),
                    2 => inode.cached[..part].to_vec(),
                    _ => [&inode.cached[..part], &vec![0; inode.cached.len() - part]].concat(),
                };
            }
            inode.cached.clone_from(&inode.durable);
        }
        (contents.is_dead, contents.fault) = (false, None);
        Self(RefCell::new(contents))
    }
}

impl Disk for FaultyDisk {
    type File = usize;

    fn make_folder(&self, folder: &Path) -> io::Result<()> {
        self.call(|contents| match contents.check_folder(folder) {
            Ok(()) => Ok(()),
            Err(_) => contents.add(folder).map(drop),
        })
    }

    fn list(&self, folder: &Path) -> io::Result<Vec<PathBuf>> {
        self.call(|contents| {
            contents.check_folder(folder)?;
            let names = contents.cached.keys();
            Ok(names.filter(|name| name.parent() == Some(folder)).cloned().collect())
        })
    }

    fn read(&self, file: &Path) -> io::Result<Vec<u8>> {
        self.call(|contents| match contents.cached.get(file) {
            Some(&inode) => Ok(contents.inodes[inode].cached.clone()),
            None => Err(ErrorKind::NotFound.into()),
        })
    }

    fn create(&self, file: &Path) -> io::Result<usize> {
        self.call(|contents| contents.add(file))
    }

    fn write(&self, file: &mut usize, bytes: &[u8]) -> io::Result<()> {
        // One call of the system may take any part of the bytes.
        self.call(|contents| {
            let part = if contents.is_dead { contents.random.below(bytes.len() + 1) } else { bytes.len() };
            contents.inodes[*file].cached.extend(&bytes[..part]);
            Ok(())
        })
    }

    fn sync(&self, file: &usize) -> io::Result<()> {
        self.call(|contents| {
            if !contents.ignores_sync {
                let inode = &mut contents.inodes[*file];
                inode.durable.clone_from(&inode.cached);
            }
            Ok(())
        })
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.call(|contents| {
            let inode = contents.cached.remove(from).ok_or(ErrorKind::NotFound)?;
            contents.cached.insert(to.to_owned(), inode);
            Ok(())
        })
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        self.call(|contents| {
            contents.check_folder(folder)?;
            if !contents.ignores_sync {
                contents.names_in(folder).into_iter().for_each(|name| contents.make_durable(name));
            }
            Ok(())
        })
    }

    fn remove(&self, file: &Path) -> io::Result<()> {
        self.call(|contents| contents.cached.remove(file).map(drop).ok_or(ErrorKind::NotFound.into()))
    }
}

/// A store on a disk without any folder.
fn empty(seed: u64) -> Store<FaultyDisk> {
    Store::on(FaultyDisk::new(seed), PathBuf::from("/state/default"))
}

/// A disk with calibrations 1 to 3, of which 2 and 3 are wanted after the next one.
fn with_three(seed: u64) -> Store<FaultyDisk> {
    let store = empty(seed);
    (1..=3).for_each(|id| store.save(&stored(id)).expect("no fault yet"));
    store
}

/// Saves the fourth as the daemon does; whether it was promised to be safe.
fn save_fourth(store: &Store<FaultyDisk>) -> bool {
    let is_saved = store.save(&stored(4)).is_ok();
    is_saved && {
        // Failing to tidy up breaks no promise.
        let _ = store.remove_old(2);
        true
    }
}

/// More calls than saving and tidying up make.
const MANY_CALLS: usize = 20;

#[track_caller]
fn check_nothing_is_lost(store: &Store<FaultyDisk>, is_promised: bool, what: &str) {
    let loaded = store.load().expect("readable");
    assert!(loaded.damaged.is_empty(), "{what}: {:?}", loaded.damaged);
    let found = ids(&loaded.history);
    assert!(found.ends_with(&[2, 3]) || found.ends_with(&[2, 3, 4]), "{what}: {found:?}");
    assert!(!is_promised || found.ends_with(&[4]), "{what}: {found:?}");
    assert!(loaded.history.entries().iter().all(|entry| *entry == stored(entry.id)), "{what}: changed");
}

#[test]
fn dying_at_any_call_of_a_write_loses_nothing() {
    for seed in 0..12 {
        for call in 0..MANY_CALLS {
            let store = with_three(seed);
            store.disk.set_fault(call, Fault::Death);
            let is_promised = save_fourth(&store);
            let died = store.disk.0.borrow().is_dead;
            assert!(died || call >= 8, "call {call}: a save makes at least eight calls");
            // Once only the program dies and the cache stays, once the machine does.
            store.disk.0.borrow_mut().is_dead = false;
            store.disk.clear_fault();
            check_nothing_is_lost(&store, is_promised, &format!("program, seed {seed}, call {call}"));
            let store = Store::on(store.disk.after_power_loss(), store.folder);
            check_nothing_is_lost(&store, is_promised, &format!("machine, seed {seed}, call {call}"));
            // The next daemon goes on from there, and leaves no rest behind.
            store.save(&stored(5)).expect("the disk works again");
            store.remove_old(2).expect("and can be tidied up");
            let names = store.disk.list(&store.folder).expect("listed");
            assert!(names.iter().all(|name| id_of(name).is_some_and(|id| id >= 2)), "{names:?}");
        }
    }
}

#[test]
fn the_first_calibration_of_all_survives_with_the_folders_that_are_made_for_it() {
    for seed in 0..12 {
        let store = empty(seed);
        store.save(&stored(1)).expect("no fault");
        let store = Store::on(store.disk.after_power_loss(), store.folder);
        assert_eq!(ids(&store.load().expect("readable").history), [1], "seed {seed}");
    }
}

#[test]
fn a_folder_that_a_killed_daemon_has_made_is_as_safe_as_one_of_its_own() {
    for seed in 0..12 {
        for call in 0..MANY_CALLS {
            let store = empty(seed);
            store.disk.make_folder(Path::new("/state")).expect("no fault yet");
            store.disk.sync_folder(Path::new("/")).expect("no fault yet");
            store.disk.set_fault(call, Fault::Death);
            // The program dies, and the cache stays for the next one.
            let _ = store.save(&stored(1));
            store.disk.0.borrow_mut().is_dead = false;
            store.disk.clear_fault();
            store.save(&stored(2)).expect("the next daemon");
            let store = Store::on(store.disk.after_power_loss(), store.folder);
            let found = ids(&store.load().expect("readable").history);
            assert!(found.ends_with(&[2]), "seed {seed}, call {call}: {found:?}");
        }
    }
}

#[test]
fn without_syncing_a_loss_of_power_would_lose_it() {
    let is_lost = |seed| {
        let store = with_three(seed);
        store.disk.0.borrow_mut().ignores_sync = true;
        assert!(save_fourth(&store));
        let store = Store::on(store.disk.after_power_loss(), store.folder);
        store.load().expect("readable").history.get(4) != Some(&stored(4))
    };
    assert!((0..40).any(is_lost), "this disk forgives everything: the test above shows nothing");
}

#[test]
fn a_refused_call_is_said_and_loses_nothing_and_a_later_try_succeeds() {
    for kind in
        [ErrorKind::StorageFull, ErrorKind::ReadOnlyFilesystem, ErrorKind::PermissionDenied, ErrorKind::Other]
    {
        // The last calls of all are those of tidying up.
        for call in 0..7 {
            let store = with_three(7);
            store.disk.set_fault(call, Fault::Error(kind));
            let error = store.save(&stored(4)).expect_err("refused").to_string();
            assert!(error.contains("default"), "{error}");
            assert_eq!(error.contains("free some space"), kind == ErrorKind::StorageFull, "{error}");
            check_nothing_is_lost(&store, false, &error);
            store.disk.clear_fault();
            assert!(save_fourth(&store), "tried again");
            let store = Store::on(store.disk.after_power_loss(), store.folder);
            check_nothing_is_lost(&store, true, &error);
        }
    }
}

#[test]
fn a_full_disk_is_tried_again_in_the_right_order() {
    let store = with_three(3);
    store.disk.set_fault(2, Fault::Error(ErrorKind::StorageFull));
    let writer = Writer::start(store).expect("a thread");
    (4..=6).for_each(|id| writer.save(stored(id), 2));
    let (reports, is_done) = writer.finish(std::time::Duration::from_secs(60));
    assert!(is_done);
    assert!(matches!(reports.first(), Some(Report::Failed { id: 4, .. })), "{reports:?}");
    let saved: Vec<u64> = reports
        .iter()
        .filter_map(|report| if let Report::Saved { id } = report { Some(*id) } else { None })
        .collect();
    assert_eq!(saved, [4, 5, 6]);
}
