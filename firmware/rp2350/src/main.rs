//! rugosa on a Raspberry Pi Pico 2 (RP2350, Cortex-M33).
//!
//! **Not yet run on silicon.** It is the same app as on the emulated board; this file is
//! all that differs. Wiring (3.3 V levels, cross RX and TX, common ground):
//!
//! | port | Pico 2 | other side |
//! |---|---|---|
//! | 0 | GP0 TX (pin 1), GP1 RX (pin 2) | scanner |
//! | 1 | GP4 TX (pin 6), GP5 RX (pin 7) | host |
//!
//! Logs come over RTT by a debug probe (`probe-rs run --chip RP235x`).
#![no_std]
#![no_main]

use core::future::Future;
use core::panic::PanicInfo;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use cortex_m::peripheral::DWT;
use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_rp::clocks::RoscRng;
use embassy_rp::uart::{self, BufferedInterruptHandler, BufferedUart, Config};
use embassy_rp::watchdog::Watchdog;
use embassy_rp::{bind_interrupts, peripherals};
use embassy_time::{Duration, Instant};
use embedded_io::{ErrorType, Read, ReadReady};
use rugosa_app::design_parameters::{PORTS, RECEIVE_QUEUE};
use rugosa_app::platform::{Platform, Port, Restarts};
use rugosa_support::{panicked, reset, stack};
use static_cell::ConstStaticCell;

/// Rate of both ports: a sweep of 256 × 256 ranges of 12 bits in about one second.
const BAUD: u32 = 921_600;
const TRANSMIT_QUEUE: usize = 1024;
const PATIENCE: Duration = Duration::from_secs(8);

type Received = [u8; RECEIVE_QUEUE + 1];
type Sending = [u8; TRANSMIT_QUEUE];

static RECEIVED: [ConstStaticCell<Received>; PORTS] =
    [const { ConstStaticCell::new([0; _]) }; PORTS];
static SENDING: [ConstStaticCell<Sending>; PORTS] = [const { ConstStaticCell::new([0; _]) }; PORTS];

bind_interrupts!(struct Interrupts {
    UART0_IRQ => BufferedInterruptHandler<peripherals::UART0>;
    UART1_IRQ => BufferedInterruptHandler<peripherals::UART1>;
});

#[entry]
fn main() -> ! {
    reset::count();
    let p = embassy_rp::init(embassy_rp::config::Config::default());
    let mut config = Config::default();
    config.baudrate = BAUD;
    let [tx0, tx1] = SENDING.each_ref().map(ConstStaticCell::take);
    let [rx0, rx1] = RECEIVED.each_ref().map(ConstStaticCell::take);
    let ports = [
        BufferedUart::new(p.UART0, p.PIN_0, p.PIN_1, Interrupts, tx0, rx0, config),
        BufferedUart::new(p.UART1, p.PIN_4, p.PIN_5, Interrupts, tx1, rx1, config),
    ];
    let mut watchdog = Watchdog::new(p.WATCHDOG);
    watchdog.start(PATIENCE);
    start_cycle_counter();
    let board = Pico2 {
        ports: ports.map(Serial),
        watchdog,
    };
    rugosa_app::run(board)
}

fn start_cycle_counter() {
    if let Some(mut core) = cortex_m::Peripherals::take() {
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panicked(info)
}

struct Pico2 {
    ports: [Serial; PORTS],
    watchdog: Watchdog,
}

impl Platform for Pico2 {
    type Port = Serial;
    const NAME: &'static str = "Raspberry Pi Pico 2";

    fn ports(&mut self) -> &mut [Serial; PORTS] {
        &mut self.ports
    }

    fn now_us(&mut self) -> u64 {
        Instant::now().as_micros()
    }

    fn count(&self) -> u32 {
        DWT::cycle_count()
    }

    fn cost(&self, counts: u32) -> u32 {
        counts // cycles
    }

    fn sleep(&mut self) {
        // a byte that comes here waits in the queue for the next turn; bytes come in at
        // most every 11 µs, so nothing is gained by sleeping
    }

    fn feed_watchdog(&mut self) {
        self.watchdog.feed(PATIENCE);
    }

    fn stack_high_water(&self) -> u32 {
        stack::high_water()
    }

    fn session(&mut self) -> u32 {
        1 << 31 | RoscRng.next_u32()
    }

    fn restarts(&self) -> Restarts {
        reset::restarts()
    }

    fn restart(&mut self) -> ! {
        reset::restart(reset::Cause::Command)
    }
}

/// A UART with embassy's queues.
struct Serial(BufferedUart);

impl ErrorType for Serial {
    type Error = uart::Error;
}

impl Read for Serial {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, uart::Error> {
        self.0.blocking_read(buffer)
    }
}

impl ReadReady for Serial {
    fn read_ready(&mut self) -> Result<bool, uart::Error> {
        embedded_io_async::ReadReady::read_ready(&mut self.0)
    }
}

impl Port for Serial {
    /// The queue takes what it has room for when its future is asked once.
    fn try_write(&mut self, bytes: &[u8]) -> usize {
        let writing = pin!(embedded_io_async::Write::write(&mut self.0, bytes));
        match writing.poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(Ok(taken)) => taken,
            _ => 0,
        }
    }

    fn dropped(&self) -> u32 {
        0 // an overrun is an error of the next read, which the app counts
    }

    fn fullest(&self) -> u32 {
        0 // embassy does not tell
    }
}
