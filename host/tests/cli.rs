//! What the command line prints, and where.

use serde_json::Value;
use std::fs;
use std::process::{Command, Output};

fn rugosa(arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_rugosa"))
        .args(arguments)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_slice(&rugosa(arguments).stdout).unwrap()
}

#[test]
fn info_describes_points_and_rasters() {
    let directory = tempfile::tempdir().unwrap();
    let points = directory.path().join("a.csv");
    fs::write(&points, "0,0,1\n2,0,1\n0,3,inf\n2,4,5\n").unwrap();
    let report = json(&["info", points.to_str().unwrap(), "--json"]);
    assert_eq!(report["kind"], "points");
    assert_eq!(
        (&report["points"], &report["skipped"]),
        (&3.into(), &1.into())
    );
    assert_eq!(report["max_m"], serde_json::json!([2.0, 4.0, 5.0]));
    let raster = directory.path().join("a.asc");
    fs::write(
        &raster,
        "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 2\n1 2\n3 nan\n",
    )
    .unwrap();
    let report = json(&["--json", "info", raster.to_str().unwrap()]);
    assert_eq!(
        (&report["kind"], &report["known"]),
        (&"raster".into(), &3.into())
    );
}

#[test]
fn every_command_has_help_with_examples() {
    let help = String::from_utf8(rugosa(&["--help"]).stdout).unwrap();
    assert!(help.contains("Exit codes"));
    let commands = help
        .split("Commands:")
        .nth(1)
        .unwrap()
        .split("Options:")
        .next()
        .unwrap();
    let names: Vec<&str> = commands
        .lines()
        .filter_map(|l| l.split_whitespace().next())
        .collect();
    assert!(names.len() > 4);
    for name in names.into_iter().filter(|&n| n != "help") {
        let help = String::from_utf8(rugosa(&[name, "--help"]).stdout).unwrap();
        assert!(help.contains("Examples:"), "{name} has no examples");
        assert!(!help.contains('\u{1b}'), "{name}: colours in a pipe");
    }
}

#[test]
fn pages_and_completions_name_every_command() {
    let directory = tempfile::tempdir().unwrap();
    let pages = json(&["man", "--out", directory.path().to_str().unwrap(), "--json"]);
    let files = pages["files"].as_array().unwrap();
    assert!(files.len() > 5);
    let info = fs::read_to_string(directory.path().join("rugosa-info.1")).unwrap();
    assert!(info.contains("spacing"));
    for shell in ["bash", "zsh", "fish"] {
        let script = String::from_utf8(rugosa(&["completions", shell]).stdout).unwrap();
        assert!(
            script.contains("doctor") && script.contains("spacing"),
            "{shell}"
        );
    }
}

#[test]
fn the_printed_configuration_can_be_read_back() {
    let text = rugosa(&["config"]).stdout;
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("rugosa.toml");
    fs::write(&path, &text).unwrap();
    assert_eq!(rugosa(&["config", path.to_str().unwrap()]).stdout, text);
}

#[test]
fn doctor_tells_versions() {
    let report = json(&["doctor", "--json"]);
    assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(report["tools"].as_array().unwrap().len(), 4);
}
