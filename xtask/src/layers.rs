//! The one-way order of the crates, held against `cargo metadata`.

use crate::steps::Outcome;
use anyhow::{Context, Result, bail};
use serde_json::Value;
use std::process::Command;

/// Each crate and the crates of ours that it may use (tests and benchmarks included).
const ALLOWED: &[(&str, &[&str])] = &[
    ("rugosa-wire", &[]),
    ("rugosa-grid", &[]),
    ("rugosa-terrain", &["rugosa-grid"]),
    ("rugosa-fractal", &["rugosa-grid"]),
    (
        "rugosa",
        &[
            "rugosa-wire",
            "rugosa-grid",
            "rugosa-terrain",
            "rugosa-fractal",
        ],
    ),
    // the simulator has its own beam geometry, so that a sign error cannot cancel itself
    ("rugosa-hil-sim", &["rugosa-wire", "rugosa-fractal"]),
    (
        "rugosa-hil",
        &[
            "rugosa",
            "rugosa-wire",
            "rugosa-grid",
            "rugosa-hil-sim",
            "rugosa-numerics",
        ],
    ),
    (
        "rugosa-host",
        &[
            "rugosa-hil",
            "rugosa",
            "rugosa-wire",
            "rugosa-grid",
            "rugosa-terrain",
            "rugosa-fractal",
            "rugosa-hil-sim",
        ],
    ),
    (
        "rugosa-tests",
        &[
            "rugosa-hil",
            "rugosa",
            "rugosa-wire",
            "rugosa-grid",
            "rugosa-terrain",
            "rugosa-fractal",
            "rugosa-hil-sim",
            "rugosa-host",
        ],
    ),
    ("xtask", &[]),
];

/// Checks the arrows between the crates and the promises at the top of the core crates.
pub fn check() -> Result<Outcome> {
    let metadata = metadata()?;
    let packages = metadata["packages"].as_array().context("no packages")?;
    let mut faults = Vec::new();
    for package in packages {
        faults.extend(forbidden_arrows(package));
        faults.extend(broken_promises(package)?);
    }
    if !faults.is_empty() {
        bail!("{}", faults.join("; "));
    }
    eprintln!("{} crates, every arrow points down", packages.len());
    Ok(Outcome::Passed)
}

fn metadata() -> Result<Value> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .output()?;
    if !output.status.success() {
        bail!(
            "cargo metadata: {}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

fn forbidden_arrows(package: &Value) -> Vec<String> {
    let name = text(package, "name");
    let Some((_, allowed)) = ALLOWED.iter().find(|(n, _)| *n == name) else {
        return vec![format!("{name} has no place in the order of the crates")];
    };
    let dependencies = package["dependencies"].as_array().into_iter().flatten();
    dependencies
        .map(|d| text(d, "name"))
        .filter(|d| ALLOWED.iter().any(|(n, _)| n == d) && !allowed.contains(d))
        .map(|d| format!("{name} must not depend on {d}"))
        .collect()
}

/// The core is `no_std` and has no `unsafe`.
fn broken_promises(package: &Value) -> Result<Vec<String>> {
    let manifest = text(package, "manifest_path");
    if !manifest.contains("/crates/") {
        return Ok(Vec::new());
    }
    let library = manifest.replace("Cargo.toml", "src/lib.rs");
    let source = std::fs::read_to_string(&library).with_context(|| library.clone())?;
    Ok(["#![no_std]", "#![forbid(unsafe_code)]"]
        .iter()
        .filter(|promise| !source.contains(**promise))
        .map(|promise| format!("{library} lacks {promise}"))
        .collect())
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_default()
}
