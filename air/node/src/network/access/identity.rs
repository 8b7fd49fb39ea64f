//! The vehicle's certificate, the key to it, who made it, and the people that it admits: a folder that `goshawk keys`
//! makes.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use goshawk_proto::keys::VehicleName;
use serde::Deserialize;
use serde_json::{Value, json};
use x509_parser::certificate::X509Certificate;
use x509_parser::pem::parse_x509_pem;

/// A day, s.
const DAY_S: i64 = 86_400;
/// A certificate that ends sooner than this is worth a warning, days. Chosen by eye.
const SOON_DAYS: i64 = 30;

/// Why an identity cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum IdentityError {
    /// A file is missing or cannot be read.
    #[error("network.identity: cannot read {path}: {cause}; `goshawk keys pair` puts it there")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        cause: std::io::Error,
    },
    /// It is not what it should be.
    #[error("network.identity: {path}: {cause}; make it anew with `goshawk keys pair`")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        cause: String,
    },
    /// It is of somebody else.
    #[error("network.identity: {path} is the certificate of {found:?}, but this vehicle is {wanted:?}")]
    Name {
        /// The certificate.
        path: PathBuf,
        /// Its common name.
        found: String,
        /// What it should be.
        wanted: String,
    },
    /// It is not valid now.
    #[error(
        "network.identity: {path} is valid from {from} to {until}, and this computer's clock says {now}: set the clock, \
         or make the identity anew with `goshawk keys vehicle NAME --renew` and pair again"
    )]
    Time {
        /// The certificate.
        path: PathBuf,
        /// First moment, UTC.
        from: String,
        /// Last moment, UTC.
        until: String,
        /// Now, UTC.
        now: String,
    },
}

/// `access.toml`: the people that the vehicle admits.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(deny_unknown_fields)]
struct Admitted {
    operators: Vec<String>,
    observers: Vec<String>,
}

/// A vehicle's identity folder, read and checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    folder: PathBuf,
    admitted: Admitted,
    /// End of the certificate, seconds of Unix time.
    until: i64,
}

impl Identity {
    /// Reads the folder of the vehicle `name`.
    ///
    /// # Errors
    /// A file is missing, malformed, of another vehicle, or no longer valid.
    pub fn load(folder: &Path, name: &VehicleName) -> Result<Self, IdentityError> {
        let read = |name: &str| {
            let path = folder.join(name);
            std::fs::read(&path).map_err(|cause| IdentityError::Read { path, cause })
        };
        read("ca.pem")?;
        read("key.pem")?;
        let path = folder.join("cert.pem");
        let until = check(&path, &read("cert.pem")?, &format!("vehicle.{name}"), now_s())?;
        let path = folder.join("access.toml");
        let text = String::from_utf8_lossy(&read("access.toml")?).into_owned();
        let admitted: Admitted = toml::from_str(&text)
            .map_err(|e| IdentityError::Malformed { path: path.clone(), cause: e.message().to_owned() })?;
        for person in admitted.operators.iter().chain(&admitted.observers) {
            person.parse::<VehicleName>().map_err(|_| IdentityError::Malformed {
                path: path.clone(),
                cause: format!("{person:?} is no name"),
            })?;
        }
        Ok(Identity { folder: folder.to_owned(), admitted, until })
    }

    /// Certificate names of the operators.
    pub(super) fn operators(&self) -> Vec<String> {
        self.admitted.operators.iter().map(|name| format!("operator.{name}")).collect()
    }

    /// Certificate names of the observers.
    pub(super) fn observers(&self) -> Vec<String> {
        self.admitted.observers.iter().map(|name| format!("observer.{name}")).collect()
    }

    /// Certificate names of all who may do anything.
    pub(super) fn admitted(&self) -> Vec<String> {
        [self.operators(), self.observers()].concat()
    }

    /// Zenoh's `transport/link/tls`: both sides show a certificate of the same maker, and a link ends with it.
    pub(super) fn settings(&self) -> Value {
        let path = |name: &str| self.folder.join(name).to_string_lossy().into_owned();
        json!({
            "root_ca_certificate": path("ca.pem"),
            "listen_certificate": path("cert.pem"),
            "listen_private_key": path("key.pem"),
            "enable_mtls": true,
            "close_link_on_expiration": true,
            "so_sndbuf": 16384,
        })
    }

    /// In words, for `check`; the second: why it should be looked at.
    #[must_use]
    pub fn describe(&self) -> (String, Option<String>) {
        let days = (self.until - now_s()) / DAY_S;
        let listed = |names: &[String]| if names.is_empty() { "nobody".to_owned() } else { names.join(", ") };
        let Admitted { operators, observers } = &self.admitted;
        let words =
            format!("operators: {}; observers: {}; valid for {days} days", listed(operators), listed(observers));
        let worry = if operators.is_empty() {
            Some("nobody may start or stop the vehicle: `goshawk keys operator NAME`, then pair again".to_owned())
        } else if days < SOON_DAYS {
            Some(format!("the certificate ends in {days} days: `goshawk keys vehicle NAME --renew`, then pair again"))
        } else {
            None
        };
        (words, worry)
    }
}

/// The certificate is of `wanted` and valid at `now` (Unix time, s); gives its end.
fn check(path: &Path, pem: &[u8], wanted: &str, now: i64) -> Result<i64, IdentityError> {
    let malformed = |cause: String| IdentityError::Malformed { path: path.to_owned(), cause };
    let (_, pem) = parse_x509_pem(pem).map_err(|e| malformed(format!("not a PEM file ({e})")))?;
    let certificate: X509Certificate<'_> =
        pem.parse_x509().map_err(|e| malformed(format!("not a certificate ({e})")))?;
    let found = certificate.subject().iter_common_name().next().and_then(|cn| cn.as_str().ok()).unwrap_or_default();
    if found != wanted {
        return Err(IdentityError::Name { path: path.to_owned(), found: found.to_owned(), wanted: wanted.to_owned() });
    }
    let validity = certificate.validity();
    let (from, until) = (validity.not_before.timestamp(), validity.not_after.timestamp());
    if (from..=until).contains(&now) {
        return Ok(until);
    }
    Err(IdentityError::Time { path: path.to_owned(), from: utc(from), until: utc(until), now: utc(now) })
}

fn now_s() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| i64::try_from(d.as_secs()).unwrap_or(i64::MAX))
}

fn utc(seconds: i64) -> String {
    let time = UNIX_EPOCH + std::time::Duration::from_secs(u64::try_from(seconds).unwrap_or(0));
    humantime::format_rfc3339_seconds(time).to_string()
}
