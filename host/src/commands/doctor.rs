//! `rugosa doctor`: ports, permissions, tools and versions.

use crate::console::Console;
use crate::error::Result;
use serde::Serialize;
use serialport::SerialPortType;
use std::fmt;
use std::fs::OpenOptions;
use std::path::{Path, PathBuf};

/// Say which serial ports, permissions, tools and versions there are.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa doctor
  rugosa doctor --json")]
pub struct Args {}

/// Programs that some commands or developer steps use, and for what.
const TOOLS: [(&str, &str); 4] = [
    ("qemu-system-arm", "runs the firmware in an emulator"),
    (
        "socat",
        "joins a serial port to a network or another program",
    ),
    ("cargo", "builds the firmware"),
    ("probe-rs", "writes the firmware to a board"),
];

#[derive(Serialize)]
struct Report {
    version: &'static str,
    protocol: u16,
    schema: String,
    threads: usize,
    ports: Vec<Port>,
    tools: Vec<Tool>,
    problems: Vec<String>,
}

#[derive(Serialize)]
struct Port {
    name: String,
    kind: String,
    serial_number: Option<String>,
    access: Result<(), String>,
}

#[derive(Serialize)]
struct Tool {
    name: &'static str,
    purpose: &'static str,
    path: Option<PathBuf>,
}

/// Looks around.
pub fn run(_: &Args, console: &Console) -> Result<()> {
    let report = Report::new();
    console.result(&report, &report)
}

impl Report {
    fn new() -> Self {
        let (ports, mut problems) = ports();
        let denied = ports
            .iter()
            .filter_map(|p| Some(format!("{}: {}", p.name, p.access.as_ref().err()?)));
        problems.extend(denied);
        Report {
            version: env!("CARGO_PKG_VERSION"),
            protocol: rugosa_wire::PROTOCOL,
            schema: format!("{:08x}", rugosa_wire::schema_hash()),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            ports,
            tools: TOOLS
                .map(|(name, purpose)| Tool {
                    name,
                    purpose,
                    path: find(name),
                })
                .into(),
            problems,
        }
    }
}

/// The serial ports and what kept them from being listed.
fn ports() -> (Vec<Port>, Vec<String>) {
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return (
            Vec::new(),
            vec!["/sys/class/tty is missing: serial ports cannot be listed".into()],
        );
    }
    match serialport::available_ports() {
        Ok(ports) => (ports.into_iter().map(Port::of).collect(), Vec::new()),
        Err(error) => (
            Vec::new(),
            vec![format!("serial ports cannot be listed: {error}")],
        ),
    }
}

impl Port {
    fn of(info: serialport::SerialPortInfo) -> Self {
        let (kind, serial_number) = match info.port_type {
            SerialPortType::UsbPort(usb) => (
                usb.product.unwrap_or_else(|| "USB".into()),
                usb.serial_number,
            ),
            SerialPortType::PciPort => ("PCI".into(), None),
            SerialPortType::BluetoothPort => ("Bluetooth".into(), None),
            SerialPortType::Unknown => ("unknown".into(), None),
        };
        let opened = OpenOptions::new()
            .read(true)
            .write(true)
            .open(&info.port_name);
        Port {
            access: opened.map(drop).map_err(|error| access(&error)),
            name: info.port_name,
            kind,
            serial_number,
        }
    }
}

fn access(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::PermissionDenied => {
            "permission denied: add yourself to the port's group (usually dialout): sudo usermod -aG dialout $USER".into()
        }
        _ => error.to_string(),
    }
}

fn find(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|d| d.join(program))
        .find(|p| p.is_file())
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "rugosa     {} (protocol {}, schema {})",
            self.version, self.protocol, self.schema
        )?;
        writeln!(f, "threads    {}", self.threads)?;
        for port in &self.ports {
            let serial = port.serial_number.as_deref().unwrap_or("no serial number");
            let state = if port.access.is_ok() {
                "can be opened"
            } else {
                "cannot be opened"
            };
            writeln!(
                f,
                "port       {} ({}, {serial}): {state}",
                port.name, port.kind
            )?;
        }
        if self.ports.is_empty() {
            writeln!(f, "port       none found; `rugosa demo` brings its own")?;
        }
        for tool in &self.tools {
            let path = tool
                .path
                .as_ref()
                .map_or("not found".into(), |p| p.display().to_string());
            writeln!(f, "tool       {:<16} {path} ({})", tool.name, tool.purpose)?;
        }
        match self.problems.as_slice() {
            [] => write!(f, "problems   none"),
            problems => write!(f, "problems   {}", problems.join("\n           ")),
        }
    }
}
