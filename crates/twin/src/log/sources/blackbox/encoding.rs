//! Encodings of numbers in a blackbox frame, by their number in the header.

use super::Cursor;

/// How a field is encoded in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    SignedByte7,
    UnsignedByte7,
    Negative14Bit,
    Tagged8Of8,
    Tagged2Of3,
    Tagged8Of4,
    Nothing,
    Tagged2Of3Variable,
}

impl Encoding {
    pub(super) fn of(number: i64) -> Option<Self> {
        Some(match number {
            0 => Self::SignedByte7,
            1 => Self::UnsignedByte7,
            3 => Self::Negative14Bit,
            6 => Self::Tagged8Of8,
            7 => Self::Tagged2Of3,
            8 => Self::Tagged8Of4,
            9 => Self::Nothing,
            10 => Self::Tagged2Of3Variable,
            _ => return None,
        })
    }

    /// Most fields that one group of this encoding holds.
    fn group(self) -> usize {
        match self {
            Self::Tagged8Of8 => 8,
            Self::Tagged2Of3 | Self::Tagged2Of3Variable => 3,
            Self::Tagged8Of4 => 4,
            _ => 1,
        }
    }
}

/// Reads one value for each encoding; groups take neighbours of one encoding. `None`: the bytes end.
pub(super) fn read(cursor: &mut Cursor<'_>, encodings: &[Encoding], out: &mut Vec<i64>) -> Option<()> {
    out.clear();
    let mut field = 0;
    while field < encodings.len() {
        let encoding = encodings[field];
        let alike = encodings[field..]
            .iter()
            .take(encoding.group())
            .take_while(|other| **other == encoding);
        let count = alike.count();
        match encoding {
            Encoding::SignedByte7 => out.push(signed(cursor)?),
            Encoding::UnsignedByte7 => out.push(i64::from(unsigned(cursor)?)),
            Encoding::Negative14Bit => out.push(-extend(unsigned(cursor)?, 14)),
            Encoding::Nothing => out.push(0),
            Encoding::Tagged8Of8 => tagged_8(cursor, count, out)?,
            Encoding::Tagged8Of4 => out.extend(&tagged_16(cursor)?[..count]),
            Encoding::Tagged2Of3 => out.extend(&tagged_32(cursor)?[..count]),
            Encoding::Tagged2Of3Variable => out.extend(&tagged_variable(cursor)?[..count]),
        }
        field += count;
    }
    Some(())
}

/// Seven bits a byte, least first, up to five bytes.
pub(super) fn unsigned(cursor: &mut Cursor<'_>) -> Option<u32> {
    let mut value = 0_u32;
    for byte in 0..5 {
        let read = cursor.u8()?;
        value |= u32::from(read & 0x7f) << (7 * byte);
        if read & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

/// The same with the sign in the lowest bit.
pub(super) fn signed(cursor: &mut Cursor<'_>) -> Option<i64> {
    let value = unsigned(cursor)?;
    Some(i64::from((value >> 1) as i32 ^ -((value & 1) as i32)))
}

/// The lowest `bits` of a number in two's complement.
fn extend(value: u32, bits: u32) -> i64 {
    i64::from((value << (32 - bits)) as i32 >> (32 - bits))
}

/// A bit for each value that is not 0; a group of one has no such byte.
fn tagged_8(cursor: &mut Cursor<'_>, count: usize, out: &mut Vec<i64>) -> Option<()> {
    if count == 1 {
        out.push(signed(cursor)?);
        return Some(());
    }
    let tags = cursor.u8()?;
    for value in 0..count {
        out.push(if tags >> value & 1 == 1 { signed(cursor)? } else { 0 });
    }
    Some(())
}

/// Four values of 0, 4, 8 or 16 bits, nibble by nibble.
fn tagged_16(cursor: &mut Cursor<'_>) -> Option<[i64; 4]> {
    let tags = cursor.u8()?;
    let mut half: Option<u8> = None;
    let mut nibble = |cursor: &mut Cursor<'_>| -> Option<u32> {
        if let Some(low) = half.take() {
            return Some(u32::from(low));
        }
        let byte = cursor.u8()?;
        half = Some(byte & 0x0f);
        Some(u32::from(byte >> 4))
    };
    let mut values = [0; 4];
    for (number, value) in values.iter_mut().enumerate() {
        let nibbles = [0, 1, 2, 4][usize::from(tags >> (2 * number) & 3)];
        let mut bits = 0;
        for _ in 0..nibbles {
            bits = bits << 4 | nibble(cursor)?;
        }
        if nibbles > 0 {
            *value = extend(bits, 4 * nibbles);
        }
    }
    Some(values)
}

fn tagged_32(cursor: &mut Cursor<'_>) -> Option<[i64; 3]> {
    let lead = u32::from(cursor.u8()?);
    Some(match lead >> 6 {
        0 => [extend(lead >> 4, 2), extend(lead >> 2, 2), extend(lead, 2)],
        1 => {
            let next = u32::from(cursor.u8()?);
            [extend(lead, 4), extend(next >> 4, 4), extend(next, 4)]
        }
        2 => {
            let [a, b] = cursor.array()?;
            [extend(lead, 6), extend(u32::from(a), 6), extend(u32::from(b), 6)]
        }
        _ => whole_bytes(cursor, lead)?,
    })
}

fn tagged_variable(cursor: &mut Cursor<'_>) -> Option<[i64; 3]> {
    let lead = u32::from(cursor.u8()?);
    Some(match lead >> 6 {
        0 => [extend(lead >> 4, 2), extend(lead >> 2, 2), extend(lead, 2)],
        1 => {
            let bits = lead << 8 | u32::from(cursor.u8()?);
            [extend(bits >> 9, 5), extend(bits >> 4, 5), extend(bits, 4)]
        }
        2 => {
            let [a, b] = cursor.array()?;
            let bits = lead << 16 | u32::from(a) << 8 | u32::from(b);
            [extend(bits >> 14, 8), extend(bits >> 7, 7), extend(bits, 7)]
        }
        _ => whole_bytes(cursor, lead)?,
    })
}

/// Three values of 1 to 4 bytes, little endian; two bits of `lead` each.
fn whole_bytes(cursor: &mut Cursor<'_>, lead: u32) -> Option<[i64; 3]> {
    let mut values = [0; 3];
    for (number, value) in values.iter_mut().enumerate() {
        let bytes = 1 + (lead >> (2 * number) & 3);
        let mut bits = 0_u32;
        for byte in 0..bytes {
            bits |= u32::from(cursor.u8()?) << (8 * byte);
        }
        *value = extend(bits, 8 * bytes);
    }
    Some(values)
}
