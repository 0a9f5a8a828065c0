//! What is wrong with a runtime or a model is said in one sentence, with what to do.

use super::*;

#[track_caller]
fn check_sentence(message: &str, parts: &[&str]) {
    assert!(!message.contains('\n') && message.len() < 600, "not one sentence: {message:?}");
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in {message:?}");
    }
}

#[track_caller]
fn check_load(models: &[&str], parts: &[&str]) {
    let Some(options) = tiny_options(models) else { return };
    check_sentence(&LearnedMatcher::load(&options).expect_err("a wrong model").to_string(), parts);
}

#[track_caller]
fn check_run(models: &[&str], parts: &[&str]) {
    let Some(options) = tiny_options(models) else { return };
    let found = scores(&options, &golden().segments);
    check_sentence(&found.expect_err("a model that does not fit").to_string(), parts);
}

#[test]
fn no_models_are_no_matcher() {
    let message = LearnedMatcher::load(&LearnedOptions::default()).expect_err("nothing to load").to_string();
    check_sentence(&message, &["matcher.models has no model", "`dense`", "`glue`", "docs/models.md"]);
}

#[test]
fn names_of_inputs_tell_contracts() {
    let wanted = [
        "bad_names.onnx",
        "its inputs are picture",
        "allowed are image (`dense`)",
        "(`glue`)",
        "docs/models.md",
    ];
    check_load(&["bad_names.onnx"], &wanted);
    check_load(&["bad_output.onnx"], &["needs the output descriptors, but has features"]);
}

#[test]
fn types_and_shapes_are_checked_when_a_model_is_loaded() {
    check_load(&["bad_type.onnx"], &["its input image is of type", "it must be"]);
    check_load(
        &["bad_rank.onnx"],
        &["its input image has the shape [1, free, free]", "[1, 1 or 3, any, any]"],
    );
    check_load(&["bad_fixed_points.onnx"], &["its input desc0 has the shape [1, 16, 4]", "[1, free, any]"]);
    check_load(&["bad_metadata.onnx"], &["pelical.multiple = \"many\"", "whole number from 1 to 4096"]);
}

#[test]
fn what_shows_only_in_use_is_an_error_of_that_pair() {
    check_run(&["bad_stride.onnx"], &["bad_stride.onnx failed", "descriptors has the shape [1, 4, 6, 8]"]);
    check_run(&["dense.onnx", "bad_width.onnx"], &["descriptors of 6 numbers", "`dense` gives 4"]);
    check_run(&["dense.onnx", "bad_shape.onnx"], &["its output scores has the shape"]);
}

#[test]
fn images_larger_than_a_model_takes_are_refused() {
    let Some(options) = tiny_options(&["dense_rgb_fixed.onnx"]) else { return };
    let mut matcher = LearnedMatcher::load(&options).expect("the model fits");
    let pixels = vec![0; 65 * 40];
    let image = GrayView::try_new(&pixels, (65, 40), 65).expect("as long as its size");
    let message = matcher.image_features(&image).expect_err("too wide").to_string();
    check_sentence(&message, &["up to 64 x 48 px", "65 x 40"]);
}

#[test]
fn models_that_do_not_belong_together_are_refused() {
    check_load(&["glue.onnx"], &["matcher.models has `glue`", "allowed are one model `dense` alone"]);
    check_load(&["dense.onnx", "dense.onnx"], &["`dense` and `dense`"]);
    check_load(&["dense.onnx", "lines.onnx"], &["`dense` and `lines`"]);
    check_load(&["wireframe.onnx", "dense.onnx", "glue.onnx"], &["`dense` and `glue` and `wireframe`"]);
}

#[test]
fn files_that_are_no_models_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = std::fs::read(tiny("dense.onnx")).expect("a committed file");
    let text = b"this is a text, and no model".to_vec();
    for (name, data) in
        [("text.onnx", text), ("cut.onnx", model[..model.len() / 2].to_vec()), ("empty.onnx", vec![])]
    {
        let file = folder.path().join(name);
        std::fs::write(&file, data).expect("written");
        let Some(options) = options(&[file]) else { return };
        let message = LearnedMatcher::load(&options).expect_err("no model").to_string();
        check_sentence(&message, &["cannot load the model", name, "docs/models.md"]);
    }
    let Some(missing) = options(&[folder.path().join("missing.onnx")]) else { return };
    let message = LearnedMatcher::load(&missing).expect_err("not there").to_string();
    check_sentence(&message, &["missing.onnx", "No such file", "docs/models.md"]);
    let Some(directory) = options(&[folder.path().to_owned()]) else { return };
    let message = LearnedMatcher::load(&directory).expect_err("a folder").to_string();
    check_sentence(&message, &["it is not a file"]);
}

