//! Bags that are damaged, foreign or incomplete: each is refused with a sentence that says why, and none by a panic.

use pelical::capture::recording::Recording;
use pelical::capture::{CaptureError, RgbdFrame};

use crate::bag_bytes::{
    Compression, Message, bag, chunk_record, file, file_naming, fixture, messages, record, text,
};
use crate::env::TestEnv;

const COLOR: &str = "/device_0/sensor_1/Color_0";
const DEPTH: &str = "/device_0/sensor_0/Depth_0";

fn wrap() -> Vec<Message> {
    messages(&fixture("single/wrap.bag"))
}

fn sdk_bytes() -> Vec<u8> {
    std::fs::read(fixture("single/wrap.bag")).unwrap()
}

/// Opens the bag and reads every frame.
fn read(bytes: &[u8]) -> Result<Vec<RgbdFrame>, CaptureError> {
    let env = TestEnv::new();
    let path = env.path("a.bag");
    std::fs::write(&path, bytes).unwrap();
    let recording = Recording::open(&path)?;
    let frame = |set: &Vec<_>| {
        let mut frame = RgbdFrame::default();
        recording.read_frame(0, set[0], &mut frame).map(|()| frame)
    };
    recording.frame_sets().iter().map(frame).collect()
}

#[track_caller]
fn check_refused(bytes: &[u8], words: &[&str]) {
    let message = read(bytes).expect_err("refused").to_string();
    for word in words.iter().chain(&["a.bag: "]) {
        assert!(message.contains(word), "{message:?} does not say {word:?}");
    }
}

/// All messages but those of one topic, in whose place others may stand.
fn with(topic: &str, change: impl Fn(&[u8]) -> Option<Vec<u8>>) -> Vec<u8> {
    let mut found = false;
    let changed = wrap().into_iter().filter_map(|(name, body)| {
        if name != topic {
            return Some((name, body));
        }
        found = true;
        change(&body).map(|body| (name, body))
    });
    let changed: Vec<Message> = changed.collect();
    assert!(found, "no message of {topic}");
    bag(&changed, Compression::Lz4)
}

/// The body of an image with another name of its encoding.
fn reencoded(body: &[u8], (before, after): (&str, &str)) -> Vec<u8> {
    let (before, after) = (text(before), text(after));
    let at = body.windows(before.len()).position(|window| window == before).unwrap();
    [&body[..at], &after, &body[at + before.len()..]].concat()
}

#[test]
fn what_is_put_together_again_is_what_was_taken_apart() {
    let original = read(&sdk_bytes()).unwrap();
    for compression in [Compression::None, Compression::Lz4] {
        let again = read(&bag(&wrap(), compression)).unwrap();
        assert_eq!(again.len(), original.len());
        assert!(
            again
                .iter()
                .zip(&original)
                .all(|(a, b)| a.rgb == b.rgb && a.depth == b.depth && a.stamp == b.stamp)
        );
    }
}

#[test]
fn files_that_are_no_bags_are_told_as_such() {
    check_refused(b"", &["is not a bag", "#ROSBAG V2.0"]);
    check_refused(b"junk, and more of it", &["is not a bag"]);
    check_refused(b"SQLite format 3\0 and tables", &[".db3"]);
    check_refused(&file(&[], &[]), &["holds nothing that a RealSense camera has recorded"]);
    check_refused(&bag(&[("/chatter".into(), vec![])], Compression::None), &["holds nothing"]);
}

#[test]
fn a_bag_cut_short_anywhere_is_refused() {
    let whole = sdk_bytes();
    for tenth in 0..40 {
        let len = whole.len() * tenth / 40;
        let error = read(&whole[..len]).expect_err("refused").to_string();
        assert!(error.contains("truncated") || error.contains("is not a bag"), "{len} bytes: {error}");
    }
}

#[test]
fn a_bag_whose_recorder_was_not_closed_is_told_how_to_be_repaired() {
    let mut bytes = sdk_bytes();
    let at = bytes.windows(10).position(|window| window == b"index_pos=").unwrap() + 10;
    bytes[at..at + 8].fill(0);
    check_refused(&bytes, &["not indexed", "rosbag reindex"]);
}

#[test]
fn chunks_that_would_fill_the_memory_are_refused_before_they_are_unpacked() {
    let zeros = vec![0; 100 << 20];
    check_refused(
        &file(&[chunk_record(&zeros, 100, Compression::Lz4)], &[]),
        &["damaged", "100 bytes are promised"],
    );
    check_refused(
        &file(&[chunk_record(b"", 0xFFFF_FFF0, Compression::None)], &[]),
        &["4294967280 bytes", "at most"],
    );
    let nested = chunk_record(&zeros, zeros.len(), Compression::Lz4);
    let what = ["neither a message nor a connection"];
    check_refused(&file(&[chunk_record(&nested, nested.len(), Compression::None)], &[]), &what);
    check_refused(
        &file(&[chunk_record(b"x", 1, Compression::Claimed("bz2"))], &[]),
        &["\"bz2\"", "none and lz4"],
    );
    check_refused(&file(&[chunk_record(b"x", 1, Compression::Claimed("lz4"))], &[]), &["damaged"]);
    check_refused(&file(&[record(&[("op", &[4])], b"")], &[]), &["kind 4"]);
}

