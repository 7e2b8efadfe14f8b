//! The steps and what becomes of them.

use crate::{bare_metal, layers};
use anyhow::{Context, Result, bail};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// What became of a step that did not fail.
pub enum Outcome {
    /// it passed
    Passed,
    /// it could not be tried, and why
    Skipped(String),
}

/// One step of the test command.
pub struct Step {
    name: &'static str,
    run: fn() -> Result<Outcome>,
}

const STEPS: &[Step] = &[
    Step {
        name: "fmt",
        run: fmt,
    },
    Step {
        name: "lint",
        run: lint,
    },
    Step {
        name: "layers",
        run: layers::check,
    },
    Step {
        name: "unit",
        run: unit,
    },
    Step {
        name: "doc",
        run: doc,
    },
    Step {
        name: "bare-metal",
        run: bare_metal::step,
    },
    Step {
        name: "hil",
        run: bare_metal::hil,
    },
];

/// The steps of these names; `test` means all. `None` when a name is unknown.
pub fn selected(names: &[String]) -> Option<Vec<&'static Step>> {
    if names.iter().any(|n| n == "test") {
        return Some(STEPS.iter().collect());
    }
    names
        .iter()
        .map(|name| STEPS.iter().find(|step| step.name == name))
        .collect()
}

/// Runs the steps one after the other, to the end even when one fails.
pub fn run(steps: &[&Step]) -> ExitCode {
    let mut lines = Vec::new();
    let mut failed = false;
    for step in steps {
        eprintln!("\n=== {} ===", step.name);
        let start = Instant::now();
        let verdict = match (step.run)() {
            Ok(Outcome::Passed) => "passed".to_string(),
            Ok(Outcome::Skipped(why)) => {
                failed |= std::env::var_os("CI").is_some();
                format!("SKIPPED: {why}")
            }
            Err(error) => {
                failed = true;
                format!("FAILED: {error:#}")
            }
        };
        let seconds = start.elapsed().as_secs();
        lines.push(format!("{:<12} {seconds:>4} s  {verdict}", step.name));
        eprintln!("=== {} {verdict} ===", step.name);
    }
    println!("\n{}", lines.join("\n"));
    println!("{}", if failed { "FAILED" } else { "all passed" });
    ExitCode::from(u8::from(failed))
}

/// Runs a command with inherited output; an error says which and how it ended.
pub fn command(program: &str, arguments: &[&str]) -> Result<Outcome> {
    let line = format!("{program} {}", arguments.join(" "));
    eprintln!("$ {line}");
    let status = Command::new(program)
        .args(arguments)
        .status()
        .with_context(|| format!("cannot start {program}"))?;
    if !status.success() {
        bail!("`{line}` ended with {status}");
    }
    Ok(Outcome::Passed)
}

fn cargo(arguments: &[&str]) -> Result<Outcome> {
    command(env!("CARGO"), arguments)
}

fn fmt() -> Result<Outcome> {
    component("rustfmt", "fmt")?;
    cargo(&["fmt", "--all", "--check"])
}

fn lint() -> Result<Outcome> {
    component("clippy", "clippy")?;
    cargo(&[
        "clippy",
        "--workspace",
        "--all-targets",
        "--quiet",
        "--",
        "-D",
        "warnings",
    ])
}

/// Makes sure that a component of the toolchain is there.
fn component(name: &str, subcommand: &str) -> Result<()> {
    let there = |c: &mut Command| c.output().is_ok_and(|o| o.status.success());
    if there(Command::new(env!("CARGO")).args([subcommand, "--version"])) {
        return Ok(());
    }
    command("rustup", &["component", "add", name])
        .with_context(|| format!("the toolchain lacks {name}"))
        .map(drop)
}

fn unit() -> Result<Outcome> {
    cargo(&["test", "--workspace", "--quiet"])
}

fn doc() -> Result<Outcome> {
    // SAFETY of the environment: nothing else runs in this process
    let status = Command::new(env!("CARGO"))
        .args(["doc", "--workspace", "--no-deps", "--quiet"])
        .env("RUSTDOCFLAGS", "-D warnings")
        .status()?;
    if !status.success() {
        bail!("the documentation has warnings");
    }
    Ok(Outcome::Passed)
}
