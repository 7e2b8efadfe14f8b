//! The commands with a module: the firmware in the emulator, its ports as serial ports.
//! `cargo xtask hil` builds the image and runs these.

use rugosa_hil::image;
use rugosa_hil_sim::qemu::{Emulator, EmulatorSettings};
use serde_json::Value;
use std::process::{Command, Output, Stdio};

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rugosa"));
    command.args(arguments);
    command
}

fn json(output: &Output) -> Value {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
#[ignore = "cargo xtask hil"]
fn hil_compares_module_and_host() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let out = out.to_str().unwrap();
    let arguments = "hil --json --count 2 --raster 32x32 --faults ber=1e-5,seed=3 --out";
    let arguments: Vec<&str> = arguments.split(' ').chain([out]).collect();
    let report = json(&command(&arguments).output().unwrap());
    assert_eq!(report["parity"]["equal"], true, "{report}");
    assert_eq!(report["lines"]["sent"], 64);
    assert!(report["instructions"]["reconstruction"].as_u64() > Some(1_000_000));
    assert!(report["stack"].as_u64() > Some(1000));
    for file in ["summary.json", "device.log", "elevation.npy", "maps.png"] {
        let path = folder.path().join("out").join(file);
        assert!(path.is_file(), "{file}");
    }
}

#[test]
#[ignore = "cargo xtask hil"]
fn a_module_on_a_port_is_listened_to() {
    let emulator = Emulator::start(EmulatorSettings {
        image: image("mps2-an386").unwrap(),
        instructions_ns: Some(3),
        ..EmulatorSettings::default()
    })
    .unwrap();
    let [scanner, host] = [0, 1].map(|uart| emulator.path(uart).display().to_string());
    let mut simulator = command(&["simulate", "--port", &scanner, "--sweeps", "2"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let arguments = "scan --device --json --sweeps 1 --out";
    let arguments: Vec<&str> = arguments.split(' ').chain([out, "--port", &host]).collect();
    let report = json(&command(&arguments).output().unwrap());
    simulator.kill().unwrap();
    simulator.wait().unwrap();
    assert!(report["sweeps"].as_u64() >= Some(1), "{report}");
    assert!(report["patches"].as_u64() > Some(100), "{report}");
    for file in ["summary.json", "elevation.npy", "maps.png"] {
        assert!(folder.path().join(file).is_file(), "{file}: {report}");
    }
}

#[test]
fn bad_requests_are_named() {
    for (arguments, named) in [
        ("hil --faults noise=1", "noise"),
        ("hil --raster 64x300", "300"),
        ("hil --sweeps no/such.mcap", "no/such.mcap"),
        ("hil --sweeps Cargo.toml", "Cargo.toml"),
        ("scan --device --port /dev/null --out map.json", "map.json"),
    ] {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        let output = command(&arguments)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(named), "{arguments:?}: {said}");
    }
}
