//! The board application on a Pixhawk 6C (STM32H743, 480 MHz): over USB (CDC-ACM), TELEM1 or TELEM2 (921,600 baud, 8N1, by DMA).
//!
//! **Never run on a board yet.** Registers and pins follow RM0433 and PX4's `boards/px4/fmu-v6c`; see docs/pil.md.
//!
//! One loop, no interrupts: the host sends nothing while a step is computed, and early data wait in the DMA's ring or in the host's USB
//! port. The board listens on all three links; a good Hello on a link makes it the current one. Motor outputs, heater and buzzer stay
//! off: nothing here drives them.
//!
//! A fault handler stores its registers where a restart does not clear them, and restarts; the next report contains them.
//!
//! LEDs: blue blinking slowly, waiting for a host; blue blinking fast, receiving parameters; blue on, flight; red on, the last request
//! was rejected; red and blue on, restarted after a fault or by the watchdog, no host yet.
#![no_std]
#![no_main]

mod clock;
mod memory;
mod register;
mod uart;
mod usb;

use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut, read_volatile, write_volatile};
use cortex_m::peripheral::{DWT, Peripherals, SCB};
use cortex_m_rt::{ExceptionFrame, entry, exception};
use register::{GPIO_B, GPIO_D, modify, read, write};
use rotortwin_board::application::{Application, Board, State};
use rotortwin_board::frame::{MAX_ENCODED, ShortDecoder, encode_header};
use rotortwin_board::message::{CostUnit, kind};
use uart::Uart;
use usb::Usb;

/// Pattern written to the stack before it is used.
const PAINT: u32 = 0xC0DE_5AFE;
/// Mark left by the fault handler in memory that a restart does not clear.
const FAULT_MARK: u32 = 0xFA17_FA17;

/// Cycles from the request to restart to the restart, 50 ms.
const RESTART_DELAY: u32 = 24_000_000;

const RCC_AHB4ENR: u32 = 0x5802_44E0;
const RCC_APB4ENR: u32 = 0x5802_44F4;
const RCC_RSR: u32 = 0x5802_44D0;
const PWR_CR1: u32 = 0x5802_4800;
const RTC_BACKUP_0: u32 = 0x5800_4050;
const WATCHDOG: u32 = 0x5800_4800;
const CFSR: u32 = 0xE000_ED28;
const HFSR: u32 = 0xE000_ED2C;
const BFAR: u32 = 0xE000_ED38;
const RED: u32 = 10;
const BLUE: u32 = 11;

/// The mark, and the registers of [`rotortwin_board::message::Report::fault`].
#[unsafe(link_section = ".uninit.fault")]
static mut FAULT: MaybeUninit<[u32; 6]> = MaybeUninit::uninit();

unsafe extern "C" {
    static mut _stack_start: u32;
    static mut __euninit: u32;
}

/// The hardware behind the application.
pub struct Pixhawk {
    reset_cause: u8,
    fault: [u32; 5],
    state: State,
    /// Cycle at which a restart was requested.
    restart: Option<u32>,
    stack_before: u32,
}

impl Pixhawk {
    fn new() -> Self {
        // GPIO A to E.
        modify(RCC_AHB4ENR, 0, 0x1F);
        for pin in [RED, BLUE] {
            register::output(GPIO_D, pin, true);
        }
        // Heater and buzzer.
        register::output(GPIO_B, 9, false);
        register::output(GPIO_B, 0, false);
        let cause = read(RCC_RSR);
        modify(RCC_RSR, 0, 1 << 16);
        // SAFETY: memory without any other user; any content is a valid number.
        let [mark, fault @ ..] = unsafe {
            let place = addr_of_mut!(FAULT).cast::<[u32; 6]>();
            let record = read_volatile(place);
            write_volatile(place, [0; 6]);
            record
        };
        let faulted = mark == FAULT_MARK;
        let reset_cause = match cause {
            _ if faulted => 2,
            cause if cause & 1 << 26 != 0 => 1,
            cause if cause & 1 << 24 != 0 => 3,
            _ => 0,
        };
        Self {
            reset_cause,
            fault: if faulted { fault } else { [0; 5] },
            state: State::Idle,
            restart: None,
            stack_before: 0,
        }
    }

    fn lamp(&self, pin: u32, on: bool) {
        register::set(GPIO_D, pin, !on);
    }

    /// Blinks, feeds the watchdog, and restarts if requested.
    fn idle(&mut self) {
        write(WATCHDOG, 0xAAAA);
        let now = DWT::cycle_count();
        // Send the answer first.
        if self
            .restart
            .is_some_and(|since| now.wrapping_sub(since) > RESTART_DELAY)
        {
            SCB::sys_reset();
        }
        let blue = match self.state {
            State::Idle | State::Refused => now >> 28 & 1 == 0,
            State::Download => now >> 25 & 1 == 0,
            State::Flight => true,
        };
        let restarted = matches!(self.reset_cause, 1 | 2) && self.state == State::Idle;
        self.lamp(BLUE, blue || restarted);
        self.lamp(RED, self.state == State::Refused || restarted);
    }
}

impl Board for Pixhawk {
    const NAME: &'static str = "pixhawk6c";
    const UNIT: CostUnit = CostUnit::Cycles;

    #[inline(always)]
    fn counter(&mut self) -> u32 {
        DWT::cycle_count()
    }

    #[inline]
    fn cost(&self, start: u32, end: u32) -> u32 {
        end.wrapping_sub(start)
    }

    fn clock_hz(&self) -> u32 {
        clock::SYSTEM_HZ
    }

