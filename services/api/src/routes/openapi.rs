//! Parts of the OpenAPI document that apply to every route and that the derive macros cannot express: access errors,
//! header formats, results of jobs that are not done.

use super::stated::whole;
use utoipa::Number;
use utoipa::openapi::path::{Operation, ParameterIn};
use utoipa::openapi::schema::{
    AdditionalProperties, AnyOfBuilder, ArrayItems, KnownFormat, Object, ObjectBuilder, Schema, SchemaFormat,
    SchemaType, Type,
};
use utoipa::openapi::{Content, OpenApi, PathItem, Ref, RefOr, Response, ResponseBuilder};

/// What a header has to look like; everything else is 400.
const FORMS_OF_HEADERS: [(&str, &str); 3] = [
    // Leading and trailing spaces are not part of a header.
    ("Idempotency-Key", "^[!-~]([ -~]{0,198}[!-~])?$"),
    ("If-Match", "^\"[0-9A-Za-z]{1,64}\"$"),
    ("If-None-Match", "^\\*$"),
];

/// Adds all of it.
pub(super) fn complete(api: &mut OpenApi) {
    for (path, item) in &mut api.paths.paths {
        if path.starts_with("/api/") {
            add_refusals_of_access(item);
        }
        for operation in operations(item) {
            state_forms(operation);
            add_refusal_of_parameters(operation);
        }
    }
    for (name, schema) in api.components.iter_mut().flat_map(|all| &mut all.schemas) {
        state_ranges(schema);
        if name.starts_with("JobWithResult_") {
            allow_no_result(schema);
        }
        if name == "AxisValue" {
            allow_overlap(schema);
        }
    }
}

/// A whole number is a number, too: of the kinds of such a value more than one can hold.
fn allow_overlap(schema: &mut RefOr<Schema>) {
    if let RefOr::T(Schema::OneOf(kinds)) = schema {
        let kinds = std::mem::take(&mut kinds.items);
        let any = kinds.into_iter().fold(AnyOfBuilder::new(), AnyOfBuilder::item);
        *schema = RefOr::T(Schema::AnyOf(any.build()));
    }
}

fn operations(item: &mut PathItem) -> impl Iterator<Item = &mut Operation> {
    [&mut item.get, &mut item.post, &mut item.delete, &mut item.put]
        .into_iter()
        .flatten()
}

/// A header or a parameter of the query can be left out, but not be null, which `Option` would say; and some headers have a form.
fn state_forms(operation: &mut Operation) {
    for parameter in operation.parameters.iter_mut().flatten() {
        let RefOr::T(parameter) = parameter else { continue };
        parameter.schema.iter_mut().for_each(state_ranges);
        let Some(RefOr::T(Schema::Object(object))) = &mut parameter.schema else {
            continue;
        };
        if let SchemaType::Array(types) = &object.schema_type
            && let [one] = types.iter().filter(|kind| **kind != Type::Null).collect::<Vec<_>>()[..]
        {
            object.schema_type = SchemaType::Type(one.clone());
        }
        let form = FORMS_OF_HEADERS.iter().find(|(name, _)| *name == parameter.name);
        if let Some((_, form)) = form.filter(|_| parameter.parameter_in == ParameterIn::Header) {
            object.pattern = Some((*form).to_owned());
        }
    }
}

/// Integers have the range of their type, which the derive macro only hints at by a format: `u64` is to it an `int64` from 0, so that half of the
/// seeds would be none.
fn state_ranges(schema: &mut RefOr<Schema>) {
    let RefOr::T(schema) = schema else { return };
    let parts: Vec<&mut RefOr<Schema>> = match schema {
        Schema::Array(array) => match &mut array.items {
            ArrayItems::RefOrSchema(items) => vec![&mut **items],
            ArrayItems::False => Vec::new(),
        },
        Schema::OneOf(kinds) => kinds.items.iter_mut().collect(),
        Schema::AllOf(kinds) => kinds.items.iter_mut().collect(),
        Schema::AnyOf(kinds) => kinds.items.iter_mut().collect(),
        Schema::Object(object) => {
            state_range(object);
            let more = match object.additional_properties.as_deref_mut() {
                Some(AdditionalProperties::RefOr(more)) => Some(more),
                _ => None,
            };
            object.properties.values_mut().chain(more).collect()
        }
        _ => Vec::new(),
    };
    parts.into_iter().for_each(state_ranges);
}

