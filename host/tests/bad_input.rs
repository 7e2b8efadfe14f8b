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
