use std::fs;

use super::*;

/// A store in a folder of its own.
fn store() -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let store = Store::in_folder(folder.path().join("default"));
    (folder, store)
}

#[test]
fn what_was_saved_is_there_for_the_next_daemon() {
    let (_folder, store) = store();
    assert_eq!(store.load().expect("a folder that is not there is empty").history, History::default());
    (1..=3).for_each(|id| store.save(&stored(id)).expect("saved"));
    let loaded = store.load().expect("readable");
    assert_eq!(loaded.history.entries(), [stored(1), stored(2), stored(3)]);
    assert_eq!(loaded.history.next_id(), 4);
    assert_eq!(loaded.history.newest_below(3), Some(&stored(2)));
    assert!(loaded.damaged.is_empty());
}

#[test]
fn damaged_files_are_named_and_passed_over_and_older_ones_are_used() {
    let (_folder, store) = store();
    (1..=4).for_each(|id| store.save(&stored(id)).expect("saved"));
    let file = |id: u64| store.folder().join(file_name(id));
    let text = fs::read(file(4)).expect("written");
    fs::write(file(4), &text[..text.len() / 2]).expect("torn");
    fs::write(file(3), b"\0\0\0\xffgarbage\n").expect("garbage");
    fs::copy(file(2), file(7)).expect("a copy under another number");
    fs::write(file(8), b"").expect("empty");
    fs::create_dir(file(9)).expect("a folder under the name of a file");
    let loaded = store.load().expect("readable");
    assert_eq!(ids(&loaded.history), [1, 2]);
    let damaged: Vec<_> = loaded.damaged.iter().map(|(file, what)| (id_of(file), what.as_str())).collect();
    assert_eq!(damaged.iter().map(|(id, _)| *id).collect::<Vec<_>>(), [3, 4, 7, 8, 9].map(Some));
    assert!(damaged[1].1.contains("cut or added to"), "{damaged:?}");
    assert!(damaged[2].1.contains("under the name of another"), "{damaged:?}");
    assert_eq!(loaded.history.next_id(), 10, "the number of a damaged file is taken");
}

#[test]
fn old_files_and_unfinished_ones_go_and_nothing_else_does() {
    let (_folder, store) = store();
    let mut history = History::default();
    for id in 1..=6 {
        store.save(&stored(id)).expect("saved");
        history.add(stored(id));
    }
    let others =
        ["notes.txt", "calibration-5.yaml", "calibration-000001.yaml.bak", "calibration-000001.new.txt"];
    others.iter().for_each(|name| fs::write(store.folder().join(name), "mine").expect("written"));
    fs::write(store.folder().join("calibration-000007.new"), "half").expect("written");
    let oldest_kept = history.keep_newest(2);
    store.remove_old(oldest_kept).expect("removed");
    assert_eq!(ids(&store.load().expect("readable").history), [5, 6]);
    let mut left: Vec<_> = fs::read_dir(store.folder())
        .expect("listed")
        .map(|entry| entry.expect("listed").file_name())
        .collect();
    left.sort();
    let mut expected = vec!["calibration-000005.yaml", "calibration-000006.yaml"];
    expected.extend(others);
    expected.sort_unstable();
    assert_eq!(left, expected);
}

#[test]
fn a_history_keeps_the_newest_and_never_gives_a_number_twice() {
    let mut history = History::default();
    (1..=5).for_each(|id| history.add(stored(id)));
    assert_eq!(history.keep_newest(2), 4);
    assert_eq!((ids(&history), history.next_id()), (vec![4, 5], 6));
    assert_eq!(history.keep_newest(9), 4);
    assert_eq!((history.newest_below(4), history.get(3)), (None, None));
    assert_eq!(history.newest_below(u64::MAX), Some(&stored(5)));
}
