//! QEMU's monitor: commands and answers over one connection that stays.

use anyhow::{Context, Result};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

const PROMPT: &[u8] = b"(qemu) ";
const LOOK: Duration = Duration::from_millis(5);
const PATIENCE: Duration = Duration::from_secs(10);

/// The monitor of a running QEMU; it listens to one connection at a time.
pub struct Monitor {
    path: PathBuf,
    stream: Option<UnixStream>,
}

impl Monitor {
    /// Behind the socket of this name; it is opened when it is needed.
    pub fn at(path: PathBuf) -> Self {
        Monitor { path, stream: None }
    }

    /// Says a command and returns what QEMU echoes and answers.
    pub fn command(&mut self, command: &str) -> Result<String> {
        let mut stream = match self.stream.take() {
            Some(stream) => stream,
            None => self.open()?,
        };
        writeln!(stream, "{command}").context("cannot command the emulator")?;
        let answer = read_prompt(&mut stream)?;
        self.stream = Some(stream);
        Ok(answer)
    }

    fn open(&self) -> Result<UnixStream> {
        let mut stream = self.connect()?;
        stream.set_read_timeout(Some(PATIENCE))?;
        read_prompt(&mut stream)?;
        Ok(stream)
    }

    /// QEMU opens its socket a moment after it was started.
    fn connect(&self) -> Result<UnixStream> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            match UnixStream::connect(&self.path) {
                Ok(stream) => return Ok(stream),
                Err(_) if Instant::now() < deadline => std::thread::sleep(LOOK),
                Err(error) => return Err(error).context("cannot reach the emulator's monitor"),
            }
        }
    }
}

/// QEMU's monitor says `(qemu) ` when it waits for a command.
fn read_prompt(stream: &mut UnixStream) -> Result<String> {
    let (mut said, mut buffer) = (Vec::new(), [0; 256]);
    while !said.ends_with(PROMPT) {
        let length = stream
            .read(&mut buffer)
            .context("the emulator's monitor does not answer")?;
        anyhow::ensure!(length > 0, "the emulator's monitor has gone");
        said.extend_from_slice(&buffer[..length]);
    }
    Ok(String::from_utf8_lossy(&said).into_owned())
}
