//! What the OpenAPI document says of every route alike, and the derive macros cannot: refusals of access, forms of headers, results of jobs
//! that are not done.

use utoipa::openapi::path::{Operation, ParameterIn};
use utoipa::openapi::schema::{AnyOfBuilder, ObjectBuilder, Schema, SchemaType, Type};
use utoipa::openapi::{Content, OpenApi, PathItem, Ref, RefOr, ResponseBuilder};

/// What a header has to look like; everything else is 400.
const FORMS_OF_HEADERS: [(&str, &str); 3] = [
    // Spaces at either end are no part of a header.
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
        }
    }
    for (name, schema) in api.components.iter_mut().flat_map(|all| &mut all.schemas) {
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
            ("421", "the Host header names another server"),
            ("429", "rate limit or quota exceeded"),
        ];
        for (status, description) in of_all.into_iter().chain(of_writes) {
            let content = Content::builder()
                .schema(Some(Ref::from_schema_name("Problem")))
                .build();
            let response = ResponseBuilder::new()
                .description(description)
                .content("application/problem+json", content)
                .build();
            operation
                .responses
                .responses
                .entry(status.to_owned())
                .or_insert(response.into());
        }
    }
}
