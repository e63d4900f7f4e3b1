//! Units of measurement as powers of kilogram, metre, second, ampere and kelvin; coherent SI only, so that no factor hides in a unit.

use std::fmt;
use std::iter::Peekable;
use std::str::Chars;

/// Base units in the order of the exponents.
const BASES: [&str; 5] = ["kg", "m", "s", "A", "K"];

/// A dimension: twice the exponent of each base unit, so that square roots stay exact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dimension([i8; 5]);

impl Dimension {
    /// Of fractions, angles and counts.
    pub(super) const NONE: Self = Self([0; 5]);

    const fn of(kg: i8, m: i8, s: i8, a: i8) -> Self {
        Self([2 * kg, 2 * m, 2 * s, 2 * a, 0])
    }

    /// m
    pub(super) const LENGTH: Self = Self::of(0, 1, 0, 0);
    /// s
    pub(super) const TIME: Self = Self::of(0, 0, 1, 0);
    /// kg
    pub(super) const MASS: Self = Self::of(1, 0, 0, 0);
    /// m/s
    pub(super) const VELOCITY: Self = Self::of(0, 1, -1, 0);
    /// m/s²
    pub(super) const ACCELERATION: Self = Self::of(0, 1, -2, 0);
    /// 1/s, and rad/s
    pub(super) const RATE: Self = Self::of(0, 0, -1, 0);
    /// 1/s², and rad/s²
    pub(super) const RATE_OF_RATE: Self = Self::of(0, 0, -2, 0);
    /// N
    pub(super) const FORCE: Self = Self::of(1, 1, -2, 0);
    /// N·m
    pub(super) const TORQUE: Self = Self::of(1, 2, -2, 0);
    /// V
    pub(super) const VOLTAGE: Self = Self::of(1, 2, -3, -1);
    /// A
    pub(super) const CURRENT: Self = Self::of(0, 0, 0, 1);

    pub(super) fn times(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i].saturating_add(other.0[i])))
    }

    pub(super) fn per(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i].saturating_sub(other.0[i])))
    }

    /// To the power `halves`/2; `None` where an exponent would be no multiple of a half.
    pub(super) fn power(self, halves: i8) -> Option<Self> {
        let mut result = [0; 5];
        for (exponent, &own) in result.iter_mut().zip(&self.0) {
            let product = i32::from(own) * i32::from(halves);
            if product % 2 != 0 {
                return None;
            }
            *exponent = i8::try_from(product / 2).ok()?;
        }
        Some(Self(result))
    }

    /// Reads `N·s/m`, `kg m^2`, `m/s²`, `1/s`, `V`; an empty text is [`Dimension::NONE`].
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let mut reader = Reader {
            chars: text.chars().peekable(),
            text,
        };
        let dimension = reader.product()?;
        match reader.chars.next() {
            None => Ok(dimension),
            Some(c) => Err(format!("unit `{text}`: unexpected `{c}`")),
        }
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = [
            (Self::FORCE, "N"),
            (Self::TORQUE, "N·m"),
            (Self::VOLTAGE, "V"),
            (Self::FORCE.per(Self::VELOCITY), "N·s/m"),
        ];
        if let Some((_, name)) = named.iter().find(|(dimension, _)| dimension == self) {
            return out.write_str(name);
        }
        let mut first = true;
        for (base, &halves) in BASES.iter().zip(&self.0) {
            if halves == 0 {
                continue;
            }
            if !first {
                out.write_str("·")?;
            }
            first = false;
            match (halves, halves % 2) {
                (2, _) => write!(out, "{base}")?,
                (_, 0) => write!(out, "{base}^{}", halves / 2)?,
                _ => write!(out, "{base}^({halves}/2)")?,
            }
        }
        if first { out.write_str("no unit") } else { Ok(()) }
    }
}

struct Reader<'t> {
    chars: Peekable<Chars<'t>>,
    text: &'t str,
}

