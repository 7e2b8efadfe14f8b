//! Builds for parts without an operating system.
//!
//! Two toolchains can do it and their results agree:
//!
//! 1. the active rustup toolchain with the target added (the usual way);
//! 2. Debian's `rustc-web cargo-web rust-web-src` with `-Z build-std=core`, where the
//!    target cannot be downloaded.
//!
//! The first is tried, then the second; which one it was is printed. Everything is
//! built into `target/bare-metal`, so that host builds and these never evict each
//! other, and repeated builds stay warm.

use crate::steps::{Outcome, command};
use anyhow::{Context, Result, bail};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Cortex-M4F and M7F.
pub const CORTEX_M4F: &str = "thumbv7em-none-eabihf";
/// Cortex-M33 with floating point.
pub const CORTEX_M33: &str = "thumbv8m.main-none-eabihf";

/// The crates that must build without a heap and without an operating system.
const CORE: [&str; 5] = [
    "rugosa-wire",
    "rugosa-grid",
    "rugosa-terrain",
    "rugosa-fractal",
    "rugosa",
];

/// A board that the firmware is built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    /// ARM MPS2 with the AN386 image, as emulated by QEMU
    Mps2An386,
    /// Raspberry Pi Pico 2
    Rp2350,
}

impl Board {
    /// Every board, in the order of the documentation.
    pub const ALL: [Board; 2] = [Board::Mps2An386, Board::Rp2350];

    /// Name of the board, of its crate and of its image.
    pub fn name(self) -> &'static str {
        match self {
            Board::Mps2An386 => "mps2-an386",
            Board::Rp2350 => "rp2350",
        }
    }

    /// Target triple of its processor.
    pub fn target(self) -> &'static str {
        match self {
            Board::Mps2An386 => CORTEX_M4F,
            Board::Rp2350 => CORTEX_M33,
        }
    }

    /// The board with this name.
    pub fn from_name(name: &str) -> Result<Self> {
        let known = Board::ALL.map(Board::name).join(", ");
        let board = Board::ALL.into_iter().find(|b| b.name() == name);
        board.with_context(|| format!("no board is called {name}; there are {known}"))
    }
}

/// The step of the test command: the core builds for a Cortex-M, the firmware for every
/// board.
pub fn step() -> Result<Outcome> {
    for target in [CORTEX_M4F, CORTEX_M33] {
        if let Err(error) = Toolchain::find(target) {
            return Ok(Outcome::Skipped(format!("{error:#}")));
        }
    }
    build_core()?;
    for board in Board::ALL {
        build_firmware(board)?;
    }
    Ok(Outcome::Passed)
}

/// The step of the test command: the firmware in the emulator, against the host.
pub fn hil() -> Result<Outcome> {
    if let Err(error) = need_emulator() {
        return Ok(Outcome::Skipped(format!("{error:#}")));
    }
    if let Err(error) = Toolchain::find(CORTEX_M4F) {
        return Ok(Outcome::Skipped(format!("{error:#}")));
    }
    build_firmware(Board::Mps2An386)?;
    build_on_target_tests()?;
    let tests = "test --package rugosa-hil --package rugosa-hil-sim --package rugosa-tests \
        --package rugosa-host \
        --test module --test budgets --test firmware --test over_a_cable --lib \
        -- --include-ignored --test-threads=1";
    let tests: Vec<&str> = tests.split_whitespace().collect();
    command(env!("CARGO"), &tests)
}

/// `cargo xtask firmware BOARD`: builds an image and prints where it is.
pub fn firmware(board: &str) -> Result<()> {
    let image = build_firmware(Board::from_name(board)?)?;
    println!("{}", image.display());
    Ok(())
}

/// Builds the core crates for a Cortex-M4F, with no features.
pub fn build_core() -> Result<()> {
    let mut cargo = Toolchain::find(CORTEX_M4F)?.cargo(CORTEX_M4F, &root());
    for package in CORE {
        cargo.args(["--package", package]);
    }
    run(cargo.arg("--no-default-features"))
}

/// Builds the release images of one board; returns the path of the firmware's.
pub fn build_firmware(board: Board) -> Result<PathBuf> {
    let mut cargo = firmware_cargo(board)?;
    run(cargo.args(["--package", board.name(), "--bins"]))?;
    Ok(images(board).join(board.name()))
}

/// Builds the on-target tests and puts them beside the firmware's image as `numerics`.
fn build_on_target_tests() -> Result<()> {
    let board = Board::Mps2An386;
    let mut cargo = firmware_cargo(board)?;
    cargo.args(["--package", board.name(), "--test", "numerics"]);
    let output = cargo
        .arg("--message-format=json")
        .stderr(Stdio::inherit())
        .output()?;
    if !output.status.success() {
        bail!("{cargo:?} failed with {}", output.status);
    }
    let image = executable(&output.stdout, "numerics").context("cargo names no executable")?;
    std::fs::copy(image, images(board).join("numerics"))?;
    Ok(())
}

/// The executable of this name in cargo's messages.
fn executable(messages: &[u8], name: &str) -> Option<PathBuf> {
    let messages = messages.split(|&byte| byte == b'\n');
    let parsed = messages.filter_map(|line| serde_json::from_slice::<Value>(line).ok());
    let mut named = parsed.filter(|message| message["target"]["name"] == name);
    named.find_map(|message| message["executable"].as_str().map(PathBuf::from))
}

fn firmware_cargo(board: Board) -> Result<Command> {
    let toolchain = Toolchain::find(board.target())?;
    Ok(toolchain.cargo(board.target(), &root().join("firmware")))
}

/// Where the images of a board are.
fn images(board: Board) -> PathBuf {
    target_dir().join(board.target()).join("release")
}

