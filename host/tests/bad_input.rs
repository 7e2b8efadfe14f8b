//! Bad input: exit code 2, one line on standard error, nothing on standard output, and
//! what was there before is still there.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn rugosa(arguments: &[&str], directory: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rugosa"));
    command
        .args(arguments)
        .current_dir(directory)
        .output()
        .unwrap()
}

/// Runs the command in a directory with these files and checks the refusal.
fn refused(files: &[(&str, &[u8])], arguments: &[&str], expected: &str) {
    let directory = tempfile::tempdir().unwrap();
    for (name, content) in files {
        fs::write(directory.path().join(name), content).unwrap();
    }
    let output = rugosa(arguments, directory.path());
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
    assert_eq!(error.lines().count(), 1, "{arguments:?}: {error}");
    assert!(error.contains(expected), "{arguments:?}: {error}");
    assert!(output.stdout.is_empty());
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), files.len());
    for (name, content) in files {
        assert_eq!(&fs::read(directory.path().join(name)).unwrap(), content);
    }
}

#[test]
fn files_that_cannot_be_read() {
    refused(&[], &["info", "missing.csv"], "missing.csv: No such file");
    refused(&[], &["info", "."], "without an extension");
    refused(
        &[("a.gif", b"GIF89a")],
        &["info", "a.gif"],
        "unknown file type '.gif'",
    );
    refused(
        &[("a.csv", b"")],
        &["info", "a.csv"],
        "a.csv: holds no points",
    );
    refused(
        &[("a.csv", b"1,2,3\n1,2\n")],
        &["info", "a.csv"],
        "a.csv:2: field z is missing",
    );
    refused(
        &[("a.xyz", b"1 2 3\n1 2 \xff\n")],
        &["info", "a.xyz"],
        "a.xyz",
    );
    refused(
        &[("a.xyz", b"nan nan nan\n")],
        &["info", "a.xyz"],
        "not finite",
    );
    refused(
        &[("a.npy", b"\x93NUMPY\x01\x00")],
        &["info", "a.npy"],
        "a.npy",
    );
    refused(
        &[("a.ply", b"ply\nformat ascii 1.0\n")],
        &["info", "a.ply"],
        "a.ply",
    );
    refused(
        &[("a.asc", b"ncols 2\nnrows -3\n")],
        &["info", "a.asc"],
        "a.asc",
    );
}

#[test]
fn configurations_that_cannot_be() {
    refused(
        &[("a.toml", b"gate = -1\n")],
        &["config", "a.toml"],
        "a.toml:1: gate = -1",
    );
    refused(
        &[("a.toml", b"\ngaet = 1\n")],
        &["config", "a.toml"],
        "a.toml:2: unknown parameter 'gaet'",
    );
}

#[test]
fn usage_errors_have_the_same_exit_code() {
    let directory = tempfile::tempdir().unwrap();
    for arguments in [
        &["nonsense"][..],
        &["info"],
        &["info", "a.npy", "--spacing", "-1"],
    ] {
        assert_eq!(
            rugosa(arguments, directory.path()).status.code(),
            Some(2),
            "{arguments:?}"
        );
    }
}

#[test]
fn recordings_and_ports_that_are_none() {
    refused(
        &[],
        &["replay", "missing.mcap"],
        "missing.mcap: No such file",
    );
    refused(
        &[("a.mcap", b"not a recording")],
        &["replay", "a.mcap"],
        "a.mcap: not an MCAP file",
    );
    refused(&[], &["scan", "--port", "nowhere"], "nowhere: no such port");
    refused(
        &[],
        &["scan", "--port", "nowhere", "--baud", "7"],
        "baud rate 7",
    );
    refused(&[], &["demo", "--dimension", "3.5"], "dimension is 3.5");
    refused(&[], &["demo", "--out", "a.gif"], "unknown file type");
    refused(
        &[("a.toml", b"side = 7")],
        &["demo", "--config", "a.toml"],
        "a.toml:1: side = 7",
    );
    refused(
        &[],
        &["simulate", "--port", "nowhere", "--speed=-1"],
        "--speed -1",
    );
}

#[test]
fn dimensions_of_nothing() {
    refused(
        &[("a.csv", b"1,2,3\n")],
        &["dimension", "a.csv", "--min-lag", "3", "--max-lag", "2"],
        "--max-lag 2",
    );
    refused(
        &[("a.csv", b"1,2,3\n")],
        &["dimension", "a.csv", "--out", "a.npy"],
        "unknown file type",
    );
    refused(
        &[("a.csv", b"x,y,z\n1,2,e\n")],
        &["dimension", "a.csv"],
        "a.csv:2: field z",
    );
}