#[test]
fn what_a_machine_lacks_is_skipped_down_to_the_cpu() {
    let Some(mut options) = tiny_options(&["dense.onnx", "glue.onnx"]) else { return };
    let golden = golden();
    let here = scores(&options, &golden.segments).expect("the models fit");
    options.providers = vec![Provider::TensorRt, Provider::Cuda];
    let anywhere = scores(&options, &golden.segments).expect("at last on the CPU");
    for (here, there) in here.values.iter().zip(&anywhere.values) {
        assert!((here - there).abs() < 1e-3, "{here} became {there}");
    }
}

/// A process has one runtime, so a wrong one needs a process of its own: this test, started again by those below.
#[test]
fn runtime_of_another_process() {
    let Some(runtime) = std::env::var_os("PELICAL_TEST_RUNTIME") else { return };
    let options = LearnedOptions {
        runtime: Some(runtime.into()),
        models: vec![tiny("dense.onnx")],
        ..LearnedOptions::default()
    };
    println!("SAID: {}", LearnedMatcher::load(&options).expect_err("a wrong runtime"));
}

#[track_caller]
fn check_runtime(runtime: &Path, parts: &[&str]) {
    let program = std::env::current_exe().expect("this program");
    let test = "learned::tests::refused::runtime_of_another_process";
    let mut command = std::process::Command::new(program);
    command.args([test, "--exact", "--nocapture"]).env("PELICAL_TEST_RUNTIME", runtime);
    let output = command.output().expect("started");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    let said = text.split("SAID: ").nth(1).and_then(|said| said.lines().next()).expect("it said something");
    check_sentence(said, parts);
    check_sentence(
        said,
        &["cannot load ONNX Runtime from", "install ONNX Runtime 1.24 or newer", "matcher.runtime"],
    );
}

#[test]
fn a_missing_runtime_says_what_to_install() {
    check_runtime(Path::new("/nowhere/libonnxruntime.so"), &["/nowhere/libonnxruntime.so", "No such file"]);
}

#[test]
fn a_file_that_is_no_library_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("libonnxruntime.so");
    std::fs::write(&file, "this is a text, and no library").expect("written");
    check_runtime(&file, &["libonnxruntime.so"]);
}

/// Builds a shared library from a line of C with the compiler that linked this test.
fn library(folder: &Path, code: &str) -> PathBuf {
    let (source, library) = (folder.join("library.c"), folder.join("liblibrary.so"));
    std::fs::write(&source, code).expect("written");
    let mut compiler = std::process::Command::new("cc");
    compiler.args(["-shared", "-fPIC", "-o"]).arg(&library).arg(&source);
    assert!(compiler.status().expect("cc links every Rust program").success());
    library
}

#[test]
fn another_library_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let library = library(folder.path(), "int answer(void) { return 42; }\n");
    check_runtime(&library, &["liblibrary.so", "is not ONNX Runtime"]);
}

#[test]
fn an_old_runtime_says_its_version() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let code = "static const char *version(void) { return \"1.20.1\"; }\n\
                static const void *api(unsigned v) { (void)v; return 0; }\n\
                static const struct { const void *(*api)(unsigned); const char *(*version)(void); } base = { api, version };\n\
                const void *OrtGetApiBase(void) { return &base; }\n";
    check_runtime(&library(folder.path(), code), &["version 1.20.1 is too old"]);
}

#[test]
fn a_process_keeps_its_runtime() {
    let Some(mut options) = tiny_options(&["dense.onnx"]) else { return };
    LearnedMatcher::load(&options).expect("the model fits");
    options.runtime = Some("/elsewhere/libonnxruntime.so".into());
    let message = LearnedMatcher::load(&options).expect_err("another runtime").to_string();
    check_sentence(
        &message,
        &["already uses ONNX Runtime from", "restart it to use /elsewhere/libonnxruntime.so"],
    );
}
