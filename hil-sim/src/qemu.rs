//! The module's processor in an emulator: QEMU's `mps2-an386` (Cortex-M4F).
//!
//! [`Emulator::start`] runs an image with both UARTs on virtual cables (see
//! [`crate::port`], with faults if wished), collects what the image says over
//! semihosting (defmt frames of the log, as bytes), and tells its exit code. The process
//! is killed when the emulator is dropped, and by the kernel when this process dies.
//!
//! - Log and messages of QEMU are kept up to a limit; what is beyond is counted.
//! - `instructions_ns` makes the guest's time exact: with `Some(n)` an instruction takes
//!   2ⁿ ns (`-icount`), the same in every run.
//! - Baud rates mean nothing to QEMU; pace the cable to get a realistic line.
//! - Linux only, as the death signal and the pseudo-terminals are.

use std::io::Read;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};

use crate::monitor::Monitor;
use crate::port::{Cable, CableSettings, End};

const PROGRAM: &str = "qemu-system-arm";
const UARTS: usize = 2;
const LOOK: Duration = Duration::from_millis(5);

/// What is emulated.
#[derive(Clone, Debug, Default)]
pub struct EmulatorSettings {
    /// the image, ELF or raw from address 0
    pub image: PathBuf,
    /// cables of UART 0 and UART 1; the programs' end is A, the emulator's is B
    pub cables: [CableSettings; UARTS],
    /// an instruction takes 2ⁿ ns of the guest's time; `None`: as the host's time goes
    pub instructions_ns: Option<u8>,
    /// most bytes of log kept between two calls of [`Emulator::take_log`]; 0: 16 MiB
    pub log_limit: usize,
}

/// How an image ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// by itself, with this code
    Code(i32),
    /// by a signal, e.g. when it was killed
    Signal(i32),
}

/// A running image.
pub struct Emulator {
    cables: [Cable; UARTS],
    child: Arc<Mutex<Child>>,
    log: Arc<Mutex<Capture>>,
    complaints: Arc<Mutex<Capture>>,
    keeper: Option<JoinHandle<()>>,
    monitor: Mutex<Monitor>,
    _folder: tempfile::TempDir,
}

/// Bytes up to a limit.
#[derive(Default)]
struct Capture {
    bytes: Vec<u8>,
    limit: usize,
    discarded: u64,
}

impl Capture {
    fn shared(limit: usize) -> Arc<Mutex<Capture>> {
        Arc::new(Mutex::new(Capture {
            limit,
            ..Capture::default()
        }))
    }

