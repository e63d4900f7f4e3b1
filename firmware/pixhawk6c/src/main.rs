//! The board application on a Pixhawk 6C (STM32H743, 480 MHz): over TELEM1 (UART7), 921,600 baud, 8N1.
//!
//! **Never run on a board yet.** Registers and pins follow RM0433 and PX4's `boards/px4/fmu-v6c`; see docs/pil.md.
//!
//! One loop, no interrupts: the host sends nothing while a step is computed, and the UART's FIFO holds what comes meanwhile. Motor outputs,
//! heater and buzzer stay off: nothing here drives them.
//!
//! Lamps: blue blinking slowly, waits for a host; blue blinking fast, parameters come; blue on, flight; red on, the last request was
//! refused; red and blue on, restarted after a fault or by the watchdog, no host yet.
#![no_std]
#![no_main]

mod clock;
mod register;
mod uart;

use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut, read_volatile, write_volatile};
use cortex_m::peripheral::{DWT, Peripherals, SCB};
use cortex_m_rt::{ExceptionFrame, entry, exception};
use register::{GPIO_B, GPIO_D, modify, read, write};
use rotortwin_board::application::{Application, Board, State};
use rotortwin_board::message::CostUnit;

/// What is written into the stack before it is used.
const PAINT: u32 = 0xC0DE_5AFE;
/// Left in memory, which a restart does not clear, by the fault handler.
const FAULT_MARK: u32 = 0xFA17_FA17;
/// Stack that is painted and watched, bytes.
const STACK: u32 = 256 * 1024;

const RCC_AHB4ENR: u32 = 0x5802_44E0;
const RCC_APB4ENR: u32 = 0x5802_44F4;
const RCC_RSR: u32 = 0x5802_44D0;
const PWR_CR1: u32 = 0x5802_4800;
const RTC_BACKUP_0: u32 = 0x5800_4050;
const WATCHDOG: u32 = 0x5800_4800;
const RED: u32 = 10;
const BLUE: u32 = 11;

#[unsafe(link_section = ".uninit.fault")]
static mut FAULT: MaybeUninit<u32> = MaybeUninit::uninit();

unsafe extern "C" {
    static mut _stack_start: u32;
}

/// The hardware behind the application.
pub struct Pixhawk {
    reset_cause: u8,
    state: State,
    restart: bool,
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
        // SAFETY: a word of memory that nobody else uses; whatever it holds is a number.
        let fault = unsafe {
            let place = addr_of_mut!(FAULT).cast::<u32>();
            let mark = read_volatile(place);
            write_volatile(place, 0);
            mark
        };
        let reset_cause = match cause {
            _ if fault == FAULT_MARK => 2,
            cause if cause & 1 << 26 != 0 => 1,
            cause if cause & 1 << 24 != 0 => 3,
            _ => 0,
        };
        Self {
            reset_cause,
            state: State::Idle,
            restart: false,
            stack_before: 0,
        }
    }

    fn lamp(&self, pin: u32, on: bool) {
        register::set(GPIO_D, pin, !on);
    }

    /// Blinks, feeds the watchdog, and restarts if that was asked for.
    fn idle(&mut self) {
        write(WATCHDOG, 0xAAAA);
        if self.restart {
            SCB::sys_reset();
        }
        let now = DWT::cycle_count();
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
        let top = addr_of!(_stack_start) as u32;
        let mut place = top - STACK;
        while place < top && read(place) == PAINT {
            place += 4;
        }
        [top - place, self.stack_before, STACK]
    }

    fn reset_cause(&self) -> u8 {
        self.reset_cause
    }

    fn show(&mut self, state: State) {
        if state == State::Flight {
            self.stack_before = self.stack()[0];
            paint_stack();
        }
        self.state = state;
    }

    fn boot_loader(&mut self) -> bool {
        // PX4's boot loader stays if it finds this number.
        modify(PWR_CR1, 0, 1 << 8);
        modify(RCC_APB4ENR, 0, 1 << 16);
        write(RTC_BACKUP_0, 0xb007_b007);
        self.restart = true;
        true
    }
}

/// Writes a pattern into the stack that is not in use.
#[inline(never)]
fn paint_stack() {
    let top = addr_of!(_stack_start) as u32;
    let mut place = top - STACK;
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
    // SAFETY: taken once, here.
    let mut core = unsafe { Peripherals::steal() };
    core.SCB.enable_icache();
    core.DCB.enable_trace();
    DWT::unlock();
    core.DWT.enable_cycle_counter();
    uart::start();
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
    loop {
        board.idle();
        if let Some(byte) = uart::receive()
            && let Some(answer) = application.receive(byte, &mut board)
        {
            uart::send(answer);
        }
    }
}

/// Leaves a mark and starts again: the next report says so.
fn fault() -> ! {
    // SAFETY: a word of memory that nobody else uses.
    unsafe { write_volatile(addr_of_mut!(FAULT).cast::<u32>(), FAULT_MARK) };
    SCB::sys_reset()
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    fault()
}

#[exception]
unsafe fn HardFault(_: &ExceptionFrame) -> ! {
    fault()
}
