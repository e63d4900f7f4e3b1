//! Formatting of numbers, and text widths.

/// Minimum layout width.
const NARROWEST: usize = 40;

/// Characters per terminal line: `COLUMNS` if set, otherwise the terminal's width; none without a terminal.
pub fn width() -> Option<usize> {
    let set = std::env::var("COLUMNS").ok().and_then(|text| text.parse().ok());
    let asked = || {
        terminal_size::terminal_size_of(std::io::stdout())
            .or_else(|| terminal_size::terminal_size_of(std::io::stderr()))
            .map(|(width, _)| usize::from(width.0))
    };
    set.or_else(asked)
        .filter(|width| *width > 0)
        .map(|width| width.max(NARROWEST))
}

/// At most four significant digits, without trailing zeros.
pub fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (3 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.decimals$}");
    if value.abs() < 1e-6 || value.abs() >= 1e7 {
        return format!("{value:.3e}");
    }
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_numbers_keep_four_significant_digits() {
        assert_eq!(significant(0.253_04), "0.253");
        assert_eq!(significant(-0.001_234_56), "-0.001235");
        assert_eq!(significant(12_345.6), "12346");
        assert_eq!(significant(6e-9), "6.000e-9");
        assert_eq!(significant(0.0), "0");
    }
}