impl Reader<'_> {
    fn product(&mut self) -> Result<Dimension, String> {
        let mut result = Dimension::NONE;
        let mut divide = false;
        loop {
            while self
                .chars
                .peek()
                .is_some_and(|c| c.is_whitespace() || matches!(c, '·' | '*'))
            {
                self.chars.next();
            }
            match self.chars.peek() {
                None | Some(')') => return Ok(result),
                Some('/') => {
                    self.chars.next();
                    divide = true;
                }
                Some(_) => {
                    let factor = self.factor()?;
                    result = if divide {
                        result.per(factor)
                    } else {
                        result.times(factor)
                    };
                    divide = false;
                }
            }
        }
    }

    fn factor(&mut self) -> Result<Dimension, String> {
        let base = if self.chars.peek() == Some(&'(') {
            self.chars.next();
            let inner = self.product()?;
            if self.chars.next() != Some(')') {
                return Err(format!("unit `{}`: a `)` is missing", self.text));
            }
            inner
        } else {
            let mut name = String::new();
            while let Some(&c) = self.chars.peek()
                && (c.is_alphabetic() || matches!(c, 'Ω' | '%') || (name.is_empty() && c == '1'))
            {
                name.push(c);
                self.chars.next();
            }
            self.named(&name)?
        };
        let halves = 2 * self.exponent()?;
        base.power(halves)
            .ok_or_else(|| format!("unit `{}`: exponent out of range", self.text))
    }

    fn exponent(&mut self) -> Result<i8, String> {
        let mut digits = String::new();
        let caret = self.chars.peek() == Some(&'^');
        if caret {
            self.chars.next();
        }
        while let Some(&c) = self.chars.peek() {
            let plain = match c {
                '⁻' => '-',
                '¹' => '1',
                '²' => '2',
                '³' => '3',
                '⁴' => '4',
                '-' | '0'..='9' if caret => c,
                _ => break,
            };
            digits.push(plain);
            self.chars.next();
        }
        if digits.is_empty() && !caret {
            return Ok(1);
        }
        let refuse = |_| {
            format!(
                "unit `{}`: expected a whole exponent from -9 to 9, got `{digits}`",
                self.text
            )
        };
        let value = digits.parse::<i8>().map_err(refuse)?;
        if (-9..=9).contains(&value) {
            Ok(value)
        } else {
            Err(format!(
                "unit `{}`: expected an exponent from -9 to 9, got {value}",
                self.text
            ))
        }
    }

    fn named(&self, name: &str) -> Result<Dimension, String> {
        Ok(match name {
            "1" | "rad" => Dimension::NONE,
            "kg" => Dimension::MASS,
            "m" => Dimension::LENGTH,
            "s" => Dimension::TIME,
            "A" => Dimension::CURRENT,
            "K" => Dimension([0, 0, 0, 0, 2]),
            "N" => Dimension::FORCE,
            "J" => Dimension::TORQUE,
            "Hz" => Dimension::RATE,
            "Pa" => Dimension::FORCE.per(Dimension::LENGTH).per(Dimension::LENGTH),
            "W" => Dimension::TORQUE.per(Dimension::TIME),
            "V" => Dimension::VOLTAGE,
            "Ω" | "ohm" => Dimension::VOLTAGE.per(Dimension::CURRENT),
            "C" => Dimension::CURRENT.times(Dimension::TIME),
            _ => {
                return Err(format!(
                    "unit `{}`: expected SI units without prefix (kg m s A K rad N Hz Pa J W V Ω C), got `{name}`",
                    self.text
                ));
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_units_read_as_people_write_them() {
        let same = [
            ("N·s/m", "kg/s"),
            ("N s/m", "kg s^-1"),
            ("m/s²", "m s⁻²"),
            ("N/(m/s)", "kg/s"),
            ("V/A", "Ω"),
            ("N·m", "J"),
            ("rad/s", "1/s"),
            ("", "1"),
            ("Pa", "N/m^2"),
        ];
        for (a, b) in same {
            assert_eq!(Dimension::parse(a), Dimension::parse(b), "{a} is {b}");
        }
        assert_ne!(Dimension::parse("N"), Dimension::parse("N·m"));
        for bad in ["deg", "mm", "N^x", "(m", "m)", "m^99", "kN"] {
            assert!(Dimension::parse(bad).is_err(), "{bad}");
        }
    }
}
