//! Validates requests against what the OpenAPI document states about query parameters and headers: length, format,
//! range.
//!
//! Types are checked by the handlers, which parse them. Constraints that are only attributes of the document
//! (`max_length`, `pattern`, …) would not be enforced without this. Built from the document, so that the two cannot
//! differ.

use crate::problem::Problem;
use axum::extract::{MatchedPath, Query, Request, State};
use axum::http::{HeaderMap, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use regex::Regex;
use std::collections::HashMap;
use std::sync::Arc;
use utoipa::openapi::path::{Operation, Parameter, ParameterIn};
use utoipa::openapi::schema::{Object, Schema, SchemaType, Type};
use utoipa::openapi::{OpenApi, RefOr};

/// Characters of a refused value that are quoted.
const QUOTED: usize = 60;

/// Constrained parameters by method and path of the router.
#[derive(Debug, Default)]
pub(super) struct Stated(HashMap<(Method, String), Vec<Constraint>>);

#[derive(Debug)]
struct Constraint {
    name: String,
    is_header: bool,
    form: Form,
}

#[derive(Debug)]
enum Form {
    Text {
        least: usize,
        most: usize,
        pattern: Option<Regex>,
    },
    /// Both ends are allowed.
    Whole { least: i128, most: i128 },
    /// `above`: the lower end is not allowed.
    Number { least: f64, above: bool, most: f64 },
}

impl Stated {
    /// * `api`: with the paths as the router has them
    pub(super) fn of(api: &OpenApi) -> Self {
        let mut all = HashMap::new();
        for (path, item) in &api.paths.paths {
            let operations = [
                (Method::GET, &item.get),
                (Method::POST, &item.post),
                (Method::PUT, &item.put),
                (Method::DELETE, &item.delete),
            ];
            for (method, operation) in operations {
                let found = operation.as_ref().map(constraints).unwrap_or_default();
                if !found.is_empty() {
                    all.insert((method, path.clone()), found);
                }
            }
        }
        Self(all)
    }

    fn check(&self, request: &Request) -> Result<(), Problem> {
        let Some(path) = request.extensions().get::<MatchedPath>() else {
            return Ok(());
        };
        let method = match request.method() {
            &Method::HEAD => Method::GET,
            method => method.clone(),
        };
        let Some(constraints) = self.0.get(&(method, path.as_str().to_owned())) else {
            return Ok(());
        };
        // A query that cannot be taken apart is refused by the handler.
        let query = Query::<Vec<(String, String)>>::try_from_uri(request.uri()).unwrap_or_default();
        constraints
            .iter()
            .try_for_each(|one| one.check(&query, request.headers()))
    }
}

/// Of an operation, those that a value can violate.
fn constraints(operation: &Operation) -> Vec<Constraint> {
    let parameters = operation.parameters.iter().flatten();
    parameters
        .filter_map(|parameter| match parameter {
            RefOr::T(parameter) => Constraint::of(parameter),
            RefOr::Ref(_) => None,
        })
        .collect()
}

impl Constraint {
    fn of(parameter: &Parameter) -> Option<Self> {
        let is_header = match parameter.parameter_in {
            ParameterIn::Header => true,
            ParameterIn::Query => false,
            _ => return None,
        };
        let Some(RefOr::T(Schema::Object(object))) = &parameter.schema else {
            return None;
        };
        Some(Self {
            name: parameter.name.clone(),
            is_header,
            form: Form::of(object)?,
        })
    }

    /// # Errors
    /// 400.
    fn check(&self, query: &[(String, String)], headers: &HeaderMap) -> Result<(), Problem> {
        if self.is_header {
            let mut values = headers.get_all(&self.name).iter();
            return values.try_for_each(|value| self.check_value(&String::from_utf8_lossy(value.as_bytes())));
        }
        let mut values = query.iter().filter(|(name, _)| *name == self.name);
        values.try_for_each(|(_, value)| self.check_value(value))
    }

    fn check_value(&self, value: &str) -> Result<(), Problem> {
        self.form.complaint(value).map_or(Ok(()), |expected| {
            let mut quoted: String = value.chars().take(QUOTED).collect();
            if quoted.len() < value.len() {
                quoted.push('…');
            }
            let shown = match self.form {
                Form::Whole { .. } | Form::Number { .. } if quoted.parse::<f64>().is_ok() => quoted,
                _ => format!("{quoted:?}"),
            };
            Err(Problem::bad_request(format!(
                "`{}` is {shown}; expected {expected}",
                self.name
            )))
        })
    }
}

impl Form {
    fn of(object: &Object) -> Option<Self> {
        let SchemaType::Type(kind) = &object.schema_type else {
            return None;
        };
        match kind {
            Type::String if object.enum_values.is_none() => {
                let pattern = object.pattern.as_deref().map(|text| {
                    Regex::new(text).expect("patterns of the document are constants, and a test compiles them all")
                });
                let (least, most) = (object.min_length.unwrap_or(0), object.max_length.unwrap_or(usize::MAX));
                (pattern.is_some() || least > 0 || most < usize::MAX).then_some(Self::Text { least, most, pattern })
            }
            Type::Integer => Some(Self::Whole {
                least: object.minimum.as_ref().and_then(whole).unwrap_or(i128::MIN),
                most: object.maximum.as_ref().and_then(whole).unwrap_or(i128::MAX),
            }),
            Type::Number => {
                let above = object.exclusive_minimum.as_ref().map(number);
                let least = object.minimum.as_ref().map(number);
                Some(Self::Number {
                    least: above.or(least).unwrap_or(f64::NEG_INFINITY),
                    above: above.is_some(),
                    most: object.maximum.as_ref().map_or(f64::INFINITY, number),
                })
            }
            _ => None,
        }
    }

    /// What was expected instead of this value; `None`: it is as stated.
    fn complaint(&self, value: &str) -> Option<String> {
        match self {
            Self::Text { least, most, pattern } => {
                if !(*least..=*most).contains(&value.chars().count()) {
                    return Some(match most {
                        &usize::MAX => format!("at least {least} characters"),
                        most => format!("{least} to {most} characters"),
                    });
                }
                let pattern = pattern.as_ref().filter(|pattern| !pattern.is_match(value))?;
                Some(format!("the form {pattern}"))
            }
            Self::Whole { least, most } => {
                let Ok(number) = value.parse::<i128>() else {
                    return Some("a whole number".to_owned());
                };
                // The largest number of a type is not a useful bound.
                let unbounded = *most >= i128::from(i64::MAX) && number < *least;
                (!(*least..=*most).contains(&number)).then(|| match unbounded {
                    true => format!("at least {least}"),
                    false => format!("{least} to {most}"),
                })
            }
            Self::Number { least, above, most } => {
                let Some(number) = value.parse::<f64>().ok().filter(|number| number.is_finite()) else {
                    return Some("a finite number".to_owned());
                };
                let is_inside = number <= *most && if *above { number > *least } else { number >= *least };
                (!is_inside).then(|| match (above, *most) {
                    (true, f64::INFINITY) => format!("more than {least}"),
                    (true, most) => format!("more than {least}, at most {most}"),
                    (false, most) => format!("{least} to {most}"),
                })
            }
        }
    }
}

/// The number, if it is a whole one.
pub(super) fn whole(number: &utoipa::Number) -> Option<i128> {
    match number {
        utoipa::Number::Int(value) => Some(*value as i128),
        utoipa::Number::UInt(value) => Some(*value as i128),
        utoipa::Number::Float(value) => (value.fract() == 0.0).then_some(*value as i128),
    }
}

fn number(number: &utoipa::Number) -> f64 {
    match number {
        utoipa::Number::Int(value) => *value as f64,
        utoipa::Number::UInt(value) => *value as f64,
        utoipa::Number::Float(value) => *value,
    }
}

/// Lets requests through that are as the document states.
pub(super) async fn hold(State(stated): State<Arc<Stated>>, request: Request, next: Next) -> Response {
    match stated.check(&request) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use utoipa::openapi::schema::ObjectBuilder;

    fn text(pattern: &str) -> Form {
        let object = ObjectBuilder::new()
            .schema_type(Type::String)
            .pattern(Some(pattern))
            .max_length(Some(9));
        Form::of(&object.build()).expect("it is constrained")
    }

    #[test]
    fn val_a_form_refuses_what_its_schema_refuses() {
        let letters = text("^[a-z]+$");
        assert_eq!(letters.complaint("abc"), None);
        assert_eq!(letters.complaint("").as_deref(), Some("the form ^[a-z]+$"));
        assert_eq!(letters.complaint("abc\n").as_deref(), Some("the form ^[a-z]+$"));
        assert_eq!(letters.complaint("abcdefghij").as_deref(), Some("0 to 9 characters"));
        let object = ObjectBuilder::new()
            .schema_type(Type::Integer)
            .minimum(Some(1_usize))
            .maximum(Some(u64::MAX));
        let whole = Form::of(&object.build()).expect("it is constrained");
        assert_eq!(whole.complaint("18446744073709551615"), None);
        assert!(whole.complaint("18446744073709551616").is_some() && whole.complaint("0").is_some());
        for odd in ["one", "", "1.5"] {
            assert_eq!(whole.complaint(odd).as_deref(), Some("a whole number"));
        }
        let object = ObjectBuilder::new()
            .schema_type(Type::Number)
            .exclusive_minimum(Some(0_usize));
        let number = Form::of(&object.build()).expect("it is constrained");
        assert_eq!(number.complaint("1e-9"), None);
        for wrong in ["0", "-1", "inf", "NaN", "1e999"] {
            assert!(number.complaint(wrong).is_some(), "{wrong}");
        }
    }
}
