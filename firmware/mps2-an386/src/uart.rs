//! The two serial ports, driven by interrupts.
//!
//! Received bytes go into a queue as on any small part: there is no hardware flow
//! control, so a byte that finds the queue full is dropped and counted. Bytes to be
//! sent wait in a second queue that the transmit interrupt empties; nothing ever waits
//! for a slow listener.
//!
//! QEMU's model of this UART delivers one byte, and then forgets to ask for the next
//! one after it was read; [`timer::wake_port`] makes up for that.

use crate::{register::Register, timer};
use core::cell::RefCell;
use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::interrupt::InterruptNumber;
use cortex_m::{interrupt::Mutex, peripheral::NVIC};
use cortex_m_rt::exception;
use embedded_io::{ErrorType, Read, ReadReady};
use heapless::spsc::{Consumer, Producer, Queue};
use rugosa_app::design_parameters::{self, PORTS};

/// Bytes that can wait to be read, per port; the ring keeps one place free.
pub const RECEIVE_QUEUE: usize = design_parameters::RECEIVE_QUEUE + 1;
/// Bytes that can wait to be sent, per port.
pub const TRANSMIT_QUEUE: usize = 1024;

const TRANSMIT_FULL: u32 = 1;
const RECEIVE_FULL: u32 = 2;
const ENABLE: u32 = 0b1111; // transmitter, receiver and the interrupts of both
const TRANSMIT: u32 = 1;
const RECEIVE: u32 = 2;

struct Registers {
    data: Register,
    state: Register,
    control: Register,
    interrupt: Register,
    divisor: Register,
}

const fn registers(base: usize) -> Registers {
    // SAFETY: CMSDK APB UARTs, Arm DAI0386 table 3-2
    unsafe {
        Registers {
            data: Register::at(base),
            state: Register::at(base + 4),
            control: Register::at(base + 8),
            interrupt: Register::at(base + 12),
            divisor: Register::at(base + 16),
        }
    }
}

const REGISTERS: [Registers; PORTS] = [registers(0x4000_4000), registers(0x4000_5000)];

/// Interrupt lines: receive and transmit of UART 0, then of UART 1.
#[derive(Clone, Copy)]
struct Line(u16);

// SAFETY: 0 … 3 are the UARTs' interrupts on this board
unsafe impl InterruptNumber for Line {
    fn number(self) -> u16 {
        self.0
    }
}

const fn transmit_line(port: usize) -> Line {
    Line(2 * port as u16 + 1)
}

/// The ends of the queues that belong to the interrupts.
struct Ends {
    received: Producer<'static, u8>,
    sending: Consumer<'static, u8>,
}

static ENDS: [Mutex<RefCell<Option<Ends>>>; PORTS] =
    [const { Mutex::new(RefCell::new(None)) }; PORTS];
static DROPPED: [AtomicU32; PORTS] = [const { AtomicU32::new(0) }; PORTS];
static FULLEST: [AtomicU32; PORTS] = [const { AtomicU32::new(0) }; PORTS];

/// Memory of one port's queues.
pub struct Buffers {
    received: Queue<u8, RECEIVE_QUEUE>,
    sending: Queue<u8, TRANSMIT_QUEUE>,
}

impl Buffers {
    /// Empty queues.
    pub const fn new() -> Self {
        Buffers {
            received: Queue::new(),
            sending: Queue::new(),
        }
    }
}

impl Default for Buffers {
    fn default() -> Self {
        Self::new()
    }
}

/// One serial port.
pub struct Uart {
    port: usize,
    received: Consumer<'static, u8>,
    sending: Producer<'static, u8>,
}

impl Uart {
    /// Starts a port (0 or 1) at `baud`.
    pub fn start(port: usize, baud: u32, buffers: &'static mut Buffers) -> Self {
        let (producer, received) = buffers.received.split();
        let (sending, consumer) = buffers.sending.split();
        let ends = Ends {
            received: producer,
            sending: consumer,
        };
        cortex_m::interrupt::free(|cs| ENDS[port].borrow(cs).replace(Some(ends)));
        REGISTERS[port].divisor.write(timer::CLOCK_HZ / baud);
        REGISTERS[port].control.write(ENABLE);
        for line in [2 * port as u16, 2 * port as u16 + 1] {
            // SAFETY: the handler below takes what it needs under a lock
            unsafe { NVIC::unmask(Line(line)) };
        }
        Uart {
            port,
            received,
            sending,
        }
    }

    /// Received bytes that found the queue full, since the start.
    pub fn dropped(&self) -> u32 {
        DROPPED[self.port].load(Ordering::Relaxed)
    }

    /// Most bytes that have waited to be read.
    pub fn fullest(&self) -> u32 {
        FULLEST[self.port].load(Ordering::Relaxed)
    }

    /// Is there anything to read?
    pub fn is_pending(&self) -> bool {
        self.received.ready()
    }

    /// Queues as many bytes as there is room for.
    pub fn try_write(&mut self, bytes: &[u8]) -> usize {
        let taken = bytes
            .iter()
            .take_while(|&&byte| self.sending.enqueue(byte).is_ok());
        let taken = taken.count();
        NVIC::pend(transmit_line(self.port));
        taken
    }
}

impl ErrorType for Uart {
    type Error = Infallible;
}

impl ReadReady for Uart {
    fn read_ready(&mut self) -> Result<bool, Infallible> {
        Ok(self.received.ready())
    }
}

impl Read for Uart {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        if buffer.is_empty() {
            return Ok(0);
        }
        while !self.received.ready() {
            cortex_m::asm::wfi();
        }
        let mut length = 0;
        for (place, byte) in buffer
            .iter_mut()
            .zip(core::iter::from_fn(|| self.received.dequeue()))
        {
            *place = byte;
            length += 1;
        }
        Ok(length)
    }
}

#[exception]
unsafe fn DefaultHandler(line: i16) {
    let port = (line / 2) as usize;
    assert!(line >= 0 && port < PORTS, "interrupt without a handler");
    cortex_m::interrupt::free(|cs| {
        if let Some(ends) = ENDS[port].borrow(cs).borrow_mut().as_mut() {
            match line % 2 {
                0 => receive(port, &mut ends.received),
                _ => transmit(port, &mut ends.sending),
            }
        }
    });
}

fn receive(port: usize, queue: &mut Producer<'static, u8>) {
    let uart = &REGISTERS[port];
    uart.interrupt.write(RECEIVE); // before the look at the state: no edge gets lost
    while uart.state.read() & RECEIVE_FULL != 0 {
        let byte = uart.data.read() as u8;
        timer::wake_port();
        if queue.enqueue(byte).is_err() {
            DROPPED[port].fetch_add(1, Ordering::Relaxed);
        }
    }
    FULLEST[port].fetch_max(queue.len() as u32, Ordering::Relaxed);
}

fn transmit(port: usize, queue: &mut Consumer<'static, u8>) {
    let uart = &REGISTERS[port];
    uart.interrupt.write(TRANSMIT);
    while uart.state.read() & TRANSMIT_FULL == 0 {
        let Some(byte) = queue.dequeue() else {
            return;
        };
        uart.data.write(u32::from(byte));
    }
}