/// Installs the emulator where that is possible; says what is missing where not.
pub fn need_emulator() -> Result<()> {
    if on_path("qemu-system-arm").is_some() {
        return Ok(());
    }
    install(&["qemu-system-arm"]).context("the emulator qemu-system-arm is missing")
}

/// Root of the repository.
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().expect("xtask lies in the root").to_owned()
}

/// Where everything of this module is built.
pub fn target_dir() -> PathBuf {
    root().join("target/bare-metal")
}

/// A way to call cargo for a target without an operating system.
enum Toolchain {
    /// the active one, which knows the target
    Rustup,
    /// Debian's, building `core` itself
    Debian { linker: PathBuf },
}

impl Toolchain {
    /// The first that works; `RUGOSA_BARE_METAL=debian` leaves out rustup's.
    fn find(target: &str) -> Result<Self> {
        let forced = std::env::var("RUGOSA_BARE_METAL").is_ok_and(|v| v == "debian");
        if !forced && (has_target(target) || add_target(target)) {
            return Ok(Toolchain::Rustup);
        }
        eprintln!("{target} does not come from rustup; taking Debian's compiler");
        Toolchain::debian()
    }

    fn debian() -> Result<Self> {
        let source = Path::new("/usr/lib/rustlib/src/rust/library/core");
        let complete = || Path::new("/usr/bin/cargo").exists() && source.exists();
        if !complete() {
            install(&["rustc-web", "cargo-web", "rust-web-src"]).context(
                "neither the rustup target nor Debian's compiler with its sources is there",
            )?;
        }
        let linker = find_linker().context("no rust-lld and no ld.lld: install the package lld")?;
        Ok(Toolchain::Debian { linker })
    }

    /// `cargo build --release --target …` in `workspace`.
    fn cargo(&self, target: &str, workspace: &Path) -> Command {
        let mut command = match self {
            Toolchain::Rustup => Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into())),
            Toolchain::Debian { linker } => debian_cargo(target, linker),
        };
        command
            .current_dir(workspace)
            .args(["build", "--release", "--target", target]);
        if matches!(self, Toolchain::Debian { .. }) {
            command.args(["-Z", "build-std=core"]);
        }
        command.arg("--target-dir").arg(target_dir());
        command
    }
}

/// Debian's cargo, shielded from what the calling rustup cargo left in the environment.
fn debian_cargo(target: &str, linker: &Path) -> Command {
    let mut command = Command::new("/usr/bin/cargo");
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy();
        if name.starts_with("CARGO_PKG_") || name.starts_with("RUSTUP") || name == "CARGO" {
            command.env_remove(name.as_ref());
        }
    }
    let linker_key = target.to_uppercase().replace(['-', '.'], "_");
    command
        .env("RUSTC_BOOTSTRAP", "1")
        .env("RUSTC", "/usr/bin/rustc")
        .env(format!("CARGO_TARGET_{linker_key}_LINKER"), linker);
    command
}

fn has_target(target: &str) -> bool {
    sysroot().is_some_and(|s| s.join("lib/rustlib").join(target).join("lib").is_dir())
}

fn add_target(target: &str) -> bool {
    let Some(rustup) = on_path("rustup") else {
        return false;
    };
    let mut command = Command::new(rustup);
    command
        .args(["target", "add", target])
        .stderr(Stdio::null());
    command.status().is_ok_and(|s| s.success()) && has_target(target)
}

/// The sysroot of the active rustc.
fn sysroot() -> Option<PathBuf> {
    let output = Command::new("rustc")
        .args(["--print", "sysroot"])
        .output()
        .ok()?;
    let path = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| PathBuf::from(path.trim()))
}

/// A linker for ELF images: the toolchain's own, or the distribution's.
fn find_linker() -> Option<PathBuf> {
    let host = sysroot().and_then(|s| first_match(&s.join("lib/rustlib"), "bin/rust-lld"));
    host.or_else(|| on_path("rust-lld"))
        .or_else(|| on_path("ld.lld"))
}

/// `folder/*/tail` where it exists.
fn first_match(folder: &Path, tail: &str) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    entries.map(|e| e.path().join(tail)).find(|p| p.is_file())
}

fn on_path(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|p| p.join(program))
        .find(|p| p.is_file())
}

/// Installs Debian packages when that is possible, else names them.
fn install(packages: &[&str]) -> Result<()> {
    let wanted = packages.join(" ");
    let apt = on_path("apt-get").filter(|_| is_root());
    let Some(apt) = apt else {
        bail!("install: {wanted}");
    };
    eprintln!("installing {wanted}");
    let call = |arguments: &[&str]| {
        let mut command = Command::new(&apt);
        command.args(arguments).stdout(Stdio::null());
        command.env("DEBIAN_FRONTEND", "noninteractive");
        command.status().is_ok_and(|s| s.success())
    };
    let install = [&["install", "--yes", "--no-install-recommends"], packages].concat();
    if call(&install) || (call(&["update"]) && call(&install)) {
        return Ok(());
    }
    bail!("apt-get could not install: {wanted}")
}

fn is_root() -> bool {
    let output = Command::new("id").arg("-u").output();
    output.is_ok_and(|o| o.stdout.trim_ascii() == b"0")
}

fn run(command: &mut Command) -> Result<()> {
    let status = command
        .status()
        .with_context(|| format!("cannot run {:?}", command.get_program()))?;
    if !status.success() {
        bail!("{command:?} failed with {status}");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_board_has_a_name_of_its_own() {
        for board in Board::ALL {
            assert_eq!(Board::from_name(board.name()).unwrap(), board);
        }
        let error = Board::from_name("nucleo").unwrap_err().to_string();
        assert!(error.contains("mps2-an386"), "{error}");
    }
}
