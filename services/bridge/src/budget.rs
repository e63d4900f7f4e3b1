//! Bytes of a 400 Hz cycle compared with the capacity of a line.

use rotortwin_board::frame::overhead;
use rotortwin_board::message::{Reply, Sensors};

/// Time of a cycle, s.
pub const CYCLE_S: f64 = 0.0025;

/// Bytes of one cycle on the line, stuffing and zero included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CycleBytes {
    /// Host to board.
    pub up: usize,
    /// Board to host, within a window.
    pub down: usize,
    /// Board to host at the end of a window, with one rotor named.
    pub down_window_end: usize,
    /// Board to host, with two rotors named and sets listed.
    pub down_worst: usize,
}

impl CycleBytes {
    /// * `residuals`: send those of all rotors, not only the four numbers behind them
    pub const fn new(rotor_count: usize, residuals: bool) -> Self {
        const fn framed(payload: usize) -> usize {
            payload + overhead(payload)
        }
        Self {
            up: framed(Sensors::LENGTH),
            down: framed(Reply::length(rotor_count, residuals, false, false)),
            down_window_end: framed(Reply::length(rotor_count, residuals, true, false)),
            down_worst: framed(Reply::length(rotor_count, residuals, true, true)),
        }
    }

    /// Time on a line at this bit rate (ten bits per byte), s, for host-to-board and then board-to-host traffic.
    pub fn time_s(up: usize, down: usize, baud: f64) -> f64 {
        (up + down) as f64 * 10.0 / baud
    }
}

/// Lines of a Pixhawk 6C: name, bits per second. Full-speed USB has 12 Mbit/s; bulk transfers reach about 8 of them.
pub const LINES: [(&str, f64); 3] = [("921,600 baud", 921_600.0), ("2 Mbaud", 2e6), ("USB CDC-ACM", 8e6)];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_budget_of_the_hexarotor_by_hand() {
        let bytes = CycleBytes::new(6, false);
        // 84 of sensors; 4 step, 2 flags and count, 24 duty, 12 setpoint, 2 limits, 16 residual; 10 of frame.
        assert_eq!((bytes.up, bytes.down), (94, 70));
        // 6 codes, 4 probability, 2 suspects, 24 loss.
        assert_eq!(bytes.down_window_end, 106);
        // Fits a cycle at 921,600 baud, the end of a window included.
        assert!(CycleBytes::time_s(bytes.up, bytes.down_window_end, 921_600.0) < CYCLE_S);
        // With all residuals it does not, at the end of a window.
        let all = CycleBytes::new(6, true);
        assert!(CycleBytes::time_s(all.up, all.down_window_end, 921_600.0) > CYCLE_S);
        assert!(CycleBytes::time_s(all.up, all.down_worst, 2e6) < CYCLE_S);
    }
}
