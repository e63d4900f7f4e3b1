//! `rotortwin token`: access to a server.

use rotortwin_api::tokens::{self, NewToken, Scope, Token, Tokens};
use rotortwin_cli::network::token::{Args, What};
use rotortwin_cli::output::{bad_input, failed, line};
use rotortwin_runner::grid::Grid;
use std::process::ExitCode;

/// Exit code 0, 1 if the database fails, 2 for bad input.
pub(crate) fn run(args: &Args) -> ExitCode {
    // Querying tokens creates no database: if there is none, another one is meant.
    let file = args.data.join("rotortwin.sqlite");
    let asks = !matches!(args.what, What::Create { .. });
    if asks && args.database_url.is_none() && !file.exists() {
        return bad_input(format!(
            "{}: expected the database of a server; --data names its data folder, DATABASE_URL its Postgres",
            file.display()
        ));
    }
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
                return Ok(bad_input("empty NAME or --tenant; expected text"));
            }
            let new = NewToken {
                name: name.clone(),
                tenant: tenant.clone(),
                scopes: scopes
                    .iter()
                    .map(|scope| scope.parse::<Scope>())
                    .collect::<Result<_, _>>()?,
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
                    "no valid token '{id}'; `rotortwin token list` shows all tokens"
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