    fn stack(&self) -> [u32; 3] {
        let (bottom, top) = stack_range();
        let mut place = bottom;
        while place < top && read(place) == PAINT {
            place += 4;
        }
        [top - place, self.stack_before, top - bottom]
    }

    fn reset_cause(&self) -> u8 {
        self.reset_cause
    }

    fn fault(&self) -> [u32; 5] {
        self.fault
    }

    fn show(&mut self, state: State) {
        if state == State::Flight {
            self.stack_before = self.stack()[0];
            paint_stack();
        }
        self.state = state;
    }

    fn boot_loader(&mut self) -> bool {
        // PX4's boot loader stays active if it finds this number.
        modify(PWR_CR1, 0, 1 << 8);
        modify(RCC_APB4ENR, 0, 1 << 16);
        write(RTC_BACKUP_0, 0xb007_b007);
        self.restart = Some(DWT::cycle_count());
        true
    }
}

/// From the end of all data to the end of memory.
fn stack_range() -> (u32, u32) {
    (
        (addr_of!(__euninit) as u32).next_multiple_of(4),
        addr_of!(_stack_start) as u32,
    )
}

/// Writes a pattern into the unused stack.
#[inline(never)]
fn paint_stack() {
    let (mut place, _) = stack_range();
    let here = cortex_m::register::msp::read() - 256;
    while place < here {
        write(place, PAINT);
        place += 4;
    }
}

#[entry]
fn main() -> ! {
    // What the boot loader may have left: priorities and interrupts.
    cortex_m::interrupt::disable();
    paint_stack();
    let mut board = Pixhawk::new();
    clock::start();
    memory::protect();
    // SAFETY: taken once, here.
    let mut core = unsafe { Peripherals::steal() };
    core.SCB.enable_icache();
    core.SCB.enable_dcache(&mut core.CPUID);
    core.DCB.enable_trace();
    DWT::unlock();
    core.DWT.enable_cycle_counter();
    let [first, second] = memory::Buffers::take();
    let mut links = Links {
        telem1: Uart::telem1(first),
        telem2: Uart::telem2(second),
        usb: Usb::start(),
        current: None,
    };
    // About two seconds: 32 kHz / 64, 1000 ticks.
    write(WATCHDOG, 0xCCCC);
    write(WATCHDOG, 0x5555);
    write(WATCHDOG + 4, 4);
    write(WATCHDOG + 8, 1000);
    // SAFETY: this function runs once, and nothing else names the static.
    let application: &'static mut Application = unsafe {
        static mut APPLICATION: Application = Application::new();
        &mut *addr_of_mut!(APPLICATION)
    };
    // SAFETY: as above.
    let scouts: &'static mut [Scout; 3] = unsafe {
        static mut SCOUTS: [Scout; 3] = [const { Scout::new() }; 3];
        &mut *addr_of_mut!(SCOUTS)
    };
    let mut buffer = [0; 64];
    loop {
        board.idle();
        for (link, scout) in LINKS.into_iter().zip(&mut *scouts) {
            let received = links.receive(link, &mut buffer);
            for byte in received {
                links.take(link, *byte, scout, application, &mut board);
            }
        }
    }
}

/// Listens on a link for a Hello, the shortest frame.
type Scout = ShortDecoder<32>;

/// A link to a host.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Link {
    Usb,
    Telem1,
    Telem2,
}

const LINKS: [Link; 3] = [Link::Usb, Link::Telem1, Link::Telem2];

struct Links {
    usb: Usb,
    telem1: Uart,
    telem2: Uart,
    /// The link of the current host.
    current: Option<Link>,
}

impl Links {
    fn receive<'a>(&mut self, link: Link, buffer: &'a mut [u8; 64]) -> &'a [u8] {
        let uart = match link {
            Link::Usb => return self.usb.receive(buffer),
            Link::Telem1 => &mut self.telem1,
            Link::Telem2 => &mut self.telem2,
        };
        let mut count = 0;
        for place in buffer.iter_mut() {
            let Some(byte) = uart.receive() else { break };
            *place = byte;
            count += 1;
        }
        &buffer[..count]
    }

    fn send(&mut self, link: Link, bytes: &[u8]) {
        match link {
            Link::Usb => self.usb.send(bytes),
            Link::Telem1 => self.telem1.send(bytes),
            Link::Telem2 => self.telem2.send(bytes),
        }
    }

    /// Passes a byte of the current link to the application; on another link, a good Hello makes it the current one.
    fn take(&mut self, link: Link, byte: u8, scout: &mut Scout, application: &mut Application, board: &mut Pixhawk) {
        if self.current == Some(link) {
            if let Some(answer) = application.receive(byte, board) {
                self.send(link, answer);
            }
            return;
        }
        let Some((header, payload)) = scout.push(byte) else {
            return;
        };
        if header.kind != kind::HELLO {
            return;
        }
        self.current = Some(link);
        let mut hello = [0; MAX_ENCODED];
        let length = encode_header(header, payload, &mut hello);
        application.line_lost();
        for byte in &hello[..length.min(MAX_ENCODED)] {
            if let Some(answer) = application.receive(*byte, board) {
                self.send(link, answer);
            }
        }
    }
}

/// Stores mark and registers, and restarts: the next report contains them.
fn fault(pc: u32, lr: u32) -> ! {
    let record = [FAULT_MARK, pc, lr, read(CFSR), read(HFSR), read(BFAR)];
    // SAFETY: memory without any other user.
    unsafe { write_volatile(addr_of_mut!(FAULT).cast::<[u32; 6]>(), record) };
    cortex_m::asm::dsb();
    SCB::sys_reset()
}

/// An undefined instruction: the fault's link register identifies the panic.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::asm::udf()
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    fault(frame.pc(), frame.lr())
}