/// So many images of no pixels, in one chunk.
fn empty_images(n: usize) -> Vec<u8> {
    let image = record(&[("op", &[2]), ("conn", &[0; 4]), ("time", &[1; 8])], &[0; 16]);
    chunk_record(&image.repeat(n), n * image.len(), Compression::Lz4)
}

#[test]
fn an_index_that_names_a_chunk_again_or_out_of_order_is_refused() {
    let topics = [&format!("{COLOR}/image/data")[..]];
    let chunk = empty_images(10_000);
    let next = chunk.len() as u64;
    let whole = file(&[chunk.clone(), chunk.clone()], &topics);
    check_refused(&whole, &["no colour images"]);
    for begins in [vec![0; 1000], vec![0, next, 0], vec![next, 0], vec![next, next]] {
        let bytes = file_naming(&begins, &[chunk.clone(), chunk.clone()], &topics);
        check_refused(&bytes, &["the index of the bag is damaged", "it names a chunk at byte"]);
    }
    // A message may hold anything, also what looks like a chunk.
    let outer =
        record(&[("op", &[2]), ("conn", &[0; 4]), ("time", &[1; 8])], &[&[0; 16], &chunk[..]].concat());
    let outer = chunk_record(&outer, outer.len(), Compression::None);
    let inner = (outer.len() - chunk.len()) as u64;
    check_refused(&file_naming(&[0, inner], &[outer], &topics), &["none can begin before"]);
}

#[test]
fn more_images_than_fit_into_the_memory_are_refused_however_small_their_file_is() {
    let topics = [&format!("{COLOR}/image/data")[..]];
    let bytes = file(&vec![empty_images(1_000_000); 5], &topics);
    assert!(bytes.len() < 2 << 20, "{} bytes", bytes.len());
    check_refused(&bytes, &["more than 4000000 images and samples", "rosbag filter"]);
}

#[test]
fn a_serial_number_without_end_is_refused() {
    let long = |body: &[u8]| {
        let is_serial = body.windows(13).any(|window| window == b"Serial Number");
        Some(if is_serial { [text("Serial Number"), text(&"7".repeat(300))].concat() } else { body.to_vec() })
    };
    check_refused(&with("/device_0/info", long), &["Serial Number", "300 bytes", "at most 256"]);
}

#[test]
fn a_camera_that_does_not_say_what_is_needed_is_refused() {
    let gone = |_: &[u8]| None;
    check_refused(&with(&format!("{COLOR}/image/data"), gone), &["\"a\"", "no colour images"]);
    check_refused(&with(&format!("{DEPTH}/info/camera_info"), gone), &["no depth images"]);
    check_refused(&with("/device_0/sensor_0/option/Depth_Units/value", gone), &["depth unit"]);
    check_refused(&with(&format!("{DEPTH}/tf/1"), gone), &["extrinsics"]);
    let zero = |_: &[u8]| Some(0.0_f32.to_le_bytes().to_vec());
    check_refused(&with("/device_0/sensor_0/option/Depth_Units/value", zero), &["depth unit of 0"]);
    let far = |body: &[u8]| Some([&3.0_f64.to_le_bytes()[..], &body[8..]].concat());
    check_refused(&with(&format!("{COLOR}/tf/1"), far), &["share a housing"]);
    let nan = |body: &[u8]| Some([&f64::NAN.to_le_bytes()[..], &body[8..]].concat());
    check_refused(&with(&format!("{COLOR}/tf/1"), nan), &["no motion"]);
    let lens = |body: &[u8]| Some(reencoded(body, ("Inverse Brown Conrady", "Kannala Brandt4")));
    let foreign = |body: &[u8]| Some(reencoded(body, ("Inverse Brown Conrady", "equidistant")));
    check_refused(&with(&format!("{COLOR}/info/camera_info"), foreign), &["\"equidistant\"", "allowed"]);
    check_refused(&with(&format!("{COLOR}/info/camera_info"), lens), &["kannala_brandt4", "supported"]);
}

#[test]
fn images_that_are_not_what_was_promised_are_refused() {
    let data = format!("{COLOR}/image/data");
    check_refused(&with(&data, |body| Some(body[..100].to_vec())), &["cut short"]);
    check_refused(&with(&data, |body| Some(body[..7].to_vec())), &["cut short"]);
    check_refused(&with(&data, |body| Some(reencoded(body, ("bgr8", "jpeg")))), &["\"jpeg\"", "rgb8"]);
    check_refused(&with(&data, |body| Some(reencoded(body, ("bgr8", "bgra8")))), &["needed for each row"]);
    let depth = format!("{DEPTH}/image/data");
    check_refused(
        &with(&depth, |body| Some(reencoded(body, ("mono16", "rgb8")))),
        &["depth is stored as \"rgb8\""],
    );
    let info = format!("{COLOR}/info/camera_info");
    let wider = |body: &[u8]| Some([&body[..20], &50_u32.to_le_bytes()[..], &body[24..]].concat());
    check_refused(&with(&info, wider), &["48 x 32 px", "50 x 32"]);
}

