//! A scenario to check before it is flown.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A scenario to check: the name of one of the server's, or its text.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[schema(as = ToValidate)]
#[serde(deny_unknown_fields)]
pub struct ScenarioToCheck {
    /// Name of one of the server's scenarios.
    pub scenario: Option<String>,
    /// A scenario document (TOML), as in the library's `scenarios`.
    pub text: Option<String>,
    /// Keys to set on the named scenario, `key=value`.
    #[serde(default)]
    pub set: Vec<String>,
}