    fn take(&mut self, bytes: &[u8]) {
        let room = self.limit.saturating_sub(self.bytes.len());
        let kept = bytes.len().min(room);
        self.bytes.extend_from_slice(&bytes[..kept]);
        self.discarded += (bytes.len() - kept) as u64;
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Emulator {
    /// Is QEMU installed?
    pub fn is_available() -> bool {
        let mut version = Command::new(PROGRAM);
        version
            .arg("--version")
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        version.status().is_ok_and(|status| status.success())
    }

    /// Starts an image.
    pub fn start(settings: EmulatorSettings) -> Result<Self> {
        if !settings.image.is_file() {
            bail!("there is no image {}", settings.image.display());
        }
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        let [first, second] = settings.cables.clone();
        let cables = [Cable::with(first)?, Cable::with(second)?];
        let command = command(&settings, &cables, folder.path());
        let limit = match settings.log_limit {
            0 => 16 << 20,
            limit => limit,
        };
        let (log, complaints) = (Capture::shared(limit), Capture::shared(64 << 10));
        let (child, keeper) = keep(command, log.clone(), complaints.clone())?;
        Ok(Emulator {
            cables,
            child,
            log,
            complaints,
            keeper: Some(keeper),
            monitor: Mutex::new(Monitor::at(monitor_path(folder.path()))),
            _folder: folder,
        })
    }

    /// The cable of a UART: open its end A, look at its faults, pull its plug.
    pub fn cable(&self, uart: usize) -> &Cable {
        &self.cables[uart]
    }

    /// The name of the port that leads to a UART.
    pub fn path(&self, uart: usize) -> PathBuf {
        self.cables[uart].path(End::A)
    }

    /// The log since the last call, and how many bytes of it were over the limit.
    pub fn take_log(&self) -> (Vec<u8>, u64) {
        let mut log = lock(&self.log);
        let discarded = std::mem::take(&mut log.discarded);
        (std::mem::take(&mut log.bytes), discarded)
    }

    /// What QEMU itself complained about.
    pub fn complaints(&self) -> String {
        String::from_utf8_lossy(&lock(&self.complaints).bytes).into_owned()
    }

    /// How it ended, if it has.
    pub fn exit(&self) -> Result<Option<Exit>> {
        let status = lock(&self.child)
            .try_wait()
            .context("cannot ask for the emulator")?;
        Ok(status.map(Exit::from))
    }

    /// Waits for the end; an error after `timeout`, and the image runs on.
    pub fn wait(&self, timeout: Duration) -> Result<Exit> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(exit) = self.exit()? {
                return Ok(exit);
            }
            if Instant::now() >= deadline {
                bail!("the image still runs after {timeout:?}");
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Pulls the processor's reset line.
    pub fn reset(&self) -> Result<()> {
        self.monitor("system_reset")
    }

    /// Stops the processor; its serial ports take nothing meanwhile.
    pub fn pause(&self) -> Result<()> {
        self.monitor("stop")
    }

    /// Lets a stopped processor go on.
    pub fn resume(&self) -> Result<()> {
        self.monitor("cont")
    }

    /// Takes all time away from the emulator, as a busy computer does. Unlike
    /// [`Emulator::pause`] it does not know: afterwards its clocks jump.
    pub fn freeze(&self) -> Result<()> {
        self.signal(Signal::STOP)
    }

    /// Gives it time again.
    pub fn thaw(&self) -> Result<()> {
        self.signal(Signal::CONT)
    }

    fn signal(&self, signal: Signal) -> Result<()> {
        let pid = Pid::from_child(&lock(&self.child));
        kill_process(pid, signal).context("cannot send a signal to the emulator")
    }

    /// Ends it at once and collects the rest of the log.
    pub fn kill(&mut self) -> Result<Exit> {
        let _ = lock(&self.child).kill(); // an error: it has ended already
        let exit = self.wait(Duration::from_secs(10));
        if let Some(keeper) = self.keeper.take() {
            let _ = keeper.join();
        }
        exit
    }

    /// The word that the processor would read at this address, devices included.
    pub fn word(&self, address: u32) -> Result<u32> {
        let answer = lock(&self.monitor).command(&format!("xp /1wx {address:#x}"))?;
        let digits = answer.rsplit(": 0x").next().unwrap_or_default();
        let digits = digits.get(..8).unwrap_or_default();
        u32::from_str_radix(digits, 16)
            .with_context(|| format!("the emulator's monitor says {answer:?}"))
    }

    fn monitor(&self, command: &str) -> Result<()> {
        lock(&self.monitor).command(command).map(drop)
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.kill();
    }
}

impl From<ExitStatus> for Exit {
    fn from(status: ExitStatus) -> Self {
        match status.code() {
            Some(code) => Exit::Code(code),
            None => Exit::Signal(status.signal().unwrap_or(0)),
        }
    }
}

fn monitor_path(folder: &Path) -> PathBuf {
    folder.join("monitor")
}

fn command(settings: &EmulatorSettings, cables: &[Cable; UARTS], folder: &Path) -> Command {
    let mut command = Command::new(PROGRAM);
    let fixed = "-M mps2-an386 -nodefaults -nic none -display none \
        -semihosting-config enable=on,target=native,chardev=log -chardev stdio,id=log,signal=off";
    command.args(fixed.split_whitespace());
    let monitor = monitor_path(folder);
    command.arg("-chardev").arg(format!(
        "socket,id=monitor,server=on,wait=off,path={}",
        escaped(&monitor)
    ));
    command.args(["-mon", "chardev=monitor,mode=readline"]);
    for (uart, cable) in cables.iter().enumerate() {
        let path = cable.path(End::B);
        command
            .arg("-chardev")
            .arg(format!("serial,id=uart{uart},path={}", escaped(&path)));
        command.arg("-serial").arg(format!("chardev:uart{uart}"));
    }
    if let Some(shift) = settings.instructions_ns {
        command
            .arg("-icount")
            .arg(format!("shift={shift},sleep=on"));
    }
    command.arg("-kernel").arg(&settings.image);
    command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// QEMU's options double their commas.
fn escaped(path: &Path) -> String {
    path.to_string_lossy().replace(',', ",,")
}

/// Starts the process on a thread that stays until it has ended: the kernel's death
/// signal comes when the thread that started a process ends, not when the program does.
fn keep(
    mut command: Command,
    log: Arc<Mutex<Capture>>,
    complaints: Arc<Mutex<Capture>>,
) -> Result<(Arc<Mutex<Child>>, JoinHandle<()>)> {
    // SAFETY: between fork and exec; one system call, no memory is touched
    unsafe {
        command.pre_exec(|| Ok(set_parent_process_death_signal(Some(Signal::KILL))?));
    }
    let (started, wait) = channel();
    let keeper = std::thread::Builder::new()
        .name("emulator".into())
        .spawn(move || {
            let mut child = match command.spawn() {
                Ok(child) => child,
                Err(error) => return drop(started.send(Err(error))),
            };
            let (output, errors) = (child.stdout.take(), child.stderr.take());
            let child = Arc::new(Mutex::new(child));
            let _ = started.send(Ok(child.clone()));
            let listener = std::thread::spawn(move || collect(errors, &complaints));
            collect(output, &log);
            let _ = listener.join();
            while matches!(lock(&child).try_wait(), Ok(None)) {
                std::thread::sleep(LOOK);
            }
        })?;
    let child = wait
        .recv()
        .map_err(|_| anyhow!("the emulator's thread has died"))?;
    Ok((
        child.with_context(|| format!("cannot start {PROGRAM}"))?,
        keeper,
    ))
}

fn collect(pipe: Option<impl Read>, capture: &Mutex<Capture>) {
    let mut buffer = [0; 4096];
    let Some(mut pipe) = pipe else {
        return;
    };
    while let Ok(n @ 1..) = pipe.read(&mut buffer) {
        lock(capture).take(&buffer[..n]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader, Write};

    /// Machine code for address 0: says `h` on UART 0 and `L` in the log, waits for a
    /// byte on UART 1 and exits with it. Timer 1 runs with a period of a millisecond:
    /// without it QEMU would not look at the ports again after they were enabled.
    ///
    /// ```text
    ///     .word 0x20001000, start + 1
    /// start:
    ///     ldr r3, =0x40001000       @ timer 1: control, value, reload
    ///     ldr r0, =25000;   str r0, [r3, #8];  str r0, [r3, #4]
    ///     movs r0, #1;      str r0, [r3]
    ///     ldr r4, =0x40004000       @ UART 0: data, state, control, interrupt, divisor
    ///     ldr r5, =0x40005000       @ UART 1
    ///     ldr r6, =0x20000000
    ///     ldr r7, =0x20026          @ ADP_Stopped_ApplicationExit
    ///     movs r0, #16;  str r0, [r4, #16];  str r0, [r5, #16]
    ///     movs r0, #3;   str r0, [r4, #8];   str r0, [r5, #8]
    ///     movs r0, #'h'; str r0, [r4]
    ///     movs r0, #'L'; str r0, [r6, #8];   movs r1, r6; adds r1, #8
    ///     movs r0, #3;   bkpt 0xab  @ SYS_WRITEC
    /// wait:
    ///     ldr r0, [r5, #4]; movs r1, #2; tst r0, r1; beq wait
    ///     ldr r2, [r5]; str r7, [r6]; str r2, [r6, #4]; movs r1, r6
    ///     movs r0, #0x20; bkpt 0xab @ SYS_EXIT_EXTENDED
    ///     b .
    /// ```
    #[rustfmt::skip]
    const PROGRAM: [u32; 26] = [
        0x2000_1000, 0x0000_0009, 0x4816_4b15, 0x6058_6098, 0x6018_2001, 0x4d0f_4c0e,
        0x4f10_4e0f, 0x6120_2010, 0x2003_6128, 0x60a8_60a0, 0x6020_2068, 0x60b0_204c,
        0x3108_0031, 0xbeab_2003, 0x2102_6868, 0xd0fb_4208, 0x6037_682a, 0x0031_6072,
        0xbeab_2020, 0xbf00_e7fe, 0x4000_4000, 0x4000_5000, 0x2000_0000, 0x0002_0026,
        0x4000_1000, 0x0000_61a8,
    ];
    const WAIT: Duration = Duration::from_secs(60);

    /// Runs `test` with the program above, unless there is no emulator.
    fn with_program(test: impl FnOnce(Emulator)) {
        if !Emulator::is_available() {
            eprintln!("SKIPPED: {} is not installed", super::PROGRAM);
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let image = folder.path().join("program.bin");
        std::fs::write(&image, PROGRAM.map(u32::to_le_bytes).concat()).unwrap();
        let settings = EmulatorSettings {
            image,
            instructions_ns: Some(3),
            ..Default::default()
        };
        test(Emulator::start(settings).unwrap());
    }

    fn hear(emulator: &Emulator) -> u8 {
        let mut byte = [0];
        let mut port = emulator.cable(0).connect(End::A, WAIT).unwrap();
        port.read_exact(&mut byte).unwrap();
        byte[0]
    }

    #[test]
    fn both_ports_the_log_and_the_exit_code_come_through() {
        with_program(|mut emulator| {
            assert_eq!(hear(&emulator), b'h');
            assert_eq!(emulator.exit().unwrap(), None);
            assert!(emulator.wait(Duration::from_millis(20)).is_err());
            let mut port = emulator.cable(1).connect(End::A, WAIT).unwrap();
            port.write_all(&[42]).unwrap();
            assert_eq!(emulator.wait(WAIT).unwrap(), Exit::Code(42));
            emulator.kill().unwrap();
            assert_eq!(emulator.take_log(), (b"L".to_vec(), 0));
        });
    }

    #[test]
    fn a_reset_starts_it_again() {
        with_program(|emulator| {
            assert_eq!(hear(&emulator), b'h');
            emulator.reset().unwrap();
            assert_eq!(hear(&emulator), b'h');
        });
    }

    #[test]
    fn its_memory_and_devices_can_be_read() {
        with_program(|emulator| {
            assert_eq!(hear(&emulator), b'h');
            assert_eq!(emulator.word(0).unwrap(), PROGRAM[0]);
            assert_eq!(emulator.word(0x4000_1008).unwrap(), 25_000, "timer 1");
            assert!(emulator.word(0xf000_0000).is_err(), "nothing is there");
        });
    }

    #[test]
    fn a_dropped_emulator_leaves_no_process() {
        with_program(|emulator| {
            assert_eq!(hear(&emulator), b'h');
            let process = PathBuf::from(format!("/proc/{}", lock(&emulator.child).id()));
            assert!(process.exists());
            drop(emulator);
            assert!(!process.exists());
        });
    }

    const VICTIM: &str = "RUGOSA_TEST_EMULATOR_VICTIM";

    /// In a process of its own, started by the next test.
    #[test]
    fn victim() {
        if std::env::var_os(VICTIM).is_none() {
            return;
        }
        with_program(|emulator| {
            println!("\npid {}", lock(&emulator.child).id());
            std::thread::sleep(WAIT);
        });
    }

    #[test]
    fn a_killed_program_leaves_no_emulator() {
        if !Emulator::is_available() {
            return eprintln!("SKIPPED: {} is not installed", super::PROGRAM);
        }
        let mut victim = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "--nocapture", "qemu::tests::victim"])
            .env(VICTIM, "1")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let said = BufReader::new(victim.stdout.take().unwrap()).lines();
        let pid = said.map_while(Result::ok).find_map(|line| {
            let pid = line.strip_prefix("pid ")?;
            Some(PathBuf::from(format!("/proc/{pid}/stat")))
        });
        let pid = pid.expect("the victim tells its emulator's number");
        assert!(is_alive(&pid));
        victim.kill().unwrap();
        victim.wait().unwrap();
        let deadline = Instant::now() + WAIT;
        while is_alive(&pid) && Instant::now() < deadline {
            std::thread::sleep(LOOK);
        }
        assert!(!is_alive(&pid));
    }

    /// Neither gone nor waiting to be collected by whoever adopted it.
    fn is_alive(stat: &Path) -> bool {
        std::fs::read_to_string(stat).is_ok_and(|stat| !stat.contains(") Z "))
    }

    #[test]
    fn a_missing_image_is_named() {
        let settings = EmulatorSettings {
            image: "no/such/image.elf".into(),
            ..Default::default()
        };
        let error = Emulator::start(settings).err().unwrap().to_string();
        assert!(error.contains("no/such/image.elf"), "{error}");
    }

    #[test]
    fn captured_output_is_capped_and_the_rest_counted() {
        let mut capture = Capture {
            limit: 5,
            ..Capture::default()
        };
        capture.take(b"abc");
        capture.take(b"defg");
        assert_eq!(
            (capture.bytes.as_slice(), capture.discarded),
            (&b"abcde"[..], 2)
        );
    }
}
