//! Authentication and access control over zenoh.
//!
//! ```text
//!  client ──▶ TLS: a certificate signed by our CA? ──▶ user and password? ──▶ access control: role, space, run ──▶ topics
//! ```
//! The listener (the plant, or a router) checks all three; a connecting process checks the listener's certificate. The first two end
//! a connection; the third drops individual messages: a controller can publish its commands and nothing else.
//!
//! | Role | publishes below `SPACE/v1/RUN/` | receives |
//! |---|---|---|
//! | plant | sensors, steps, setup/…, finish | command, reports, join/…, ready/… |
//! | controller | command, join/controller, ready/controller | sensors, setup/controller, finish |
//! | fdi | reports, join/fdi, ready/fdi | steps, setup/fdi, finish |
//!
//! All participants of a run see which others are alive. A listening plant only admits its own run; a router does not know the
//! runs: there, spaces separate the tenants.
//!
//! * A connecting process also trusts the public certificate authorities built into zenoh.
//! * Within one run and role, clients are not distinguished unless a grant names them.
//! * User and password without TLS authenticate (the password itself is not sent) but encrypt nothing.

use crate::endpoint::slug;
use rotortwin_proto::Role;
use std::fmt;
use std::path::PathBuf;

/// Default first part of all keys.
pub const DEFAULT_SPACE: &str = "rotortwin";

/// How this process connects to the others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Attachment {
    /// Listens and routes between the others: the plant, if there is no router.
    Listen,
    /// Connects to the listener: the peers, and every process if there is a router.
    Connect,
}

/// Credentials of a process, and the access it grants as a listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Security {
    /// First part of all keys: letters, digits, `-` and `_`.
    pub space: String,
    /// For endpoints `tls/…`.
    pub tls: Option<Tls>,
    /// This process's login.
    pub login: Option<Login>,
    /// Listener: users and passwords, one `user:password` per line; every client must be one of them.
    pub users_file: Option<PathBuf>,
    /// Listener: require certificates signed by the CA.
    pub demand_certificate: bool,
    /// Listener: access grants; empty: every admitted client may play every role.
    pub grants: Vec<Grant>,
}

/// TLS files of a process, PEM.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tls {
    /// Trusted certificates.
    pub ca: PathBuf,
    /// Own certificate and its private key.
    pub certificate: Option<(PathBuf, PathBuf)>,
}

/// User and password.
#[derive(Clone, PartialEq, Eq)]
pub struct Login {
    /// Name.
    pub user: String,
    /// Password.
    pub password: String,
}

impl fmt::Debug for Login {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "Login {{ user: {:?}, password: … }}", self.user)
    }
}

/// Access granted to some of the admitted clients.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grant {
    /// Common names of certificates, any of them; empty: any certificate.
    pub certificates: Vec<String>,
    /// Users, any of them; empty: any user.
    pub users: Vec<String>,
    /// Roles; empty: all.
    pub roles: Vec<Role>,
    /// First part of the keys that they may access.
    pub space: String,
}

/// Runs that a listener admits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Runs {
    /// The plant's own.
    One(u64),
    /// Router: all.
    All,
}

