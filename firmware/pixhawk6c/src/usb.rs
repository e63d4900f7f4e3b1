//! USB: the connector's full-speed port (OTG2, PA11 and PA12) as a serial port (CDC-ACM), polled.
//!
//! RM0433, 8.7 (clocks), 6.4 (supply), 57; the driver is `synopsys-usb-otg`. The 48 MHz come from PLL3 and the crystal: the internal
//! oscillator would have to be trimmed to the host's frames.

use crate::register::{GPIO_A, alternate, modify, read, write};
use core::mem::MaybeUninit;
use core::ptr::addr_of_mut;
use cortex_m::peripheral::DWT;
use synopsys_usb_otg::{PhyType, UsbBus, UsbPeripheral};
use usb_device::bus::UsbBusAllocator;
use usb_device::device::{StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbVidPid};
use usbd_serial::{SerialPort, USB_CLASS_CDC};

const RCC: u32 = 0x5802_4400;
const PWR_CR3: u32 = 0x5802_480C;
/// Cycles for which a host may leave an answer unread, 100 ms.
const PATIENCE: u32 = 48_000_000;

struct Otg2;

// SAFETY: the registers are those of OTG2, and nothing else touches them.
unsafe impl UsbPeripheral for Otg2 {
    const REGISTERS: *const () = 0x4008_0000 as *const ();
    // A high-speed core with the internal full-speed transceiver.
    const HIGH_SPEED: bool = true;
    const FIFO_DEPTH_WORDS: usize = 1024;
    const ENDPOINT_COUNT: usize = 9;

    fn enable() {
        // USB2OTGHSEN, and no clock for a transceiver outside.
        modify(RCC + 0xD8, 1 << 28, 1 << 27);
        modify(RCC + 0x100, 1 << 28, 1 << 27);
        // Reset.
        modify(RCC + 0x80, 0, 1 << 27);
        modify(RCC + 0x80, 1 << 27, 0);
    }

    fn ahb_frequency_hz(&self) -> u32 {
        240_000_000
    }

    fn phy_type(&self) -> PhyType {
        PhyType::InternalFullSpeed
    }
}

/// The port.
pub struct Usb {
    device: UsbDevice<'static, UsbBus<Otg2>>,
    serial: SerialPort<'static, UsbBus<Otg2>>,
}

/// PLL3 from the crystal: 16 MHz / 4 × 48 / 4 = 48 MHz, as PX4 sets it.
fn start_clock() {
    modify(RCC, 1 << 28, 0);
    while read(RCC) >> 29 & 1 == 1 {}
    modify(RCC + 0x28, 0x3F << 20, 4 << 20);
    // Input of 4 to 8 MHz, wide oscillator, outputs P to R.
    modify(RCC + 0x2C, 0xF << 8, 0b10 << 10 | 0b111 << 22);
    write(RCC + 0x40, 3 << 24 | 3 << 16 | 3 << 9 | 47);
    modify(RCC, 0, 1 << 28);
    while read(RCC) >> 29 & 1 == 0 {}
    modify(RCC + 0x54, 0b11 << 20, 0b10 << 20);
}

impl Usb {
    /// Call once.
    pub fn start() -> Self {
        start_clock();
        // The transceiver's supply is monitored; the board feeds it from 3.3 V.
        modify(PWR_CR3, 0, 1 << 24);
        let start = DWT::cycle_count();
        while read(PWR_CR3) >> 26 & 1 == 0 && DWT::cycle_count().wrapping_sub(start) < PATIENCE {}
        alternate(GPIO_A, 11, 10);
        alternate(GPIO_A, 12, 10);
        // No pull-ups of the pins: the transceiver has its own, on one line only.
        modify(GPIO_A + 0x0C, 0b1111 << 22, 0);
        // SAFETY: this function runs once, and nothing else names the statics.
        let allocator: &'static UsbBusAllocator<UsbBus<Otg2>> = unsafe {
            static mut MEMORY: [u32; 64] = [0; 64];
            static mut ALLOCATOR: MaybeUninit<UsbBusAllocator<UsbBus<Otg2>>> = MaybeUninit::uninit();
            let memory: &'static mut [u32] = &mut *addr_of_mut!(MEMORY);
            (*addr_of_mut!(ALLOCATOR)).write(UsbBus::new(Otg2, memory))
        };
        let serial = SerialPort::new(allocator);
        // Shared ids for serial ports (obdev), to be distinguished by their strings; PX4's would make QGroundControl
        // open the port.
        let words = [StringDescriptors::default()
            .manufacturer("rotortwin")
            .product("rotortwin pixhawk6c")
            .serial_number("1")];
        let builder = UsbDeviceBuilder::new(allocator, UsbVidPid(0x16C0, 0x27DD)).device_class(USB_CLASS_CDC);
        // Neither of the two can fail: one language, a size that USB allows.
        let device = match builder
            .strings(&words)
            .and_then(|builder| builder.max_packet_size_0(64))
        {
            Ok(builder) => builder.build(),
            Err(_) => UsbDeviceBuilder::new(allocator, UsbVidPid(0x16C0, 0x27DD))
                .device_class(USB_CLASS_CDC)
                .build(),
        };
        Self { device, serial }
    }

    /// Received bytes.
    pub fn receive<'a>(&mut self, buffer: &'a mut [u8]) -> &'a [u8] {
        self.device.poll(&mut [&mut self.serial]);
        let count = self.serial.read(buffer).unwrap_or(0);
        buffer.get(..count).unwrap_or_default()
    }

    /// Submits an answer; the part that the host does not read is lost, and will be requested again.
    pub fn send(&mut self, bytes: &[u8]) {
        let start = DWT::cycle_count();
        let mut rest = bytes;
        while !rest.is_empty() && DWT::cycle_count().wrapping_sub(start) < PATIENCE {
            let count = self.serial.write(rest).unwrap_or(0);
            rest = rest.get(count..).unwrap_or_default();
            self.device.poll(&mut [&mut self.serial]);
        }
    }
}
