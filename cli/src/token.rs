//! `rotortwin token`: who may use a server.

use crate::grid::Grid;
use crate::output::{bad_input, failed, line};
use clap::{Parser, Subcommand};
use rotortwin_api::tokens::{self, NewToken, Scope, Token, Tokens};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin token`.
#[derive(Debug, Parser)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
    /// Data folder of the server
    #[arg(long, value_name = "DIR", default_value = "data", global = true)]
    data: PathBuf,
    /// Database of the server, where it is not SQLite in the data folder
    #[arg(
        long,
        value_name = "URL",
        env = "DATABASE_URL",
        hide_env_values = true,
        global = true
    )]
    database_url: Option<String>,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Make a token; it is printed once and stored nowhere
    Create {
        /// Whose it is, for people
        name: String,
        /// On whose account its jobs are
        #[arg(long, default_value = "local")]
        tenant: String,
        /// read: see the tenant's jobs; write: submit, cancel, delete; admin: everything of every tenant
        #[arg(long, value_delimiter = ',', default_value = "read,write")]
        scopes: Vec<Scope>,
        /// It is worth nothing after so many days; 0: it does not expire
        #[arg(long, value_name = "DAYS", default_value_t = 90, value_parser = clap::value_parser!(i64).range(0..=3650))]
        days: i64,
    },
    /// All tokens, without their secrets
    List,
    /// Take a token back
    Revoke {
        /// The part between `rtw_` and the next `_`
        id: String,
    },
}

/// Exit code 0, 1 if the database fails, 2 for bad input.
pub(crate) fn run(args: &Args) -> ExitCode {
    crate::serve::in_runtime(async {
        let tokens = match tokens::open(&args.data, args.database_url.as_deref()).await {
            Ok(tokens) => tokens,
            Err(sentence) => return bad_input(sentence),
        };
        match perform(&args.what, &tokens).await {
            Ok(code) => code,
            Err(sentence) => failed(sentence),
        }
    })
}

async fn perform(what: &What, tokens: &Tokens) -> Result<ExitCode, String> {
    match what {
        What::Create {
            name,
            tenant,
            scopes,
            days,
        } => {
            if name.trim().is_empty() || tenant.trim().is_empty() {
                return Ok(bad_input("a token has a NAME and a --tenant; expected words"));
            }
            let new = NewToken {
                name: name.clone(),
                tenant: tenant.clone(),
                scopes: scopes.clone(),
                valid_ms: (*days > 0).then_some(days * 24 * 3_600_000),
            };
            line(&tokens.create(&new).await?);
        }
        What::List => {
            let mut table = Grid::new(["id", "name", "tenant", "scopes", "state"]);
            for token in tokens.list().await? {
                let scopes: Vec<&str> = token.scopes.iter().map(|scope| scope.as_str()).collect();
                table.add_row([&token.id, &token.name, &token.tenant, &scopes.join(","), state(&token)]);
            }
            line(&table.to_string());
        }
        What::Revoke { id } => {
            if !tokens.revoke(id).await? {
                return Ok(bad_input(format!(
                    "there is no token '{id}' that is worth something; `rotortwin token list` shows them"
                )));
            }
            line(&format!("{id} is revoked"));
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn state(token: &Token) -> &'static str {
    match (token.revoked_ms, token.expires_ms) {
        (Some(_), _) => "revoked",
        (None, Some(at)) if rotortwin_api::tokens::has_passed(at) => "expired",
        _ => "valid",
    }
}
