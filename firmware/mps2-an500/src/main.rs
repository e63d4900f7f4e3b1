//! The board application on QEMU's `mps2-an500`: a Cortex-M7 with a double-precision FPU, without the timing of a real one.
//!
//! Two channels to the host, chosen by QEMU's semihosting arguments:
//! * `uart`: UART0, a real byte stream, one interrupt per byte;
//! * `files IN OUT`: two named pipes through semihosting; bytes never wait for the emulator's main loop.
//!
//! Costs are instructions, counted by timer 0: with `-icount shift=10` an instruction takes 1024 ns of the timer's 25 MHz, exactly.
#![no_std]
#![no_main]

mod semihosting;
mod uart;

use core::ptr::{addr_of, addr_of_mut, read_volatile, write_volatile};
use cortex_m_rt::{ExceptionFrame, entry, exception};
use rotortwin_board::application::{Application, Board, State};
use rotortwin_board::message::CostUnit;
use semihosting::Pipe;

/// CMSDK timer 0: control, value, reload.
const TIMER: *mut u32 = 0x4000_0000 as *mut u32;
/// Pattern written to the stack before it is used.
const PAINT: u32 = 0xC0DE_5AFE;
/// Nanoseconds of a tick of the timer.
const TICK_NS: u32 = 40;
/// Instructions between two readings of the counter; measured, and tested by `cargo xtask firmware`.
const COUNTER_COST: u32 = 2;

#[expect(unsafe_code, reason = "symbols of the linker")]
// SAFETY: cortex-m-rt's linker script defines both.
unsafe extern "C" {
    static mut _stack_start: u32;
    static mut __ebss: u32;
}

struct Mps2 {
    stack_before: u32,
}

impl Mps2 {
    /// Starts the timer and paints the stack below this function's frame.
    #[inline(never)]
    fn new() -> Self {
        #[expect(unsafe_code, reason = "registers of the timer, and memory that nobody uses yet")]
        // SAFETY: addresses of the machine's manual; the stack grows down from here and nothing lives below it.
        unsafe {
            write_volatile(TIMER.add(2), u32::MAX);
            write_volatile(TIMER.add(1), u32::MAX);
            write_volatile(TIMER, 1);
        }
        paint_stack();
        Self { stack_before: 0 }
    }
}

/// Paints the stack below this function's frame.
#[inline(never)]
fn paint_stack() {
    #[expect(unsafe_code, reason = "memory that nobody uses yet")]
    // SAFETY: the stack grows down from here and nothing lives below it.
    unsafe {
        let mut place = addr_of_mut!(__ebss);
        let here = cortex_m::register::msp::read() as *mut u32;
        while place < here.sub(64) {
            write_volatile(place, PAINT);
            place = place.add(1);
        }
    }
}

impl Board for Mps2 {
    const NAME: &'static str = "mps2-an500";
    const UNIT: CostUnit = CostUnit::Instructions;

    #[inline(always)]
    fn counter(&mut self) -> u32 {
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
        #[expect(unsafe_code, reason = "register of the timer")]
        // SAFETY: reading the timer's value has no side effect.
        let value = unsafe { read_volatile(TIMER.add(1)) };
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
        value
    }

    /// The timer counts down.
    #[inline]
    fn cost(&self, start: u32, end: u32) -> u32 {
        let ticks = start.wrapping_sub(end);
        ((ticks.wrapping_mul(TICK_NS).wrapping_add(512)) >> 10).saturating_sub(COUNTER_COST)
    }

    fn clock_hz(&self) -> u32 {
        0
    }

    fn stack(&self) -> [u32; 3] {
        let mut place = addr_of!(__ebss);
        let top = addr_of!(_stack_start);
        let size = top as u32 - place as u32;
        #[expect(unsafe_code, reason = "looks for the first word of the stack that was ever used")]
        // SAFETY: all of it is memory of this program; reading the stack changes nothing.
        unsafe {
            while place < top && read_volatile(place) == PAINT {
                place = place.add(1);
            }
        }
        [top as u32 - place as u32, self.stack_before, size]
    }

    fn reset_cause(&self) -> u8 {
        0
    }

    fn show(&mut self, state: State) {
        if state == State::Flight {
            self.stack_before = self.stack()[0];
            paint_stack();
        }
    }

    fn boot_loader(&mut self) -> bool {
        false
    }
}

#[entry]
fn main() -> ! {
    let mut board = Mps2::new();
    #[expect(unsafe_code, reason = "the application is too large for the stack")]
    // SAFETY: this function runs once, and nothing else names the static.
    let application: &'static mut Application = unsafe {
        static mut APPLICATION: Application = Application::new();
        &mut *addr_of_mut!(APPLICATION)
    };
    let mut line = [0; 512];
    let arguments = semihosting::command_line(&mut line);
    let mut words = arguments.split(|byte| *byte == b' ').filter(|word| !word.is_empty());
    // The first word is the program's name.
    let channel = words.find(|word| *word == b"uart" || *word == b"files");
    if channel == Some(b"files") {
        let (Some(input), Some(output)) = (
            words.next().and_then(Pipe::open_to_read),
            words.next().and_then(Pipe::open_to_write),
        ) else {
            semihosting::exit(false);
        };
        serve_pipes(application, &mut board, &input, &output);
    }
    uart::serve(application, &mut board)
}

/// Runs until the host closes its pipe.
fn serve_pipes(application: &mut Application, board: &mut Mps2, input: &Pipe, output: &Pipe) -> ! {
    let mut buffer = [0; 1024];
    loop {
        let bytes = input.read(&mut buffer);
        if bytes.is_empty() {
            semihosting::exit(true);
        }
        for byte in bytes {
            if let Some(answer) = application.receive(*byte, board)
                && !output.write(answer)
            {
                semihosting::exit(false);
            }
        }
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    semihosting::exit(false)
}

#[exception]
unsafe fn HardFault(_: &ExceptionFrame) -> ! {
    semihosting::exit(false)
}
