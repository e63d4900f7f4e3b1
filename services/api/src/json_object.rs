//! The body of a request that is a JSON object.

use crate::problem::Problem;
use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{FromRequest, Request};
use serde::de::DeserializeOwned;
use std::borrow::Cow;

/// As [`Json`], but only accepts an object: serde also accepts an array for a struct, with its items in field order. And a whole number
/// is one however it is written: see [`with_plain_whole_numbers`].
pub(crate) struct JsonObject<T>(pub(crate) T);

impl<T, S> FromRequest<S> for JsonObject<T>
where
    T: DeserializeOwned,
    S: Send + Sync,
{
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let (parts, body) = request.into_parts();
        let whole = Bytes::from_request(Request::from_parts(parts.clone(), body), state).await?;
        let is_array = whole.trim_ascii_start().first() == Some(&b'[');
        let whole = match with_plain_whole_numbers(&whole) {
            Cow::Borrowed(_) => Body::from(whole),
            Cow::Owned(plain) => Body::from(plain),
        };
        let Json(value) = Json::<T>::from_request(Request::from_parts(parts, whole), state).await?;
        if is_array {
            return Err(Problem::unprocessable(
                "the body is an array; expected one JSON object, with the names given in the OpenAPI document",
            ));
        }
        Ok(Self(value))
    }
}

/// JSON with whole numbers as digits alone: `7.0` and `70e-1` become `7`. According to JSON Schema, and so in the
/// OpenAPI document, all three are the integer 7, and clients in languages whose numbers are floats write them so;
/// serde takes the first and second for something else. Numbers with a fraction, with more than 20 digits, in strings,
/// and anything that is not JSON stay unchanged. Minus zero becomes zero.
fn with_plain_whole_numbers(json: &[u8]) -> Cow<'_, [u8]> {
    let mut plain = Vec::new();
    // Up to here all is in `plain`; while that is empty nothing has changed.
    let mut copied = 0;
    let mut at = 0;
    while let Some(byte) = json.get(at) {
        match byte {
            b'"' => {
                at += 1;
                while let Some(byte) = json.get(at).filter(|byte| **byte != b'"') {
                    at += if *byte == b'\\' { 2 } else { 1 };
                }
                at += 1;
            }
            b'-' | b'0'..=b'9' => {
                let rest = &json[at..];
                let is_part = |byte: &u8| matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E');
                let end = rest.iter().position(|byte| !is_part(byte)).unwrap_or(rest.len());
                let token = std::str::from_utf8(&rest[..end]).unwrap_or_default();
                if let Some(digits) = plain_whole_number(token) {
                    plain.extend_from_slice(&json[copied..at]);
                    plain.extend_from_slice(digits.as_bytes());
                    copied = at + end;
                }
                at += end;
            }
            _ => at += 1,
        }
    }
    if copied == 0 {
        return Cow::Borrowed(json);
    }
    plain.extend_from_slice(&json[copied..]);
    Cow::Owned(plain)
}

/// The digits of a whole number in another notation; `None`: it is not one, or is already in digits.
fn plain_whole_number(token: &str) -> Option<String> {
    /// `u64::MAX` has as many.
    const MOST_DIGITS: usize = 20;
    let is_plain = !token.contains(['.', 'e', 'E']) && token != "-0";
    if is_plain || serde_json::from_str::<serde::de::IgnoredAny>(token).is_err() {
        return None;
    }
    let (sign, size) = match token.strip_prefix('-') {
        Some(size) => ("-", size),
        None => ("", token),
    };
    let (mantissa, exponent) = size.split_once(['e', 'E']).unwrap_or((size, "0"));
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = format!("{whole}{fraction}");
    if digits.bytes().all(|digit| digit == b'0') {
        return Some("0".to_owned());
    }
    // Digits before the point.
    let point = exponent.parse::<i64>().ok()?.checked_add(whole.len() as i64)?;
    let point = usize::try_from(point).ok()?;
    let (before, after) = digits.split_at(point.min(digits.len()));
    let before = before.trim_start_matches('0');
    let zeros = point.saturating_sub(digits.len());
    if before.is_empty()
        || after.bytes().any(|digit| digit != b'0')
        || zeros > MOST_DIGITS
        || before.len() + zeros > MOST_DIGITS
    {
        return None;
    }
    Some(format!("{sign}{before}{}", "0".repeat(zeros)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plain(json: &str) -> String {
        String::from_utf8(with_plain_whole_numbers(json.as_bytes()).into_owned()).expect("UTF-8")
    }

    #[test]
    fn val_a_whole_number_is_one_however_it_is_written() {
        for (written, digits) in [
            ("7.0", "7"),
            ("-7.000", "-7"),
            ("70e-1", "7"),
            ("1E3", "1000"),
            ("1.5e+1", "15"),
            ("0.0", "0"),
            ("-0.0", "0"),
            ("-0", "0"),
            ("0e99999999999999999999", "0"),
            ("18446744073709551615.0", "18446744073709551615"),
            (
                r#"{"a": [1.0,2.50], "b.0": "1.0\"2.0", "c":3.0}"#,
                r#"{"a": [1,2.50], "b.0": "1.0\"2.0", "c":3}"#,
            ),
        ] {
            assert_eq!(plain(written), digits, "{written}");
        }
        // Unchanged, including what is not JSON.
        for same in [
            "7",
            "2.5",
            "1e300",
            "1e-1",
            "1e99999999999999999999",
            "1.",
            "01.0",
            ".0",
            "1.0.0",
            "--1.0",
            r#""1.0"#,
            r#""\"#,
            "",
        ] {
            assert_eq!(plain(same), same);
        }
    }

    proptest! {
        #[test]
        fn prop_numbers_keep_their_value(value in prop_oneof![any::<f64>(), (-1e6..1e6_f64).prop_map(f64::round), any::<i64>().prop_map(|whole| whole as f64)]) {
            prop_assume!(value.is_finite());
            for written in [format!("{value:?}"), format!("{value:e}"), format!("{value:.1}")] {
                let before: f64 = written.parse().expect("a number");
                let after: f64 = plain(&written).parse().expect("a number");
                prop_assert_eq!(before, after, "{}", written);
            }
        }
    }
}
