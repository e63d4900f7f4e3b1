//! File with a process's zenoh credentials, and the access it grants as a listener.
//!
//! ```toml
//! space = "bench-1"                # first part of all keys; left out: rotortwin
//!
//! [tls]                            # for endpoints tls/HOST:PORT; files are PEM
//! ca = "ca.pem"                    # certificate authorities to trust
//! certificate = "plant.pem"        # own certificate: needed to listen, and where one is demanded
//! private_key = "plant-key.pem"
//!
//! [login]                          # user and password, where they are demanded
//! user = "plant"
//! password_file = "plant.password"
//!
//! [listen]                         # for the process that listens: the plant, or a router
//! demand_certificate = true        # accept only certificates signed by ca (mTLS)
//! users_file = "users"             # and only these users, user:password per line
//!
//! [[listen.allow]]                 # none: every accepted client may take any role of the space
//! certificates = ["controller-1"]  # common names; and/or users = […]
//! roles = ["controller"]           # plant, controller, fdi; left out: all
//! space = "bench-1"                # left out: the one above
//! ```
//! Paths are relative to the file. Passwords are in separate files, never on a command line.

use rotortwin_links::security::{Attachment, DEFAULT_SPACE, Grant, Login, Security, Tls};
use rotortwin_proto::Role;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Environment variable with the file for endpoints `tls/…` that name none.
pub const CONFIG_VARIABLE: &str = "ROTORTWIN_ZENOH_CONFIG";

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    space: Option<String>,
    tls: Option<TlsSection>,
    login: Option<LoginSection>,
    #[serde(default)]
    listen: ListenSection,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TlsSection {
    ca: PathBuf,
    certificate: Option<PathBuf>,
    private_key: Option<PathBuf>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LoginSection {
    user: String,
    password_file: PathBuf,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ListenSection {
    demand_certificate: Option<bool>,
    users_file: Option<PathBuf>,
    #[serde(default)]
    allow: Vec<Allow>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Allow {
    #[serde(default)]
    certificates: Vec<String>,
    #[serde(default)]
    users: Vec<String>,
    #[serde(default)]
    roles: Vec<RoleName>,
    space: Option<String>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum RoleName {
    Plant,
    Controller,
    Fdi,
}

impl From<RoleName> for Role {
    fn from(name: RoleName) -> Self {
        match name {
            RoleName::Plant => Self::Plant,
            RoleName::Controller => Self::Controller,
            RoleName::Fdi => Self::Fdi,
        }
    }
}

/// Credentials for an endpoint, from `config` or, for `tls/…`, from the file named by the environment.
pub fn security_for(
    endpoint: &str,
    config: Option<&Path>,
    attachment: &Attachment,
) -> Result<Option<Security>, String> {
    let encrypted = endpoint.starts_with("tls/");
    let file = match config {
        Some(file) => file.to_owned(),
        None if encrypted => match std::env::var_os(CONFIG_VARIABLE) {
            Some(file) => file.into(),
            None => {
                return Err(format!(
                    "{endpoint} needs certificates; expected a file of credentials, as config=FILE after the endpoint or in the \
                     environment variable {CONFIG_VARIABLE}"
                ));
            }
        },
        None => return Ok(None),
    };
    let security = load(&file)?;
    security
        .check(endpoint, attachment)
        .map_err(|sentence| format!("{}: {sentence}", file.display()))?;
    Ok(Some(security))
}

/// Reads the file, and checks the files that it names.
pub fn load(path: &Path) -> Result<Security, String> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|error| format!("{name}: cannot be read: {error}; expected a file of credentials for zenoh"))?;
    let file: File = toml::from_str(&text).map_err(|error| {
        let line = error
            .span()
            .map(|span| text[..span.start.min(text.len())].lines().count().max(1));
        let place = line.map_or_else(String::new, |line| format!(" line {line}"));
        format!("{name}{place}: {}", error.message().replace('\n', " "))
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let read = |key: &str, file: &Path| {
        let file = folder.join(file);
        std::fs::read_to_string(&file)
            .map(|text| (file.clone(), text))
            .map_err(|error| format!("{name}: {key}: {}: cannot be read: {error}", file.display()))
    };
    let pem = |key: &str, file: &Path, kind: &str| {
        let (file, text) = read(key, file)?;
        if text.contains("-----BEGIN ") && text.contains(kind) {
            Ok(file)
        } else {
            Err(format!("{name}: {key}: {}: expected PEM with a {kind}", file.display()))
        }
    };
    let tls = file
        .tls
        .map(|tls| {
            let certificate = match (tls.certificate, tls.private_key) {
                (None, None) => None,
                (Some(certificate), Some(key)) => Some((
                    pem("tls.certificate", &certificate, "CERTIFICATE")?,
                    pem("tls.private_key", &key, "PRIVATE KEY")?,
                )),
                _ => return Err(format!("{name}: tls.certificate and tls.private_key belong together")),
            };
            Ok(Tls {
                ca: pem("tls.ca", &tls.ca, "CERTIFICATE")?,
                certificate,
            })
        })
        .transpose()?;
    let login = file
        .login
        .map(|login| {
            let (file, text) = read("login.password_file", &login.password_file)?;
            let password = text.trim().to_owned();
            if password.is_empty() || login.user.trim().is_empty() {
                return Err(format!(
                    "{name}: [login] needs a user and, in {}, a password",
                    file.display()
                ));
            }
            Ok(Login {
                user: login.user.trim().to_owned(),
                password,
            })
        })
        .transpose()?;
    let users_file = file
        .listen
        .users_file
        .map(|users| {
            let (file, text) = read("listen.users_file", &users)?;
            check_users(&text)
                .map_err(|sentence| format!("{name}: listen.users_file: {}: {sentence}", file.display()))?;
            Ok::<_, String>(file)
        })
        .transpose()?;
    let space = file.space.unwrap_or_else(|| DEFAULT_SPACE.to_owned());
    let grants = file.listen.allow.into_iter().map(|allow| Grant {
        certificates: allow.certificates,
        users: allow.users,
        roles: allow.roles.into_iter().map(Role::from).collect(),
        space: allow.space.unwrap_or_else(|| space.clone()),
    });
    Ok(Security {
        grants: grants.collect(),
        demand_certificate: file.listen.demand_certificate.unwrap_or(tls.is_some()),
        space,
        tls,
        login,
        users_file,
    })
}

/// One `user:password` per line, at least one.
fn check_users(text: &str) -> Result<(), String> {
    let mut lines = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty())
        .peekable();
    if lines.peek().is_none() {
        return Err("expected at least one line user:password".to_owned());
    }
    for (number, line) in lines {
        let whole = line
            .split_once(':')
            .is_some_and(|(user, password)| !user.trim().is_empty() && !password.trim().is_empty());
        if !whole {
            // The line may contain a password.
            return Err(format!("line {}: expected user:password", number + 1));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(write: impl FnOnce(&Path), text: &str, endpoint: &str, attachment: &Attachment) -> Option<String> {
        let folder = std::env::temp_dir().join(format!("rotortwin-zenoh-{}-{:p}", std::process::id(), &write));
        std::fs::create_dir_all(&folder).expect("folders can be made here");
        write(&folder);
        let file = folder.join("zenoh.toml");
        std::fs::write(&file, text).expect("files can be written here");
        let result = security_for(endpoint, Some(&file), attachment);
        std::fs::remove_dir_all(&folder).expect("it is ours");
        result.err()
    }

    #[test]
    fn val_a_wrong_file_is_refused_with_the_place() {
        let pem = |folder: &Path| {
            for (name, kind) in [
                ("ca.pem", "CERTIFICATE"),
                ("c.pem", "CERTIFICATE"),
                ("k.pem", "PRIVATE KEY"),
            ] {
                std::fs::write(folder.join(name), format!("-----BEGIN {kind}-----\n")).expect("it is ours");
            }
            std::fs::write(folder.join("users"), "a:b\n\nc:d\n").expect("it is ours");
            std::fs::write(folder.join("bad"), "a:b\nsecret\n").expect("it is ours");
            std::fs::write(folder.join("empty"), "\n").expect("it is ours");
        };
        let tls = "[tls]\nca = 'ca.pem'\ncertificate = 'c.pem'\nprivate_key = 'k.pem'\n";
        let listen = Attachment::Listen;
        let open = "[listen]\ndemand_certificate = false\n";
        for (text, endpoint, sentence) in [
            ("space = 3".to_owned(), "tcp/h:1", "line 1"),
            ("passwort = 'x'".to_owned(), "tcp/h:1", "unknown field"),
            (String::new(), "tls/h:1", "needs a section [tls]"),
            (String::new(), "tcp/h:1", "would accept every client"),
            (tls.to_owned(), "tcp/h:1", "would not be encrypted"),
            (format!("{tls}{open}"), "tls/h:1", "would accept every client"),
            ("[tls]\nca = 'ca.pem'\n".to_owned(), "tls/h:1", "needs tls.certificate"),
            ("[tls]\nca = 'k.pem'\n".to_owned(), "tls/h:1", "expected PEM"),
            ("[tls]\nca = 'no.pem'\n".to_owned(), "tls/h:1", "cannot be read"),
            (
                "[tls]\nca = 'ca.pem'\ncertificate = 'c.pem'\n".to_owned(),
                "tls/h:1",
                "belong together",
            ),
            (
                "[listen]\nusers_file = 'bad'\n".to_owned(),
                "tcp/h:1",
                "line 2: expected user:password",
            ),
            ("[listen]\nusers_file = 'empty'\n".to_owned(), "tcp/h:1", "at least one"),
            (
                "[login]\nuser = 'a'\npassword_file = 'empty'\n".to_owned(),
                "tcp/h:1",
                "needs a user",
            ),
            (format!("space = 'a/b'\n{tls}"), "tls/h:1", "cannot be part of a key"),
            (
                format!("{tls}[[listen.allow]]\nusers = ['a']\n"),
                "tls/h:1",
                "names users",
            ),
            (
                "[listen]\nusers_file = 'users'\n[[listen.allow]]\ncertificates = ['a']\n".to_owned(),
                "tcp/h:1",
                "names certificates",
            ),
            (
                format!("{tls}[[listen.allow]]\nroles = ['pilot']\n"),
                "tls/h:1",
                "pilot",
            ),
        ] {
            let refusal = refusal(pem, &text, endpoint, &listen).unwrap_or_default();
            assert!(refusal.contains(sentence), "{text}: {refusal:?}");
            assert!(!refusal.contains("secret"), "{refusal}");
        }
        assert_eq!(refusal(pem, tls, "tls/h:1", &listen), None);
        assert_eq!(
            refusal(pem, "[listen]\nusers_file = 'users'\n", "tcp/h:1", &listen),
            None
        );
        assert_eq!(
            refusal(pem, "[tls]\nca = 'ca.pem'\n", "tls/h:1", &Attachment::Connect),
            None
        );
    }
}