#[test]
fn colour_in_other_layouts_becomes_the_same_rgb() {
    let data = format!("{COLOR}/image/data");
    let original = read(&sdk_bytes()).unwrap();
    // A gray ramp: every layout can hold it, chroma at its middle.
    let gray = |pixel: usize| (16 + pixel % 200) as u8;
    let image = |encoding: &str, bytes: usize, pixels: &dyn Fn(usize) -> Vec<u8>| {
        // Rows with a gap behind them.
        let stride = 48 * bytes + 6;
        let rows = (0..32).flat_map(|row| {
            let row: Vec<u8> = (0..48).flat_map(|column| pixels(48 * row + column)).collect();
            [row, vec![9; 6]].concat()
        });
        let rows: Vec<u8> = rows.collect();
        let tail = [
            &text(encoding)[..],
            &[0],
            &(stride as u32).to_le_bytes(),
            &(rows.len() as u32).to_le_bytes(),
            &rows,
        ]
        .concat();
        with(&data, |body| Some([&body[..25], &tail].concat()))
    };
    let luma = |pixel: usize| ((298 * (i32::from(gray(pixel)) - 16) + 128) >> 8).clamp(0, 255) as u8;
    for (bytes, expected) in [
        (image("rgb8", 3, &|pixel| vec![gray(pixel), 1, 2]), [gray(7), 1, 2]),
        (image("bgra8", 4, &|pixel| vec![2, 1, gray(pixel), 255]), [gray(7), 1, 2]),
        (image("rgba8", 4, &|pixel| vec![gray(pixel), 1, 2, 255]), [gray(7), 1, 2]),
        (image("YUYV", 2, &|pixel| vec![gray(pixel), 128]), [luma(7); 3]),
        (image("yuv422", 2, &|pixel| vec![128, gray(pixel)]), [luma(7); 3]),
    ] {
        let frames = read(&bytes).unwrap();
        assert_eq!((frames.len(), &frames[0].rgb[21..24]), (original.len(), &expected[..]));
    }
}

#[test]
fn cameras_whose_own_clocks_differ_are_brought_together_by_when_their_frames_arrived() {
    let later = |(topic, mut body): Message| {
        if topic.ends_with("/data") {
            let seconds = u32::from_le_bytes(body[4..8].try_into().unwrap());
            // Another power-up: 1000 s less on the clock.
            body[4..8].copy_from_slice(&(seconds.max(1000) - 1000).to_le_bytes());
        }
        let body = if topic == "/device_0/info" { reencoded(&body, ("7", "8")) } else { body };
        (topic.replace("/device_0", "/device_1"), body)
    };
    // Before the wrap, so that the clock of the second camera does not wrap.
    let before_wrap: Vec<Message> = wrap().into_iter().filter(|(_, body)| !begins_at_zero(body)).collect();
    let second = before_wrap.clone().into_iter().filter(|(topic, body)| {
        topic != "/device_0/info" || body.windows(13).any(|window| window == b"Serial Number")
    });
    let both: Vec<Message> = before_wrap.iter().cloned().chain(second.map(later)).collect();
    let env = TestEnv::new();
    std::fs::write(env.path("both.bag"), bag(&both, Compression::None)).unwrap();
    let recording = Recording::open(&env.path("both.bag")).unwrap();
    assert_eq!(recording.frame_sets().len(), 3);
    for set in recording.frame_sets() {
        assert!(set[0].0.abs_diff(set[1].0) < 1_000_000, "{set:?}");
    }
}

/// Whether a stamped message was taken right after the wrap.
fn begins_at_zero(body: &[u8]) -> bool {
    body.len() > 300 && body[4..8] == [0; 4] && body[8..12] != [0; 4]
}

#[test]
fn bags_that_do_not_belong_together_are_refused() {
    let [left, wrap] = ["pair/left.bag", "single/wrap.bag"].map(fixture);
    let env = TestEnv::new();
    let copy = env.path("copy.bag");
    std::fs::copy(&left, &copy).unwrap();
    for again in [&left, &copy] {
        let message = Recording::open_all(&[&left, again]).expect_err("refused").to_string();
        let sentence =
            format!("{}: is the same file as {}, or of the same camera", again.display(), left.display());
        assert!(message.starts_with(&sentence), "{message}");
    }
    let message =
        Recording::open_all(&[&left, &fixture("pair/expected.json")]).expect_err("refused").to_string();
    assert!(message.contains("is no .bag file"), "{message}");
    let mut shifted = messages(&wrap);
    // No domain, so no clock of its own: stamps as they are.
    shifted.retain(|(topic, _)| !topic.ends_with("metadata"));
    std::fs::write(env.path("b.bag"), bag(&shifted, Compression::None)).unwrap();
    let message = Recording::open_all(&[left, env.path("b.bag")]).expect_err("refused").to_string();
    assert!(message.contains("no moment in common"), "{message}");
}
