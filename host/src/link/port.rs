//! Names of serial ports, and opening them with errors that say what to do.

use crate::error::{Failure, Result};
use serialport::{ErrorKind, SerialPort, SerialPortInfo, SerialPortType, UsbPortInfo};
use std::convert::Infallible;
use std::fmt;
use std::io;
use std::str::FromStr;
use std::time::Duration;

/// Baud rates that can be chosen; virtual and USB ports ignore them.
pub const BAUD_RATES: [u32; 11] = [
    9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 500_000, 921_600, 1_000_000,
    2_000_000,
];

/// How long a read waits for the first byte.
pub(crate) const READ_TIMEOUT: Duration = Duration::from_millis(10);

/// Which port: a path, or `usb:` and the serial number of the USB device, which stays
/// the same wherever it is plugged in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortName {
    /// name for the operating system, as `/dev/ttyACM0`
    Path(String),
    /// USB serial number
    Usb(String),
}

impl FromStr for PortName {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text.strip_prefix("usb:") {
            Some(serial) => PortName::Usb(serial.to_owned()),
            None => PortName::Path(text.to_owned()),
        })
    }
}

impl From<&str> for PortName {
    fn from(text: &str) -> Self {
        let Ok(name) = text.parse();
        name
    }
}

impl fmt::Display for PortName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PortName::Path(path) => f.write_str(path),
            PortName::Usb(serial) => write!(f, "usb:{serial}"),
        }
    }
}

impl PortName {
    /// Opens the port for this program alone.
    pub fn open(&self, baud: u32) -> Result<Box<dyn SerialPort>> {
        if !BAUD_RATES.contains(&baud) {
            return Err(Failure::input(format_args!(
                "baud rate {baud}: use one of {BAUD_RATES:?}"
            )));
        }
        let path = self.path()?;
        serialport::new(&path, baud)
            .timeout(READ_TIMEOUT)
            .open()
            .map_err(|error| self.cannot_open(&path, error))
    }

    /// Where the port is now.
    fn path(&self) -> Result<String> {
        match self {
            PortName::Path(path) => Ok(path.clone()),
            PortName::Usb(serial) => available()
                .into_iter()
                .find(|port| usb(port).is_some_and(|u| u.serial_number.as_ref() == Some(serial)))
                .map(|port| port.port_name)
                .ok_or_else(|| self.missing()),
        }
    }

    fn missing(&self) -> Failure {
        let known: Vec<_> = available().iter().map(describe).collect();
        let known = match known.is_empty() {
            true => "no serial ports here".to_owned(),
            false => format!("there are {}", known.join(", ")),
        };
        Failure::input(format_args!("{self}: no such port; {known}"))
    }

    fn cannot_open(&self, path: &str, error: serialport::Error) -> Failure {
        let why = match error.kind() {
            ErrorKind::Io(io::ErrorKind::NotFound) => return self.missing(),
            ErrorKind::Io(io::ErrorKind::PermissionDenied) => denied(path),
            ErrorKind::NoDevice => format!("in use by another program, or gone ({error})"),
            _ => format!("cannot be opened as a serial port: {error}"),
        };
        Failure::input(format_args!("{self}: {why}"))
    }
}

/// An error of a port that was open.
pub(crate) fn lost(name: &PortName, error: &io::Error) -> Failure {
    Failure::runtime(format_args!("{name}: port lost: {error}"))
}

fn available() -> Vec<SerialPortInfo> {
    serialport::available_ports().unwrap_or_default()
}

fn usb(port: &SerialPortInfo) -> Option<&UsbPortInfo> {
    match &port.port_type {
        SerialPortType::UsbPort(info) => Some(info),
        _ => None,
    }
}

fn describe(port: &SerialPortInfo) -> String {
    match usb(port).and_then(|info| info.serial_number.as_ref()) {
        Some(serial) => format!("{} (usb:{serial})", port.port_name),
        None => port.port_name.clone(),
    }
}

/// Says which group may use the port.
fn denied(path: &str) -> String {
    match group_of(path) {
        Some(group) => format!(
            "permission denied; it belongs to group {group}: `sudo usermod -aG {group} $USER`, \
             then log in again"
        ),
        None => "permission denied".to_owned(),
    }
}

#[cfg(unix)]
fn group_of(path: &str) -> Option<String> {
    use std::os::unix::fs::MetadataExt;
    let id = std::fs::metadata(path).ok()?.gid().to_string();
    let groups = std::fs::read_to_string("/etc/group").ok()?;
    let fields = groups
        .lines()
        .map(|line| line.split(':').collect::<Vec<_>>());
    fields
        .filter(|fields| fields.get(2) == Some(&id.as_str()))
        .find_map(|fields| fields.first().map(|&name| name.to_owned()))
}

#[cfg(not(unix))]
fn group_of(_path: &str) -> Option<String> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;

    #[test]
    fn names_come_back() {
        for text in ["/dev/ttyACM0", "usb:E6614103E7452D2F"] {
            assert_eq!(PortName::from(text).to_string(), text);
        }
        assert_eq!(PortName::from("usb:77"), PortName::Usb("77".into()));
    }

    #[test]
    fn a_missing_port_is_bad_input_and_named() {
        for name in ["/dev/no-such-port", "usb:no-such-number"] {
            let failure = PortName::from(name).open(115_200).err().unwrap();
            assert_eq!(failure.kind, Kind::Input);
            assert!(
                failure
                    .message
                    .starts_with(&format!("{name}: no such port"))
            );
        }
    }

    #[test]
    fn an_odd_baud_rate_is_refused() {
        let failure = PortName::from("/dev/null").open(12_345).err().unwrap();
        assert!(failure.message.contains("12345") && failure.message.contains("115200"));
    }

    #[test]
    fn a_file_is_no_port() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let name = PortName::Path(file.path().to_str().unwrap().into());
        let failure = name.open(115_200).err().unwrap();
        assert!(failure.message.contains("serial port"), "{failure}");
    }

    #[cfg(unix)]
    #[test]
    fn the_group_of_a_port_is_named() {
        assert_eq!(group_of("/dev/null").as_deref(), Some("root"));
        assert!(denied("/dev/null").contains("usermod -aG root"));
        assert_eq!(group_of("/dev/no-such-port"), None);
    }
}