#[test]
fn maps_of_nothing() {
    refused(
        &[("a.csv", b"1,2,3\n")],
        &["map", "a.csv", "--out", "a.csv"],
        "is a file",
    );
    refused(
        &[("a.csv", b"0,0,0\n9999,9999,1\n")],
        &["map", "a.csv", "--out", "m", "--resolution", "1"],
        "greater --resolution",
    );
    refused(
        &[("a.csv", b"nan,0,0\n")],
        &["map", "a.csv", "--out", "m"],
        "not finite",
    );
}

#[test]
fn files_of_every_kind_that_are_empty_or_something_else() {
    for name in [
        "a.csv", "a.xyz", "a.ply", "a.pcd", "a.las", "a.laz", "a.mcap", "a.npy", "a.npz", "a.asc",
        "a.tif", "a.perc",
    ] {
        for content in [&b""[..], b"\0", b"rubbish, and more of it\n\n\0\xff\xfe"] {
            refused(&[(name, content)], &["map", name, "--out", "m"], name);
        }
    }
    let huge_pcd = b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 900000000000\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 900000000000\nDATA binary\n1234";
    refused(&[("a.pcd", huge_pcd)], &["info", "a.pcd"], "do not fit");
    let huge_image = b"rows: 4096\ncolumns: 4096\n";
    refused(&[("b.perc", huge_image)], &["info", "b.perc"], "do not fit");
}

#[test]
fn saved_maps_that_are_none() {
    let csv = ("a.csv", &b"0,0,0\n1,1,1\n"[..]);
    let map = ("a.rugosa", &b"PK\x03\x04 and then nothing"[..]);
    for arguments in [
        &["map", "a.rugosa", "--out", "m"][..],
        &["info", "a.rugosa"],
    ] {
        refused(&[map], arguments, "a.rugosa: cut short");
    }
    refused(&[], &["info", "a.rugosa"], "a.rugosa: No such file");
    refused(
        &[map],
        &["merge", "a.rugosa", "--out", "b.rugosa"],
        "a.rugosa",
    );
    refused(
        &[map],
        &["merge", "a.rugosa", "--out", "b.npz"],
        "ends in .rugosa",
    );
    refused(
        &[csv, map],
        &["map", "a.csv", "a.rugosa", "--out", "m"],
        "cannot be mapped together",
    );
    refused(
        &[csv],
        &["map", "a.csv", "--crop", "0,0,1,1", "--out", "m"],
        "--crop is for saved maps",
    );
    refused(
        &[map],
        &["demo", "--resume", "a.rugosa", "--out", "m"],
        "a.rugosa",
    );
}

#[test]
fn a_report_needs_a_directory() {
    refused(
        &[],
        &["demo", "--report", "--out", "a.json"],
        "--out must be a directory",
    );
    refused(
        &[("a.mcap", b"")],
        &["replay", "a.mcap", "--report"],
        "--out DIR is needed",
    );
}

/// What was there before a command failed is there afterwards, byte for byte.
#[test]
fn a_failure_leaves_former_results_alone() {
    let directory = tempfile::tempdir().unwrap();
    let points: String = (0..400)
        .map(|i| format!("{},{},{}\n", i % 20, i / 20, i % 3))
        .collect();
    fs::write(directory.path().join("a.csv"), &points).unwrap();
    let export = ["--export", "npy,mcap,nav2,rugosa", "--quiet"];
    let map = |file: &str| {
        let command = [&["map", file, "--out", "m"][..], &export].concat();
        rugosa(&command, directory.path())
    };
    assert!(map("a.csv").status.success());
    let all = || {
        let entries = fs::read_dir(directory.path().join("m")).unwrap();
        let mut files: Vec<_> = entries
            .map(|e| e.unwrap().path())
            .map(|path| (path.clone(), fs::read(path).unwrap()))
            .collect();
        files.sort();
        files
    };
    let before = all();
    assert!(before.len() > 20);
    fs::write(directory.path().join("b.csv"), points + "1,2\n").unwrap();
    assert_eq!(map("b.csv").status.code(), Some(2));
    assert_eq!(map("missing.csv").status.code(), Some(2));
    assert!(all() == before);
}
