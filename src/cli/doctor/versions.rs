//! Versions of what the program is made of, and of the libraries that it needs or may use.

use std::path::Path;

use super::finding::Finding;
use super::system::System;
use crate::capture::realsense::MIN_SDK_VERSION;
use crate::ipc::wire;
use crate::learned::LearnedOptions;

const CHECK: &str = "versions";
/// What this program was built from.
const LOCK: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.lock"));
/// Where the loader finds libraries, and the folders of Debian's triplets are in the second.
const LIBRARY_FOLDERS: [&str; 4] = ["/usr/local/lib", "/usr/lib", "/lib", "/usr/lib64"];

/// Our own version, and those of the libraries.
pub fn check(system: &System, matcher: &LearnedOptions, needs_realsense: bool) -> Vec<Finding> {
    vec![own(), librealsense(system, needs_realsense), onnx_runtime(system, matcher)]
}

fn own() -> Finding {
    let (version, layouts) = (env!("CARGO_PKG_VERSION"), wire::VERSION);
    let iceoryx2 = locked("iceoryx2").unwrap_or("unknown");
    Finding::ok(CHECK, format!("pelical {version}, message layouts {layouts}, iceoryx2 {iceoryx2}"))
}

/// The version of a dependency in this program.
fn locked(name: &str) -> Option<&'static str> {
    let (_, entry) = LOCK.split_once(&format!("name = \"{name}\"\nversion = \""))?;
    entry.split_once('"').map(|(version, _)| version)
}

/// The library of the RealSense cameras: is there one, and is it new enough?
pub fn librealsense(system: &System, is_needed: bool) -> Finding {
    const NAME: &str = "librealsense2.so";
    let newest = libraries(system, NAME).into_iter().next();
    let shown = newest.as_ref().map_or_else(|| "none".to_owned(), |library| library.file.clone());
    if !is_needed {
        return Finding::ok(CHECK, format!("librealsense: {shown}, and the config's back end needs none"));
    }
    let cure =
        format!("install librealsense2 {MIN_SDK_VERSION} or newer (docs/realsense.md), then sudo ldconfig");
    let Some(newest) = newest else {
        let cause = format!("no {NAME} in {}, or only links that lead nowhere", LIBRARY_FOLDERS.join(", "));
        let what = "librealsense is not installed, and the config's back end needs it";
        return Finding::problem(CHECK, what, (cause, cure));
    };
    if newest.version.is_empty() {
        let cause = format!(
            "its name does not tell; `pkg-config --modversion realsense2` must say {MIN_SDK_VERSION} or newer"
        );
        return Finding::warning(CHECK, format!("librealsense: {shown}, of unknown version"), (cause, cure));
    }
    if newest.version < version_of(MIN_SDK_VERSION) {
        let cause = format!(
            "the program asks for the interface of {MIN_SDK_VERSION}, which an older library refuses"
        );
        return Finding::problem(CHECK, format!("librealsense: {shown} is too old"), (cause, cure));
    }
    Finding::ok(CHECK, format!("librealsense: {shown}"))
}

fn onnx_runtime(system: &System, matcher: &LearnedOptions) -> Finding {
    const NAME: &str = "libonnxruntime.so";
    if matcher.models.is_empty() {
        return Finding::ok(CHECK, "ONNX Runtime: not needed, matcher.models is empty");
    }
    let missing = |path: &&Path| !system.exists(path);
    if let Some(path) = matcher.runtime.as_deref().filter(missing) {
        let why = (
            "matcher.runtime names a file that is not there: the learned matcher is done without",
            "install ONNX Runtime 1.24 or newer and name its library, or set matcher.runtime to null",
        );
        return Finding::problem(CHECK, format!("ONNX Runtime: no file {}", path.display()), why);
    }
    if let Some(path) = matcher.models.iter().map(|path| path.as_path()).find(missing) {
        let why = (
            "matcher.models names a file that is not there: the learned matcher is done without",
            "name the model's file, or empty the list",
        );
        return Finding::problem(CHECK, format!("model of the matcher: no file {}", path.display()), why);
    }
    let found = matcher.runtime.as_ref().map(|path| path.display().to_string());
    let named = std::env::var("ORT_DYLIB_PATH").ok().filter(|path| !path.is_empty());
    let installed = || libraries(system, NAME).into_iter().next().map(|library| library.file);
    match found.or(named).or_else(installed) {
        Some(file) => Finding::ok(CHECK, format!("ONNX Runtime: {file}")),
        None => Finding::problem(
            CHECK,
            "ONNX Runtime is not installed, and matcher.models is not empty",
            (
                format!("no {NAME} in {}", LIBRARY_FOLDERS.join(", ")),
                "install ONNX Runtime 1.24 or newer, or name its library in matcher.runtime (docs/models.md)",
            ),
        ),
    }
}

/// A shared library that is there.
struct Library {
    /// Links followed.
    file: String,
    /// Of its name; empty where that does not tell.
    version: Vec<u32>,
}

/// The numbers of "2.56.5"; none where anything else is in it.
fn version_of(text: &str) -> Vec<u32> {
    text.split('.').map(|part| part.parse().ok()).collect::<Option<_>>().unwrap_or_default()
}

/// Libraries of this name, in the folders of libraries and one folder deeper, the newest first; links that lead nowhere are none.
fn libraries(system: &System, name: &str) -> Vec<Library> {
    let inner = |folder: &&str| {
        let names = system.names(folder).into_iter().filter(|inner| inner.contains("-linux-"));
        names.map(|inner| format!("{folder}/{inner}")).collect::<Vec<_>>()
    };
    let outer = LIBRARY_FOLDERS.iter().map(|folder| (*folder).to_owned());
    let folders = outer.chain(LIBRARY_FOLDERS.iter().flat_map(inner));
    let library = |file: String| {
        let file = system.follow(file)?.display().to_string();
        let version = file.rsplit_once(".so.").map_or_else(Vec::new, |(_, version)| version_of(version));
        Some(Library { file, version })
    };
    let files = folders.flat_map(|folder| {
        let found = system.names(&folder).into_iter().filter(|file| file.starts_with(name));
        found.filter_map(|file| library(format!("{folder}/{file}"))).collect::<Vec<_>>()
    });
    let mut found: Vec<Library> = files.collect();
    found.sort_by(|a, b| b.version.cmp(&a.version));
    found
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_program_knows_what_it_is_made_of() {
        let version = super::locked("iceoryx2").expect("a dependency");
        assert!(version.starts_with("0.") && version.split('.').count() == 3, "{version}");
        assert_eq!(super::locked("no such crate"), None);
    }
}
