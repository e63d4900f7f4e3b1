//! `.px4` files: JSON around the zlib-compressed image of a board's program, ours or PX4's.
//!
//! Rules (PX4 `px_mkfw.py`, `px_uploader.py`; QGroundControl `FirmwareImage.cc`; PX4-Bootloader `bl.c`): `board_id`, `image_size` and `image`
//! are required; `image` is the base64 of zlib of `image_size` bytes, whole words; the first word, the stack, is not that of erased flash.
//! Violations are rejected before the board is touched.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD as BASE64;
use miniz_oxide::inflate::decompress_to_vec_zlib_with_limit;
use std::path::Path;

/// Upper limit, larger than any board's flash, bytes.
const MOST: usize = 16 << 20;

/// A program to flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Px4File {
    /// Target board: 56 is the Pixhawk 6C.
    pub board_id: u32,
    /// Description in the file.
    pub summary: String,
    /// Raw program, whole words.
    pub image: Vec<u8>,
}

impl Px4File {
    /// Reads and checks a file.
    pub fn load(path: &Path) -> Result<Self, String> {
        let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
        Self::parse(&text).map_err(|error| format!("{}: {error}", path.display()))
    }

    /// Reads and checks the text of a file.
    pub fn parse(text: &str) -> Result<Self, String> {
        let file: serde_json::Value =
            serde_json::from_str(text).map_err(|error| format!("not a .px4 file: {error}"))?;
        if let Some(magic) = file["magic"].as_str().filter(|magic| *magic != "PX4FWv1") {
            return Err(format!(
                "not a .px4 file: the magic word is '{magic}', expected 'PX4FWv1'"
            ));
        }
        let number = |field: &str| {
            file[field]
                .as_u64()
                .ok_or_else(|| format!("not a .px4 file: '{field}' is missing, expected a whole number"))
        };
        let board_id = u32::try_from(number("board_id")?).map_err(|error| format!("board_id: {error}"))?;
        let size = number("image_size")?;
        let packed = file["image"]
            .as_str()
            .ok_or("not a .px4 file: 'image' is missing, expected base64 text")?;
        let packed = BASE64
            .decode(packed)
            .map_err(|error| format!("the image is damaged: it is not base64: {error}"))?;
        let image = decompress_to_vec_zlib_with_limit(&packed, MOST)
            .map_err(|error| format!("the image is damaged: zlib says '{error}'"))?;
        if image.len() as u64 != size {
            return Err(format!(
                "the image is damaged: it has {} bytes, image_size says {size}",
                image.len()
            ));
        }
        if image.len() % 4 != 0 || image.len() < 8 {
            return Err(format!(
                "the image has {} bytes, expected whole words of 4",
                image.len()
            ));
        }
        if image[..4] == [0xFF; 4] {
            return Err("the image starts with erased flash: the boot loader would never start it".to_owned());
        }
        Ok(Self {
            board_id,
            summary: file["summary"].as_str().unwrap_or("no summary").to_owned(),
            image,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_files_that_break_a_rule_are_refused_with_it() {
        // zlib of the eight bytes 1 to 8, by Python's zlib.compress(bytes(range(1, 9)), 9).
        let good = r#"{"magic": "PX4FWv1", "board_id": 56, "image_size": 8, "image": "eNpjZGJmYWVj5wAAAIAAJQ=="}"#;
        let file = Px4File::parse(good).expect("good");
        assert_eq!((file.board_id, file.image), (56, vec![1, 2, 3, 4, 5, 6, 7, 8]));
        for (from, to, expected) in [
            ("PX4FWv1", "PX4FWv2", "magic"),
            ("\"board_id\": 56, ", "", "'board_id' is missing"),
            (
                "\"image_size\": 8",
                "\"image_size\": 12",
                "it has 8 bytes, image_size says 12",
            ),
            ("eNpj", "eNpk", "damaged"),
            ("eNpj", "eN*j", "not base64"),
            ("{", "", "not a .px4 file"),
        ] {
            let error = Px4File::parse(&good.replace(from, to)).expect_err(expected);
            assert!(error.contains(expected), "{error}");
        }
    }
}