fn state_range(object: &mut Object) {
    let is_integer = match &object.schema_type {
        SchemaType::Type(kind) => *kind == Type::Integer,
        SchemaType::Array(kinds) => kinds.contains(&Type::Integer),
        SchemaType::AnyValue => false,
    };
    if !is_integer || object.enum_values.is_some() {
        return;
    }
    let least = object.minimum.as_ref().and_then(whole);
    let is_unsigned = match &object.format {
        // `usize`.
        None => least.is_some_and(|least| least >= 0),
        Some(_) => least == Some(0),
    };
    let range = match (&object.format, is_unsigned) {
        (None | Some(SchemaFormat::KnownFormat(KnownFormat::Int64)), true) => {
            object.format = Some(SchemaFormat::Custom("uint64".to_owned()));
            (Number::UInt(0), Number::UInt(usize::MAX))
        }
        (Some(SchemaFormat::KnownFormat(KnownFormat::Int64)), false) => {
            (Number::Int(isize::MIN), Number::Int(isize::MAX))
        }
        (Some(SchemaFormat::KnownFormat(KnownFormat::Int32)), false) => {
            (Number::Int(i32::MIN as isize), Number::Int(i32::MAX as isize))
        }
        _ => return,
    };
    object.minimum.get_or_insert(range.0);
    object.maximum.get_or_insert(range.1);
}

/// Parameters that are not as stated are refused in one place, [`super::stated`].
fn add_refusal_of_parameters(operation: &mut Operation) {
    let has_some = operation.parameters.iter().flatten().any(|parameter| {
        matches!(parameter, RefOr::T(parameter) if matches!(parameter.parameter_in, ParameterIn::Query | ParameterIn::Header))
    });
    if has_some {
        let responses = &mut operation.responses.responses;
        let refusal = || problem_response("a parameter that is none").into();
        responses.entry("400".to_owned()).or_insert_with(refusal);
    }
}

fn problem_response(description: &str) -> Response {
    let content = Content::builder()
        .schema(Some(Ref::from_schema_name("Problem")))
        .build();
    ResponseBuilder::new()
        .description(description)
        .content("application/problem+json", content)
        .build()
}

/// The property `result` is null before a job is done. The derive macro forgets this where the type of a property is generic.
fn allow_no_result(schema: &mut RefOr<Schema>) {
    let RefOr::T(Schema::AllOf(parts)) = schema else { return };
    for part in &mut parts.items {
        if let RefOr::T(Schema::Object(object)) = part
            && let Some(result) = object.properties.get_mut("result")
        {
            let null = ObjectBuilder::new().schema_type(SchemaType::Type(Type::Null));
            let either = AnyOfBuilder::new().item(null).item(result.clone());
            *result = RefOr::T(Schema::AnyOf(either.build()));
        }
    }
}

/// What every address below `/api/` can answer before its own function is asked.
fn add_refusals_of_access(item: &mut PathItem) {
    let reads = item.get.iter_mut().map(|operation| (operation, false));
    let writes = [&mut item.post, &mut item.delete, &mut item.put];
    let writes = writes.into_iter().flatten().map(|operation| (operation, true));
    for (operation, writes) in reads.chain(writes) {
        let of_writes = writes.then_some(("415", "unsupported media type"));
        let of_all = [
            ("401", "no access token, or an invalid one"),
            (
                "403",
                "the token does not allow this, or the request comes from a web page of another origin",
            ),
            ("414", "path and query have more than 32 KiB"),
            ("421", "the Host header names another server"),
            ("429", "rate limit or quota exceeded"),
            ("431", "more than 100 headers, or more than 64 KiB of them"),
        ];
        for (status, description) in of_all.into_iter().chain(of_writes) {
            operation
                .responses
                .responses
                .entry(status.to_owned())
                .or_insert_with(|| problem_response(description).into());
        }
    }
}