impl Security {
    /// Returns an error message if an endpoint cannot be used with these settings.
    pub fn check(&self, endpoint: &str, attachment: &Attachment) -> Result<(), String> {
        let listens = *attachment == Attachment::Listen;
        if !is_name(&self.space) {
            return Err(format!(
                "the space {:?} cannot be part of a key; expected letters, digits, '-' and '_'",
                self.space
            ));
        }
        match (&self.tls, endpoint.starts_with("tls/")) {
            (None, true) => return Err(format!("{endpoint} needs a section [tls] with ca")),
            (Some(_), false) => {
                return Err(format!(
                    "{endpoint} would not be encrypted although there is a section [tls]; expected tls/HOST:PORT"
                ));
            }
            (Some(tls), true) if listens && tls.certificate.is_none() => {
                return Err(format!(
                    "listening on {endpoint} needs tls.certificate and tls.private_key"
                ));
            }
            _ => {}
        }
        let certifies = self.tls.is_some() && self.demand_certificate;
        if listens && !certifies && self.users_file.is_none() {
            return Err(format!(
                "{endpoint} would accept every client; expected listen.users_file, or [tls] with listen.demand_certificate = true"
            ));
        }
        let grants = self.grants.iter();
        for (number, grant) in grants.enumerate().filter(|_| listens) {
            if !is_name(&grant.space) {
                return Err(format!(
                    "listen.allow {}: the space {:?} cannot be part of a key; expected letters, digits, '-' and '_'",
                    number + 1,
                    grant.space
                ));
            }
            if !grant.certificates.is_empty() && !certifies {
                return Err(format!(
                    "listen.allow {} names certificates, and none are demanded; expected [tls] and listen.demand_certificate = true",
                    number + 1
                ));
            }
            if !grant.users.is_empty() && self.users_file.is_none() {
                return Err(format!(
                    "listen.allow {} names users, and there are none; expected listen.users_file",
                    number + 1
                ));
            }
        }
        Ok(())
    }

    /// zenoh settings: key and JSON.
    pub fn settings(&self, attachment: &Attachment, runs: Runs) -> Vec<(&'static str, String)> {
        let listens = *attachment == Attachment::Listen;
        let mut settings = Vec::new();
        let path = |path: &PathBuf| json(&path.to_string_lossy());
        if let Some(tls) = &self.tls {
            settings.push(("transport/link/tls/root_ca_certificate", path(&tls.ca)));
            if let Some((certificate, key)) = &tls.certificate {
                let (certificate_key, private_key) = if listens {
                    (
                        "transport/link/tls/listen_certificate",
                        "transport/link/tls/listen_private_key",
                    )
                } else {
                    (
                        "transport/link/tls/connect_certificate",
                        "transport/link/tls/connect_private_key",
                    )
                };
                settings.push((certificate_key, path(certificate)));
                settings.push((private_key, path(key)));
            }
            let mutual = if listens {
                self.demand_certificate
            } else {
                tls.certificate.is_some()
            };
            settings.push(("transport/link/tls/enable_mtls", mutual.to_string()));
        }
        match (listens, &self.login, &self.users_file) {
            (true, _, Some(users)) => settings.push(("transport/auth/usrpwd/dictionary_file", path(users))),
            (false, Some(login), _) => {
                let login = format!("{{ user: {}, password: {} }}", json(&login.user), json(&login.password));
                settings.push(("transport/auth/usrpwd", login));
            }
            _ => {}
        }
        if listens {
            settings.push(("access_control", self.access_control(runs)));
        }
        settings
    }

