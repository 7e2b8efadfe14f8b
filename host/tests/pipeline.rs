//! The whole way, with the command's own parts: simulated scanner → virtual port →
//! recording and map → replay.

use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

fn rugosa(directory: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rugosa"));
    command.current_dir(directory).stdin(Stdio::null());
    command
}

fn json(directory: &Path, arguments: &[&str]) -> Value {
    let output = rugosa(directory)
        .args(arguments)
        .arg("--json")
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

fn in_directory(test: impl Fn(&Path)) {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("small.toml"), "side = 129\n").unwrap();
    test(directory.path());
}

fn wait_for(path: &Path) {
    let start = Instant::now();
    while !path.exists() {
        assert!(
            start.elapsed() < Duration::from_secs(60),
            "{} does not appear",
            path.display()
        );
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn simulate(directory: &Path) -> Child {
    let arguments = [
        "simulate",
        "--virtual",
        "scanner",
        "--sweeps",
        "2",
        "--speed",
        "0",
        "--quiet",
    ];
    let child = rugosa(directory)
        .args(arguments)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    wait_for(&directory.join("scanner"));
    child
}

#[test]
fn the_demo_gives_maps_and_a_complete_summary() {
    in_directory(|directory| {
        let printed = json(
            directory,
            &[
                "demo",
                "--sweeps",
                "3",
                "--config",
                "small.toml",
                "--out",
                "map",
            ],
        );
        let saved: Value =
            serde_json::from_slice(&fs::read(directory.join("map/summary.json")).unwrap()).unwrap();
        assert_eq!(saved["estimate"], printed["estimate"]);
        assert_eq!(
            saved["truth"],
            serde_json::json!({ "dimension": 2.3, "sigma": 0.08 })
        );
        let dimension = saved["estimate"]["dimension"].as_f64().unwrap();
        assert!((2.1..2.5).contains(&dimension), "D = {dimension}");
        for key in ["hurst", "sigma", "standard_error"] {
            assert!(saved["estimate"][key].as_f64().unwrap() > 0.0, "{key}");
        }
        let lines = serde_json::json!({ "sent": 768, "received": 768, "lost": 0, "rejected": 0 });
        assert_eq!((&saved["lines"], &saved["sweeps"]), (&lines, &3.into()));
        let by_cause = saved["returns"]["by_cause"].as_object().unwrap();
        let others: u64 = by_cause.values().map(|v| v.as_u64().unwrap()).sum();
        assert_eq!(
            saved["returns"]["used"].as_u64().unwrap() + others,
            3 * 256 * 256
        );
        assert_eq!(saved["cells"]["total"], 129 * 129);
        assert!(saved["cells"]["measured"].as_u64().unwrap() > 1000);
        assert!(saved["seconds"].as_f64().unwrap() > 0.0);
        for file in [
            "elevation.npy",
            "dimension.npy",
            "sigma.npy",
            "elevation.png",
            "maps.png",
            "structure_function.png",
        ] {
            assert!(directory.join("map").join(file).is_file(), "{file}");
        }
    });
}

#[test]
fn losses_on_the_cable_are_counted() {
    in_directory(|directory| {
        let arguments = [
            "demo",
            "--sweeps",
            "2",
            "--bit-error-rate",
            "3e-5",
            "--config",
            "small.toml",
            "--out",
            "a.json",
        ];
        let summary = json(directory, &arguments);
        let count = |key: &str| summary["lines"][key].as_u64().unwrap();
        assert!(count("lost") > 0, "no line was lost");
        assert_eq!(count("sent"), count("received") + count("lost"));
        assert!(summary["counters"]["link.bad_crc"].as_u64().unwrap() > 0);
    });
}

#[test]
fn a_recording_gives_the_same_map_as_the_scan_it_was_made_in() {
    in_directory(|directory| {
        let mut scanner = simulate(directory);
        let arguments = [
            "scan",
            "--port",
            "scanner",
            "--sweeps",
            "2",
            "--record",
            "run.mcap",
            "--config",
            "small.toml",
            "--out",
            "first",
        ];
        let scanned = json(directory, &arguments);
        scanner.wait().unwrap();
        let replayed = json(
            directory,
            &[
                "replay",
                "run.mcap",
                "--config",
                "small.toml",
                "--out",
                "second",
            ],
        );
        for key in ["estimate", "lines", "returns", "cells", "sweeps"] {
            assert_eq!(scanned[key], replayed[key], "{key}");
        }
        let map = |name: &str| fs::read(directory.join(name).join("elevation.npy")).unwrap();
        assert!(map("first") == map("second"), "the maps differ");
        // an existing recording is not overwritten
        let again = rugosa(directory)
            .args(["record", "--port", "scanner", "--out", "run.mcap"])
            .output()
            .unwrap();
        assert_eq!(again.status.code(), Some(2));
    });
}

#[test]
fn a_recording_can_be_played_into_a_port() {
    in_directory(|directory| {
        let mut scanner = simulate(directory);
        let recorded = json(
            directory,
            &[
                "record", "--port", "scanner", "--sweeps", "2", "--out", "run.mcap",
            ],
        );
        scanner.wait().unwrap();
        assert_eq!(recorded["lines"], 512);
        let arguments = [
            "replay",
            "run.mcap",
            "--virtual",
            "again",
            "--speed",
            "0",
            "--quiet",
        ];
        let mut player = rugosa(directory)
            .args(arguments)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        wait_for(&directory.join("again"));
        let summary = json(
            directory,
            &[
                "scan",
                "--port",
                "again",
                "--sweeps",
                "2",
                "--config",
                "small.toml",
            ],
        );
        assert!(player.wait().unwrap().success());
        assert_eq!(summary["lines"]["received"], 512);
        assert_eq!(summary["lines"]["rejected"], 0);
    });
}

#[cfg(unix)]
#[test]
fn an_interrupted_demo_saves_what_there_is() {
    in_directory(|directory| {
        let arguments = [
            "demo",
            "--sweeps",
            "1000",
            "--speed",
            "1",
            "--config",
            "small.toml",
            "--record",
            "run.mcap",
            "--out",
            "map",
            "--json",
        ];
        let mut child = rugosa(directory)
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        wait_for(&directory.join("run.mcap"));
        std::thread::sleep(Duration::from_secs(4));
        let killed = Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status()
            .unwrap();
        assert!(killed.success());
        assert!(child.wait().unwrap().success());
        let summary: Value =
            serde_json::from_slice(&fs::read(directory.join("map/summary.json")).unwrap()).unwrap();
        assert!(summary["lines"]["received"].as_u64().unwrap() > 0);
        assert_eq!(summary["lines"]["lost"], 0);
        json(
            directory,
            &[
                "replay",
                "run.mcap",
                "--config",
                "small.toml",
                "--out",
                "a.json",
            ],
        );
    });
}
