//! The firmware file for PX4's boot loader, QGroundControl and `px_uploader`: JSON around the zlib-compressed image.
//!
//! Rules (PX4-Bootloader `bl.c`; PX4 `px_mkfw.py`, `px_uploader.py`; QGroundControl `FirmwareImage.cc`):
//! * board id 56; the image fits 1,966,080 bytes and is padded to whole flash words of 32 bytes;
//! * word 0, the stack, is not erased flash; word 1, the start, is inside the image;
//! * `image_size` is the uncompressed length, and QGroundControl searches for the text `"image": "` with one space.
//!
//! zlib's *stored* blocks are valid zlib and need no compressor.

use anyhow::{Result, bail};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD as BASE64;

/// Pixhawk 6C.
const BOARD_ID: u32 = 56;
/// After the boot loader's sector.
const FLASH_START: u32 = 0x0802_0000;
const MAX_SIZE: usize = 1_966_080;

/// Packs a raw image.
pub(crate) fn pack(image: &[u8], version: &str) -> Result<String> {
    let mut image = image.to_vec();
    image.resize(image.len().next_multiple_of(32), 0xFF);
    check(&image)?;
    let text = format!(
        "{{\n    \"magic\": \"PX4FWv1\",\n    \"board_id\": {BOARD_ID},\n    \"board_revision\": 0,\n    \"version\": \"{version}\",\n    \
         \"summary\": \"rotortwin pixhawk6c\",\n    \"description\": \"rotortwin board in the loop for the Pixhawk 6C\",\n    \
         \"image_size\": {},\n    \"image_maxsize\": {MAX_SIZE},\n    \"image\": \"{}\"\n}}\n",
        image.len(),
        BASE64.encode(zlib(&image))
    );
    // Parsed as its readers do.
    let read: serde_json::Value = serde_json::from_str(&text)?;
    if read["board_id"] != BOARD_ID || read["image_size"] != image.len() || !text.contains("\"image\": \"") {
        bail!("the .px4 file does not say what it should");
    }
    Ok(text)
}

fn check(image: &[u8]) -> Result<()> {
    let word = |at: usize| {
        image
            .get(at..at + 4)
            .map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    };
    let (Some(stack), Some(start)) = (word(0), word(4)) else {
        bail!("the image is empty");
    };
    if image.len() > MAX_SIZE {
        bail!("the image has {} bytes, the boot loader takes {MAX_SIZE}", image.len());
    }
    if stack == u32::MAX {
        bail!("the first word of the image is that of erased flash");
    }
    let end = FLASH_START + u32::try_from(image.len())?;
    if !(FLASH_START..end).contains(&start) || start & 1 == 0 {
        bail!("the image starts at {start:#010x}, expected Thumb code from {FLASH_START:#010x} to {end:#010x}");
    }
    Ok(())
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![0x78, 0x01];
    let mut blocks = bytes.chunks(0xFFFF).peekable();
    while let Some(block) = blocks.next() {
        let length = u16::try_from(block.len()).expect("chunks of at most 65,535");
        out.push(u8::from(blocks.peek().is_none()));
        out.extend(length.to_le_bytes());
        out.extend((!length).to_le_bytes());
        out.extend(block);
    }
    let (mut a, mut b) = (1u32, 0u32);
    for byte in bytes {
        a = (a + u32::from(*byte)) % 65_521;
        b = (b + a) % 65_521;
    }
    out.extend((b << 16 | a).to_be_bytes());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_zlib_of_rfc_1950() {
        // Adler-32 of "Wikipedia" is 0x11E60398.
        let packed = zlib(b"Wikipedia");
        assert_eq!(packed[..7], [0x78, 0x01, 0x01, 9, 0, 0xF6, 0xFF]);
        assert_eq!(packed[16..], [0x11, 0xE6, 0x03, 0x98]);
    }

    #[test]
    fn val_images_that_would_not_start_are_refused() {
        let mut image = vec![0; 64];
        image[..8].copy_from_slice(&[0, 0, 8, 0x24, 9, 0, 2, 8]);
        let text = pack(&image, "1").expect("good");
        assert!(text.contains("\"image_size\": 64,"));
        image[4] = 8;
        assert!(pack(&image, "1").is_err());
        image[..8].fill(0xFF);
        assert!(pack(&image, "1").is_err());
    }
}