    /// zenoh's access control: everything not allowed is denied.
    fn access_control(&self, runs: Runs) -> String {
        let everybody = [Grant {
            certificates: Vec::new(),
            users: Vec::new(),
            roles: Vec::new(),
            space: self.space.clone(),
        }];
        let grants: &[Grant] = if self.grants.is_empty() {
            &everybody
        } else {
            &self.grants
        };
        let (mut rules, mut subjects, mut policies) = (Vec::new(), Vec::new(), Vec::new());
        for (number, grant) in grants.iter().enumerate() {
            let run = match runs {
                // Nothing that this plant knows of.
                Runs::One(_) if grant.space != self.space => continue,
                Runs::One(run) => format!("{run:016x}"),
                Runs::All => "*".to_owned(),
            };
            let prefix = format!("{}/v1/{run}", grant.space);
            let roles = [Role::Plant, Role::Controller, Role::Fdi];
            let may_be = |role: &Role| {
                (grant.roles.is_empty() || grant.roles.contains(role))
                    // Where the plant listens, no other process is the plant.
                    && (runs == Runs::All || *role != Role::Plant)
            };
            let mut own = Vec::new();
            for role in roles.into_iter().filter(may_be) {
                for (id, flow, messages, keys) in rules_of(role) {
                    let id = format!("{number}-{}-{id}", slug(role));
                    let keys: Vec<String> = keys.iter().map(|key| json(&format!("{prefix}/{key}"))).collect();
                    rules.push(format!(
                        "{{ id: {}, permission: \"allow\", flows: [\"{flow}\"], messages: {messages:?}, key_exprs: [{}] }}",
                        json(&id),
                        keys.join(", ")
                    ));
                    own.push(json(&id));
                }
            }
            if own.is_empty() {
                continue;
            }
            let names = |key: &str, names: &[String]| {
                if names.is_empty() {
                    return String::new();
                }
                let names: Vec<String> = names.iter().map(|name| json(name)).collect();
                format!(", {key}: [{}]", names.join(", "))
            };
            subjects.push(format!(
                "{{ id: \"{number}\"{}{} }}",
                names("cert_common_names", &grant.certificates),
                names("usernames", &grant.users)
            ));
            policies.push(format!("{{ rules: [{}], subjects: [\"{number}\"] }}", own.join(", ")));
        }
        format!(
            "{{ enabled: true, default_permission: \"deny\", rules: [{}], subjects: [{}], policies: [{}] }}",
            rules.join(", "),
            subjects.join(", "),
            policies.join(", ")
        )
    }

    /// Credentials presented in a rejected connection.
    pub fn shown(&self) -> String {
        let certificate = match &self.tls {
            Some(Tls {
                certificate: Some((certificate, _)),
                ..
            }) => format!("the certificate {}", certificate.display()),
            _ => "no certificate".to_owned(),
        };
        let user = match &self.login {
            Some(login) => format!("the user {:?} with a password", login.user),
            None => "no user".to_owned(),
        };
        let believed = match &self.tls {
            Some(tls) => format!(" and trusts {}", tls.ca.display()),
            None => String::new(),
        };
        format!("shows {certificate} and {user}{believed}")
    }
}

/// Rules of a role from the listener's point of view: name, direction, messages, keys.
type Rule = (
    &'static str,
    &'static str,
    &'static [&'static str],
    &'static [&'static str],
);

fn rules_of(role: Role) -> [Rule; 8] {
    let (alive, says, hears): (&[&str], &[&str], &[&str]) = match role {
        Role::Plant => (
            &["alive/plant"],
            &["sensors", "steps", "setup/controller", "setup/fdi", "finish"],
            &[
                "command",
                "reports",
                "join/controller",
                "join/fdi",
                "ready/controller",
                "ready/fdi",
            ],
        ),
        Role::Fdi => (
            &["alive/fdi"],
            &["reports", "join/fdi", "ready/fdi"],
            &["steps", "setup/fdi", "finish"],
        ),
        Role::Controller | Role::Unspecified => (
            &["alive/controller"],
            &["command", "join/controller", "ready/controller"],
            &["sensors", "setup/controller", "finish"],
        ),
    };
    [
        ("says", "ingress", &["put"], says),
        // So that it learns that it has subscribers.
        ("is-heard", "egress", &["declare_subscriber"], says),
        ("asks", "ingress", &["declare_subscriber"], hears),
        ("hears", "egress", &["put"], hears),
        ("lives", "ingress", &["liveliness_token"], alive),
        ("looks", "ingress", &["declare_liveliness_subscriber"], &["alive/*"]),
        ("is-seen", "egress", &["declare_liveliness_subscriber"], &["alive/*"]),
        // Outgoing only: incoming, it would speak for others.
        (
            "sees",
            "egress",
            &["liveliness_token"],
            &["alive/plant", "alive/controller", "alive/fdi"],
        ),
    ]
}

/// Letters, digits, `-` and `_`.
fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    !text.is_empty() && text.len() <= 64 && text.chars().all(plain)
}

/// A JSON string.
fn json(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.push_str(&format!("\\u{:04x}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}
