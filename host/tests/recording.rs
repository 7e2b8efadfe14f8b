//! Recordings: complete, cut at any byte, damaged, foreign.

use rugosa_host::error::Kind;
use rugosa_host::recording::{Ending, Entry, Recorder, Recording};
use rugosa_wire::*;
use std::fs;
use std::path::{Path, PathBuf};

fn frame(i: u16) -> Frame {
    let message = match i % 4 {
        0 => Message::Pose(PoseStamp {
            stamp_us: u64::from(i) * 100,
            position_m: [i.into(), 0.5, -1.0],
            orientation: [0.0, 0.0, 0.0, 1.0],
        }),
        1 => Message::Refresh,
        _ => Message::Line(ScanLine {
            sweep: 3,
            line: i,
            first_column: 0,
            stamp_us: u64::from(i) * 100,
            returns: 200,
            packing: Packing::Bits12,
            ranges: Packing::Bits12
                .pack((0..200).map(|k| k * 97 + i * 31))
                .unwrap(),
            reflectances: Default::default(),
        }),
    };
    let header = Header {
        session: 77,
        sequence: i,
    };
    Frame { header, message }
}

/// A recording of 400 messages in five chunks; the file is left as a killed writer
/// leaves it where `is_complete` is false.
fn record(folder: &Path, is_complete: bool) -> PathBuf {
    let path = folder.join("recording.mcap");
    let mut recorder = Recorder::create(&path).unwrap();
    for i in 0..400 {
        recorder
            .record(Role::Scanner, u64::from(i) * 10, &frame(i))
            .unwrap();
        if i % 80 == 79 {
            recorder.flush().unwrap();
        }
    }
    if is_complete {
        recorder.finish().unwrap();
    } else {
        std::mem::forget(recorder);
    }
    path
}

fn check(entries: &[Entry]) {
    for (i, entry) in entries.iter().enumerate() {
        let i = i as u16;
        assert_eq!(entry.frame, frame(i));
        assert_eq!(
            (entry.from, entry.time_us),
            (Role::Scanner, u64::from(i) * 10)
        );
        let again = Decoder::new().pull(&mut &entry.bytes[..]);
        assert_eq!(again, Some(Ok(frame(i))));
    }
}

fn read(path: &Path) -> (Vec<Entry>, Recording) {
    let mut recording = Recording::open(path).unwrap();
    let entries = recording.by_ref().map(|e| e.unwrap()).collect();
    (entries, recording)
}

#[test]
fn a_recording_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let (entries, recording) = read(&record(folder.path(), true));
    assert_eq!((entries.len(), recording.foreign()), (400, 0));
    assert_eq!(recording.ending(), Some(Ending::Complete));
    check(&entries);
}

#[test]
fn other_readers_find_topics_times_and_the_schema() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(record(folder.path(), true)).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let mut topics: Vec<_> = summary.channels.values().map(|c| c.topic.clone()).collect();
    topics.sort();
    assert_eq!(
        topics,
        ["/scanner/line", "/scanner/pose", "/scanner/refresh"]
    );
    let schema = summary.schemas.values().next().unwrap();
    assert_eq!(
        (&schema.name[..], &schema.data[..]),
        ("rugosa.wire.v1", SCHEMA.as_bytes())
    );
    let third = mcap::MessageStream::new(&bytes)
        .unwrap()
        .nth(2)
        .unwrap()
        .unwrap();
    assert_eq!((third.log_time, third.publish_time), (20_000, 200_000));
}

#[test]
fn a_killed_recording_is_readable_up_to_its_last_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let (entries, recording) = read(&record(folder.path(), false));
    assert_eq!(entries.len(), 400);
    assert!(matches!(recording.ending(), Some(Ending::Truncated { .. })));
    check(&entries);
}

#[test]
fn a_recording_cut_anywhere_gives_whole_chunks() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(record(folder.path(), false)).unwrap();
    let path = folder.path().join("cut.mcap");
    let mut seen = Vec::new();
    for length in (8..bytes.len()).step_by(97) {
        fs::write(&path, &bytes[..length]).unwrap();
        let (entries, recording) = read(&path);
        let length = length as u64;
        assert_eq!(recording.ending(), Some(Ending::Truncated { length }));
        assert_eq!(entries.len() % 80, 0);
        check(&entries);
        seen.push(entries.len());
    }
    assert!(seen.is_sorted() && seen.contains(&0) && seen.contains(&320));
}

#[test]
fn damage_is_one_error_that_names_file_and_byte() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(record(folder.path(), true)).unwrap();
    let path = folder.path().join("damaged.mcap");
    let mut errors = 0;
    for at in (8..bytes.len()).step_by(101) {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x40;
        fs::write(&path, &bytes).unwrap();
        let results: Vec<_> = Recording::open(&path).unwrap().collect();
        let good: Vec<_> = results.iter().filter_map(|r| r.clone().ok()).collect();
        check(&good[..good.len().min(80)]);
        if let Some(Err(failure)) = results.last() {
            assert_eq!(failure.kind, Kind::Input);
            assert!(failure.message.contains("damaged.mcap"), "{failure}");
            errors += 1;
        }
        assert!(results.iter().filter(|r| r.is_err()).count() <= 1);
    }
    assert!(errors > 10, "{errors}");
}

#[test]
fn what_is_no_recording_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    let missing = Recording::open(&path).err().unwrap();
    assert!(missing.message.contains("x.mcap") && missing.kind == Kind::Input);
    for content in [&b""[..], b"x,y,z\n1,2,3\n"] {
        fs::write(&path, content).unwrap();
        let failure = Recording::open(&path).err().unwrap();
        assert!(failure.message.ends_with("not an MCAP file"));
    }
}

#[test]
fn foreign_messages_are_skipped_and_alone_they_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.mcap");
    let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let channel = writer
        .add_channel(0, "/imu", "json", &Default::default())
        .unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    let results: Vec<_> = Recording::open(&path).unwrap().collect();
    let [Err(failure)] = &results[..] else {
        panic!("{results:?}");
    };
    assert!(failure.message.contains("no messages of rugosa"));
}

#[test]
fn the_types_of_another_version_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.mcap");
    let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let schema = writer
        .add_schema("rugosa.wire.v1", "rugosa", b"other")
        .unwrap();
    let channel = writer.add_channel(
        schema,
        "/scanner/line",
        "cobs-postcard",
        &Default::default(),
    );
    let header = mcap::records::MessageHeader {
        channel_id: channel.unwrap(),
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    writer.write_to_known_channel(&header, &[0]).unwrap();
    writer.finish().unwrap();
    let failure = Recording::open(&path).unwrap().next().unwrap().unwrap_err();
    assert!(
        failure.message.contains("another version of rugosa"),
        "{failure}"
    );
}

#[test]
fn a_recording_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), true);
    let before = fs::read(&path).unwrap();
    let failure = Recorder::create(&path).err().unwrap();
    assert!(failure.message.contains("exists already"));
    assert_eq!(fs::read(&path).unwrap(), before);
}

#[test]
fn a_folder_that_does_not_exist_is_one_clear_error() {
    let failure = Recorder::create(Path::new("/no/such/folder/x.mcap"));
    let failure = failure.err().unwrap();
    assert_eq!(failure.kind, Kind::Runtime);
    assert!(
        failure
            .message
            .starts_with("cannot write /no/such/folder/x.mcap")
    );
}
