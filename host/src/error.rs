//! What a command can fail with: one line, and an exit code.
//!
//! | code | meaning |
//! |---|---|
//! | 0 | done |
//! | 1 | failed while running: a port vanished, the disk is full, … |
//! | 2 | bad input or usage: the line names the file, the line or offset, and the field |

use std::fmt;
use std::path::Path;
use std::process::ExitCode;

/// Result of everything that can end a command.
pub type Result<T, E = Failure> = std::result::Result<T, E>;

/// Whose fault it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// exit code 1
    Runtime,
    /// exit code 2
    Input,
}

/// One clear line and an exit code.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// whose fault it was
    pub kind: Kind,
    /// one line, without "error:"
    pub message: String,
}

impl Failure {
    /// Bad input or usage.
    pub fn input(message: impl fmt::Display) -> Self {
        Failure::new(Kind::Input, message)
    }

    /// Something went wrong that the user's input is not to blame for.
    pub fn runtime(message: impl fmt::Display) -> Self {
        Failure::new(Kind::Runtime, message)
    }

    /// Bad content of a file.
    pub fn file(path: &Path, message: impl fmt::Display) -> Self {
        Failure::input(format_args!("{}: {message}", path.display()))
    }

    /// Bad content of one line (counted from 1) of a file.
    pub fn line(path: &Path, line: u64, message: impl fmt::Display) -> Self {
        Failure::input(format_args!("{}:{line}: {message}", path.display()))
    }

    /// A file that cannot be written.
    pub fn write(path: &Path, error: impl fmt::Display) -> Self {
        Failure::runtime(format_args!("cannot write {}: {error}", path.display()))
    }

    /// Exit code of the process.
    pub fn exit_code(&self) -> ExitCode {
        match self.kind {
            Kind::Runtime => ExitCode::from(1),
            Kind::Input => ExitCode::from(2),
        }
    }

    fn new(kind: Kind, message: impl fmt::Display) -> Self {
        let message = message.to_string();
        let lines: Vec<&str> = message.split_whitespace().collect();
        Failure {
            kind,
            message: lines.join(" "),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        match error.downcast::<Failure>() {
            Ok(failure) => failure,
            Err(error) => Failure::runtime(format_args!("{error:#}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_one_line() {
        let failure = Failure::file(Path::new("a.csv"), "first\n  second");
        assert_eq!(failure.to_string(), "a.csv: first second");
        assert_eq!(failure.kind, Kind::Input);
    }

    #[test]
    fn a_failure_survives_anyhow() {
        let failure = Failure::line(Path::new("a.csv"), 3, "no");
        let through: Failure = anyhow::Error::new(failure.clone()).into();
        assert_eq!(through, failure);
        let other: Failure = anyhow::anyhow!("port gone").into();
        assert_eq!(other.kind, Kind::Runtime);
    }
}
